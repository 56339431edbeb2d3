"""Write `requirements.lock` anew: `python -m bootstrap.relock [--upgrade]`, with the program `uv` on the PATH.

One resolution serves every system and every Python that pyproject.toml admits; where a pin differs, a marker says so.
The versions in NOTICE.md follow. A package that is new is named there by hand, since somebody has to read its licence.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from bootstrap.packages import LOCK, canonical, names_in, versions_in

ROOT = Path(__file__).resolve().parents[1]
HEADER = """\
# Every package that Strata installs, for Python 3.11 to 3.14 on Linux, macOS and Windows, with the hashes of its files.
# A section holds what the set of packages in its name needs beside the core.
# Written by `python -m bootstrap.relock`, which resolves pyproject.toml; not edited by hand.
"""


def resolve(arguments: list[str], output: Path) -> str:
    """Return what uv resolves pyproject.toml to; pins already in `output` are kept where they still fit."""
    command = ["uv", "pip", "compile", "--quiet", "--universal", "--python-version", "3.11", "--no-header"]
    command += ["--no-annotate", "--no-emit-index-url", "--output-file", str(output), *arguments]
    try:
        subprocess.run([*command, str(ROOT / "pyproject.toml")], check=True, stdout=subprocess.DEVNULL)
    except FileNotFoundError:
        sys.exit("The program uv is not on the PATH: https://docs.astral.sh/uv/ says how to install it.")
    except subprocess.CalledProcessError as error:
        sys.exit(error.returncode)  # uv said why
    return output.read_text("utf-8")


def relock(old: str, upgrade: bool) -> str:
    """Return the text of a new lock; the pins of the old one stay unless `upgrade`."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    with tempfile.TemporaryDirectory() as folder:
        full = Path(folder, "all.txt")
        full.write_text(old, "utf-8")
        text = resolve(["--all-extras", "--generate-hashes", *(["--upgrade"] if upgrade else [])], full)
        members = {}
        for name in ("core", *extras):
            extra = [] if name == "core" else ["--extra", name]
            members[name] = set(names_in(resolve([*extra, "--constraint", str(full)], Path(folder, name))))
    parts: dict[tuple[str, ...], str] = {}
    for block in re.split(r"^(?=[A-Za-z0-9])", text, flags=re.MULTILINE)[1:]:
        package = names_in(block)[0]
        belongs = tuple(name for name in ("core", *extras) if package in members[name])
        key = ("core",) if "core" in belongs else belongs
        parts[key] = parts.get(key, "") + block
    return HEADER + "".join(f"\n# [{', '.join(key)}]\n{parts[key]}" for key in sorted(parts))


def follow(notice: str, lock: str) -> tuple[str, set[str]]:
    """Return NOTICE.md with the versions of the lock and without what left it, and the packages that it must gain."""
    versions = versions_in(lock)
    lines, known = [], set()
    for line in notice.splitlines():
        cells = line.split(" | ")
        if len(cells) == 4 and "version" not in cells:  # a row of a package
            name = canonical(cells[0].removeprefix("| "))
            if name not in versions:
                continue
            known.add(name)
            cells[1] = ", ".join(versions[name])
        lines.append(" | ".join(cells))
    return "\n".join(lines) + "\n", set(versions) - known


def main() -> int:
    """Write the lock and the notice; return 1 where a package is missing in the notice."""
    lock, notice = ROOT / LOCK, ROOT / "NOTICE.md"
    text = relock(lock.read_text("utf-8") if lock.is_file() else "", "--upgrade" in sys.argv)
    lock.write_text(text, "utf-8")
    followed, new = follow(notice.read_text("utf-8"), text)
    notice.write_text(followed, "utf-8")
    if new:
        print(f"NOTICE.md needs a row, with licence and home page, for {', '.join(sorted(new))}.")
    return 1 if new else 0


if __name__ == "__main__":
    sys.exit(main())
