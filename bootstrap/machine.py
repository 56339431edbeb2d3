"""Describe the machine that Strata is to run on: everything that the decision in `plan.py` may look at."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from bootstrap import apt_sources, graphics
from bootstrap.apt_sources import Source
from bootstrap.graphics import Graphics

MANAGERS = ("apt-get", "dnf", "pacman", "brew")
VALIDATION_LAYER = "VK_LAYER_KHRONOS_validation"
Version = tuple[int, int]


@dataclass(frozen=True)
class Machine:
    """What was found, as plain values; a test writes one down for a machine that it has not got."""

    system: str = "linux"  # sys.platform: "linux", "darwin", "win32"
    distribution: str = ""  # ID of /etc/os-release: "debian", "ubuntu", "fedora", "arch", ...
    release: str = ""  # VERSION_ID: "12", "24.04"
    codename: str = ""  # VERSION_CODENAME: "bookworm"
    like: tuple[str, ...] = ()  # ID_LIKE: the distributions that this one is made from
    wsl: bool = False
    container: bool = False
    root: bool = False
    sudo: bool = False
    terminal: bool = False  # somebody can be asked
    ci: bool = False
    python: Version = (3, 11)
    can_make_venv: bool = True  # Debian and Ubuntu ship Python without ensurepip
    managers: tuple[str, ...] = ()  # those of MANAGERS that are on the PATH
    packages: frozenset[str] = frozenset()  # Debian packages that are installed, among those asked about
    sources: tuple[Source, ...] = ()  # where apt takes packages from
    graphics: Graphics = field(default_factory=Graphics)  # what the program itself says that it can draw with
    glslang: bool = False  # glslangValidator is on the PATH


def describe(debian_packages: tuple[str, ...] = (), found: Graphics | None = None) -> Machine:
    """Return this machine. `found` is what it draws with; without it the program of this Python is asked."""
    release = os_release()
    on_linux = sys.platform == "linux"
    managers = tuple(name for name in MANAGERS if shutil.which(name))
    return Machine(
        system="linux" if on_linux else sys.platform,
        distribution=release.get("ID", ""),
        release=release.get("VERSION_ID", ""),
        codename=release.get("VERSION_CODENAME", ""),
        like=tuple(release.get("ID_LIKE", "").split()),
        wsl=on_linux and "microsoft" in platform.release().lower(),
        container=any(map(os.path.exists, ("/.dockerenv", "/run/.containerenv")))
        or "container" in os.environ,
        root=hasattr(os, "geteuid") and os.geteuid() == 0,
        sudo=shutil.which("sudo") is not None,
        terminal=_is_terminal(),
        ci=in_ci(),
        python=sys.version_info[:2],
        can_make_venv=all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")),
        managers=managers,
        packages=_installed(debian_packages) if "apt-get" in managers else frozenset(),
        sources=tuple(apt_sources.read_all()) if "apt-get" in managers else (),
        graphics=graphics.ask(sys.executable) if found is None else found,
        glslang=shutil.which("glslangValidator") is not None,
    )


def in_ci() -> bool:
    """Return whether this is a run of continuous integration: `CI=true`, as the common services set it."""
    return os.environ.get("CI", "").lower() == "true"


def os_release(path: Path = Path("/etc/os-release")) -> dict[str, str]:
    """Return the fields of /etc/os-release, {} where there is none."""
    try:
        lines = path.read_text("utf-8").splitlines()
    except OSError:
        return {}
    pairs = (line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    return {key.strip(): value.strip().strip("\"'") for key, value in pairs}


def _is_terminal() -> bool:
    return all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr))


def _installed(packages: tuple[str, ...]) -> frozenset[str]:
    command = ["dpkg-query", "-W", "-f", "${db:Status-Status} ${Package}\\n", *packages]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return frozenset()
    words = (line.split() for line in done.stdout.splitlines())
    return frozenset(pair[1] for pair in words if pair[0] == "installed")
