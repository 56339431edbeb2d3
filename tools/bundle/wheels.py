"""Fetch the wheels of the lock for a system and a Python that need not be these: by pip, and by the lock's hashes.

pip can be told another system's tags, but it judges the lock's markers (`sys_platform == 'win32'`) by the system it
runs on. So they are judged here, and pip gets the requirements that remain.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.tags import platform_tags

from bootstrap import packages
from bootstrap.bundle import SYSTEMS, this_system
from common.errors import UserError

GLIBC = 35
"""The minor version of glibc that wheels for "linux" may ask for: that of Ubuntu 22.04; Debian 12 has a newer one."""
MACOS = 14
"""The version of macOS that wheels may ask for."""
MICROS = (99, 0)
"""Of a Python for another machine only "3.11" is known: what its newest and its first release need is fetched."""

NO_WHEEL = re.compile(r"No matching distribution found for ([\w.-]+)")
NO_NETWORK = re.compile(r"Retrying \(|Could not fetch URL")


@dataclass(frozen=True)
class Fetched:
    """The wheels for one system, and the packages that have none for it."""

    wheels: tuple[Path, ...]
    lacks: tuple[str, ...]


def fetch(system: str, python: str, lock: str, everything: bool, folder: Path) -> Fetched:
    """Fetch into `folder` what the lock names for a system and a Python ("3.12"); raise UserError where pip fails."""
    text = packages.locked(lock, everything)
    done: set[str] = set()
    lacks: list[str] = []
    for micro in MICROS:
        wanted = [line for line in needed(text, system, f"{python}.{micro}") if line not in done]
        done.update(wanted)
        while wanted:
            missing = _download(wanted, system, f"{python}.{micro}", folder)
            if missing is None:
                break
            lacks.append(missing)
            wanted = packages.without("".join(wanted), {missing}).splitlines(keepends=True)
    return Fetched(tuple(sorted(folder.glob("*.whl"))), tuple(sorted(set(lacks))))


def needed(requirements: str, system: str, python: str) -> list[str]:
    """Return the requirements with their hashes that hold for a system and a Python ("3.12.0"), a line each."""
    kept = []
    for line in requirements.replace("\\\n", " ").splitlines():
        if not line or line.startswith("#"):
            continue
        text, *hashes = line.split("--hash=")
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate(surroundings(system, python)):
            pin = f"{requirement.name}{requirement.specifier}"
            kept.append(" ".join([pin, *(f"--hash={one.strip()}" for one in hashes)]) + "\n")
    return kept


def surroundings(system: str, python: str) -> dict[str, str]:
    """Return what markers are judged by."""
    here: Mapping[str, object] = default_environment()
    found = {name: str(value) for name, value in here.items()}
    found |= {
        "python_version": ".".join(python.split(".")[:2]),
        "python_full_version": python,
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
    }
    if system in SYSTEMS:
        kind, machine = SYSTEMS[system]
        names = {"linux": "Linux", "darwin": "Darwin", "win32": "Windows"}
        found |= {"sys_platform": kind, "platform_machine": machine, "platform_system": names[kind]}
        found |= {"os_name": "nt" if kind == "win32" else "posix"}
    return found


def tags(system: str) -> list[str]:
    """Return the systems' part of the names of wheels that run there, the best first."""
    if system == this_system():
        return list(platform_tags())
    kind, machine = SYSTEMS[system]
    if kind == "win32":
        return ["win_amd64"]
    if kind == "darwin":
        return [f"macosx_{MACOS}_0_{machine}"]  # pip adds the older ones, and those for both processors
    by_glibc = [f"manylinux_2_{minor}_{machine}" for minor in range(GLIBC, 16, -1)]
    older = ["manylinux2014", "manylinux2010", "manylinux1"] if machine == "x86_64" else ["manylinux2014"]
    return [*by_glibc, *(f"{name}_{machine}" for name in older), f"linux_{machine}"]


def _download(lines: Collection[str], system: str, python: str, folder: Path) -> str | None:
    """Let pip fetch requirements; return the name of one that has no wheel, None when all are there."""
    with tempfile.TemporaryDirectory(prefix="strata-") as scratch:
        file = Path(scratch, "requirements.txt")
        file.write_text("".join(lines), "utf-8")
        command = [sys.executable, "-I", "-m", "pip", "--disable-pip-version-check", "--no-input", "download"]
        command += ["--only-binary=:all:", "--no-deps", "--require-hashes", "--progress-bar", "off"]
        # A network that is down and a package that nobody has end alike in pip, but for its words on trying again.
        command += ["--retries", "1"]
        command += ["--implementation", "cp", "--python-version", python]
        for tag in tags(system):
            command += ["--platform", tag]
        command += ["--dest", str(folder), "-r", str(file)]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return None
    said = done.stdout + done.stderr
    missing = NO_WHEEL.search(said)
    if missing and not NO_NETWORK.search(said):
        return missing[1]
    lines_of_pip = "\n  ".join(said.strip().splitlines()[-8:])
    raise UserError(
        f"The packages for {system} with Python {python.rpartition('.')[0]} could not be fetched; the last lines of "
        f"pip:\n  {lines_of_pip}"
    )
