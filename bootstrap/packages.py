"""Choose Python packages: out of the lock, with their hashes, or newest out of `pyproject.toml`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection
from pathlib import Path

LOCK = "requirements.lock"
SECTION = re.compile(r"^# \[([\w, -]+)\]$", re.MULTILINE)


def sections(lock: str) -> dict[tuple[str, ...], str]:
    """Return the parts of a lock by the sets that they belong to: ("core",), ("dev",), ("dev", "reference")."""
    pieces = SECTION.split(lock)
    return {
        tuple(name.strip() for name in pieces[i].split(",")): pieces[i + 1] for i in range(1, len(pieces), 2)
    }


def locked(lock: str, everything: bool) -> str:
    """Return the requirements with their hashes that pip is to install: the core, or all extras with it."""
    return "".join(text for names, text in sections(lock).items() if everything or "core" in names)


def without(requirements: str, names: Collection[str]) -> str:
    """Return requirements with their hashes less those of some packages."""
    blocks = re.split(r"^(?=[A-Za-z0-9#])", requirements, flags=re.MULTILINE)
    return "".join(block for block in blocks if not set(names_in(block)) & set(names))


def names_in(requirements: str) -> list[str]:
    """Return the names of the packages in requirements, in order, as written."""
    return re.findall(r"^([A-Za-z0-9][\w.-]*)", requirements, re.MULTILINE)


def canonical(name: str) -> str:
    """Return a package's name in the one spelling that indexes compare: `typing_extensions` is `typing-extensions`."""
    return re.sub(r"[-_.]+", "-", name).lower()


def versions_in(lock: str) -> dict[str, list[str]]:
    """Return the pinned versions of every package by its canonical name; two where markers choose between them."""
    versions: dict[str, list[str]] = {}
    for name, version in re.findall(r"^([A-Za-z0-9][\w.-]*)==([\w.]+)", lock, re.MULTILINE):
        versions.setdefault(canonical(name), []).append(version)
    return versions


def newest(pyproject: Path, everything: bool) -> str:
    """Return the requirements of `pyproject.toml`, which name lower bounds alone."""
    project = tomllib.loads(pyproject.read_text("utf-8"))["project"]
    wanted = list(project["dependencies"])
    if everything:
        for extra in project.get("optional-dependencies", {}).values():
            wanted += extra
    return "\n".join(wanted) + "\n"
