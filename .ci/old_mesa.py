"""Run a command of this clone on a machine with Debian 12's own graphics drivers, Mesa 22.3.6, as many people have.

    sudo python3 .ci/old_mesa.py [--fresh] MACHINE [COMMAND...]
    sudo python3 .ci/old_mesa.py --record-drawing MACHINE
    sudo python3 .ci/old_mesa.py --record-tests MACHINE

The machines, each a folder below `out/machines/` that is made once, by debootstrap:

    none     no graphics driver
    egl      OpenGL's driver with libegl1, but no libGL.so, as containers often have it
    gl       OpenGL's software driver, and no Vulkan
    vulkan   Vulkan's software driver as well

A machine is a chroot with Python, git and a clone of the last commit in /strata. COMMAND runs there in an environment
that holds nothing of this one; without a command it is a shell. `--fresh` makes the machine anew, so that a first start
can be tried. The models of STRATA_ASSETS are in /models. `--record-drawing` draws every chapter and study there by
each backend that it has a version for, `--record-tests` runs the tests, and both keep the results in
docs/records/machines.json.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MACHINES = ROOT / "out" / "machines"
RECORD = ROOT / "docs" / "records" / "machines.json"
RELEASE = "bookworm"
BASE = ("python3", "python3-venv", "git", "ca-certificates")
DRIVERS = {
    "none": (),
    "egl": ("libgl1-mesa-dri", "libegl1"),
    "gl": ("libgl1-mesa-dri", "libegl1", "libgl1"),
    "vulkan": ("libgl1-mesa-dri", "libegl1", "libgl1", "libvulkan1", "mesa-vulkan-drivers"),
}
ENVIRONMENT = {
    "HOME": "/root",
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "LANG": "C.UTF-8",
    "TERM": "dumb",
    "DEBIAN_FRONTEND": "noninteractive",
    "STRATA_ASSETS": "/models",
}


def main(words: list[str]) -> int:
    """Make the machine where it is missing, bring its clone to the last commit, and run the command there."""
    flags = {word for word in words[:1] if word in ("--fresh", "--record-drawing", "--record-tests")}
    words = words[len(flags) :]
    if not words or words[0] not in DRIVERS:
        print(f"Name a machine: {', '.join(DRIVERS)}. {Path(__file__).name} begins with a description.")
        return 2
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        print("This needs root and the program debootstrap (apt-get install debootstrap).")
        return 2
    name, command = words[0], words[1:] or ["bash"]
    folder = MACHINES / name
    if "--fresh" in flags and folder.exists():
        shutil.rmtree(folder)  # nothing is mounted there: the mounts of `enter` end with the command
    make(name, folder)
    bring(folder)
    if "--record-drawing" in flags:
        drawn, failed = draw_everything(name, folder)
        keep(name, folder, "drawing", drawn)
        return int(failed)
    if "--record-tests" in flags:
        tests, failed = run_tests(folder)
        keep(name, folder, "tests", tests)
        return int(failed)
    return enter(folder, f"cd /strata && exec {shlex.join(command)}", interactive=not words[1:])


EVERYTHING = """
import json, sys
import chapters
from chapters import studies
for number in chapters.available():
    print(json.dumps([str(number), ["vulkan", "gl"]]))
    for name in studies.available(number):
        print(json.dumps([f"{number}/{name}", studies.backends(f"{number}/{name}")]))
"""
"""Prints what can be drawn, and by which backends."""


def draw_everything(name: str, folder: Path) -> tuple[dict[str, dict[str, str]], bool]:
    """Return how each command to draw ended, by what is drawn and backend, and whether any failed."""
    listing = shlex.join([".venv/bin/python", "-P", "-c", EVERYTHING])
    # Set up by a command that draws: the launcher's own words are seen, too.
    listed = read(folder, f"./strata --no-install run 1 --headless --out /tmp/a.png >&2; {listing}")[1]
    drawn: dict[str, dict[str, str]] = {}
    for which, backends in (json.loads(line) for line in listed.splitlines() if line.startswith("[")):
        for backend in ("auto", *(one for one in backends if one == "gl" or name == "vulkan")):
            command = f"./strata --no-install run {which} --backend {backend} --headless --out /tmp/a.png"
            began = time.monotonic()
            code, said = read(folder, f"timeout 600 {command} 2>&1")
            ended = "drawn" if code == 0 else f"exit code {code}: {' '.join(said.splitlines()[-1:])}"
            drawn.setdefault(which, {})[backend] = ended
            print(f"{which} {backend}: {ended} ({time.monotonic() - began:.1f} s)", flush=True)
    return drawn, any(set(ends.values()) != {"drawn"} for ends in drawn.values())


def run_tests(folder: Path) -> tuple[dict[str, Any], bool]:
    """Return the exit code of the tests, their last line and what failed, and whether anything did."""
    code, said = read(folder, "./strata --no-install test -q 2>&1")
    summary = next((line for line in reversed(said.splitlines()) if " passed" in line), "no summary")
    failed = [line.split()[1] for line in said.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    print(f"tests: exit code {code}: {summary}", *failed, sep="\n", flush=True)
    return {"code": code, "summary": summary.strip(" ="), "failed": failed}, code != 0


def keep(name: str, folder: Path, what: str, found: object) -> None:
    """Write what was found on a machine into the record, with the versions of Mesa and of the clone."""
    try:
        kept = json.loads(RECORD.read_text("utf-8"))
    except FileNotFoundError:
        kept = {}
    kept.setdefault(name, {})[what] = {
        "mesa": read(folder, "dpkg-query -W -f '${Version}' libgl1-mesa-dri")[1],
        "commit": output("git", "-C", str(ROOT), "rev-parse", "--short=12", "HEAD"),
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "found": found,
    }
    RECORD.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n", "utf-8")


def read(folder: Path, command: str) -> tuple[int, str]:
    """Return the exit code of a shell command in the clone of a machine, and what it prints."""
    done = subprocess.run(
        inside(folder, f"cd /strata && {command}"),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )
    return done.returncode, done.stdout


def make(name: str, folder: Path) -> None:
    """Make the chroot of a machine with its drivers, from a base that all machines share."""
    if (folder / "ready").exists():
        return
    base = MACHINES / "base"
    if not (base / "ready").exists():
        shutil.rmtree(base, ignore_errors=True)
        base.mkdir(parents=True)
        run("debootstrap", "--variant=minbase", f"--include={','.join(BASE)}", RELEASE, str(base))
        (base / "ready").touch()
    shutil.rmtree(folder, ignore_errors=True)
    run("cp", "-a", str(base), str(folder))
    (folder / "ready").unlink()
    # The network of this machine: its name servers, and the certificates that it trusts.
    for path in ("etc/resolv.conf", "etc/ssl/certs/ca-certificates.crt"):
        shutil.copyfile(f"/{path}", folder / path)
    if DRIVERS[name]:
        install = f"apt-get install -y --no-install-recommends {' '.join(DRIVERS[name])}"
        if enter(folder, f"apt-get update -q && {install}"):
            raise SystemExit(1)
    (folder / "ready").touch()


def bring(folder: Path) -> None:
    """Bring the clone in the machine to the last commit of this one; what lies in it beside the commit stays."""
    clone, commit = folder / "strata", output("git", "-C", str(ROOT), "rev-parse", "HEAD")
    if not clone.exists():
        run("git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(clone))
    run("git", "-C", str(clone), "fetch", "--quiet", str(ROOT), commit)
    run("git", "-C", str(clone), "checkout", "--quiet", "--force", "--detach", commit)


def enter(folder: Path, command: str, interactive: bool = False) -> int:
    """Run a shell command inside the chroot; return its exit code."""
    stdin = None if interactive else subprocess.DEVNULL
    return subprocess.run(inside(folder, command), stdin=stdin, check=False).returncode


def inside(folder: Path, command: str) -> list[str]:
    """Return the command that runs a shell command inside the chroot, with mounts that end with it."""
    models = Path(os.environ.get("STRATA_ASSETS", ROOT.parent / "shared" / "assets"))
    place = shlex.quote(str(folder))
    mounts = [
        f"mount --bind /dev {place}/dev",
        f"mount -t proc proc {place}/proc",
        f"mount -t tmpfs -o mode=1777 tmpfs {place}/tmp",
    ]
    (folder / "models").mkdir(exist_ok=True)
    if models.is_dir():
        mounts.append(f"mount --bind {shlex.quote(str(models))} {place}/models")
    variables = [f"{key}={value}" for key, value in ENVIRONMENT.items()]
    there = shlex.join(["chroot", str(folder), "env", "-i", *variables, "bash", "-c", command])
    script = " && ".join([*mounts, f"exec {there}"])
    # A process tree of its own: what the command leaves running ends with it, and so do the mounts.
    return ["unshare", "--mount", "--pid", "--fork", "--kill-child", "bash", "-c", script]


def run(*command: str) -> None:
    """Run a command of this machine; end here where it fails."""
    if subprocess.run(command, check=False).returncode:
        raise SystemExit(f"{shlex.join(command)} failed.")


def output(*command: str) -> str:
    """Return what a command of this machine prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
