"""A bundle: one file with the clone, its packages and more, from which Strata is set up without a network.

It is a zip archive that Python runs: `python3 FILE FOLDER` unpacks the clone. `strata bundle` writes it.

    __main__.py      what Python runs
    clone/           the files of one commit
    history.bundle   the history of that commit, as `git bundle` packs it
    wheels/          Python packages for the systems that the manifest names
    site/            the built site
    models/NAME/     models
    manifest.json    the format, the commit, the systems, and the size and SHA-256 of every other file

Here it is read. Nothing in it is used before all of it was found to be as it was packed.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shutil
import sys
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn

from bootstrap.environment import SetupError

FORMAT = 1
MANIFEST = "manifest.json"
MAIN = "__main__.py"
HISTORY = "history.bundle"
CLONE, WHEELS, SITE, MODELS = "clone/", "wheels/", "site/", "models/"

SYSTEMS: Mapping[str, tuple[str, str]] = {
    "linux": ("linux", "x86_64"),
    "linux-arm64": ("linux", "aarch64"),
    "macos-arm64": ("darwin", "arm64"),
    "macos-x86_64": ("darwin", "x86_64"),
    "windows": ("win32", "AMD64"),
}
"""Systems that can be asked for by name: what `sys.platform` and `platform.machine()` say there."""

CHUNK_BYTES = 1 << 20
LARGEST_MANIFEST = 64 << 20
# What Windows or a shell would take for something else than the name of a file.
ODD = re.compile(r'[\\:*?"<>|\x00-\x1f]')


@dataclass(frozen=True)
class Entry:
    """A file in a bundle: its size in bytes, its SHA-256 in hexadecimal, and whether it is a program."""

    size: int
    sha256: str
    program: bool = False


@dataclass(frozen=True)
class Target:
    """The packages for one system and one Python ("3.12"): the wheels' file names, and the packages without one."""

    system: str
    python: str
    packages: str  # "core", or "all" with the extras
    wheels: tuple[str, ...]
    lacks: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.system} with Python {self.python}"


@dataclass(frozen=True)
class Manifest:
    """What a bundle says of itself."""

    commit: str
    targets: tuple[Target, ...]
    files: Mapping[str, Entry]


def this_system() -> str:
    """Return the name of this system, as in SYSTEMS where it is one of those."""
    machine = platform.machine()
    for name, kind in SYSTEMS.items():
        if kind == (sys.platform, machine):
            # The wheels for Linux need glibc; a Linux with another library of C has wheels of its own.
            other = sys.platform == "linux" and platform.libc_ver()[0] != "glibc"
            return f"{name}-without-glibc" if other else name
    return f"{sys.platform}-{machine}"


class Bundle:
    """A bundle that is open, and was found to be whole."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, manifest: Manifest) -> None:
        self.path = path
        self.manifest = manifest
        self._archive = archive

    def names(self, prefix: str) -> list[str]:
        """Return the files below a folder of the bundle, such as "models/", by their whole names."""
        return [name for name in self.manifest.files if name.startswith(prefix)]

    def read(self, name: str) -> bytes:
        """Return one file."""
        return b"".join(_chunks(self.path, self._archive, name, self.manifest.files[name]))

    def unpack(self, prefix: str, folder: Path) -> None:
        """Write the files below a folder of the bundle into `folder`, without that prefix."""
        for name in self.names(prefix):
            self.unpack_one(name, folder / name.removeprefix(prefix))

    def unpack_one(self, name: str, path: Path) -> None:
        """Write one file; a program can be run."""
        entry = self.manifest.files[name]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as stream:
                for chunk in _chunks(self.path, self._archive, name, entry):
                    stream.write(chunk)
            if entry.program:
                path.chmod(path.stat().st_mode | 0o111)
        except OSError as error:
            reason = error.strerror or error
            raise SetupError(
                f"{path} cannot be written: {reason}; make room there, or choose another place."
            ) from None


@contextmanager
def open_bundle(path: Path) -> Iterator[Bundle]:
    """Give a bundle, all of whose bytes are as they were packed; raise SetupError where they are not."""
    try:
        stream = path.open("rb")
    except FileNotFoundError:
        raise SetupError(f"There is no file {path}: name one that `strata bundle` wrote.") from None
    except OSError as error:
        raise SetupError(f"{path} cannot be read as a bundle: {error.strerror or error}.") from None
    with stream:
        try:
            archive = zipfile.ZipFile(stream)
            manifest = _manifest(path, archive)
            for name, entry in manifest.files.items():
                for _ in _chunks(path, archive, name, entry):
                    pass
        # What zipfile raises for an archive that was changed depends on the place of the change.
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            NotImplementedError,
            RuntimeError,
            ValueError,
        ) as error:
            _damaged(path, str(error) or type(error).__name__)
        except OSError as error:
            raise SetupError(f"{path} cannot be read: {error.strerror or error}.") from None
        yield Bundle(path, archive, manifest)


def _damaged(path: Path, why: str) -> NoReturn:
    raise SetupError(
        f"{path} is no whole bundle ({why.rstrip('.')}): copy it again, or make it again by `strata bundle`."
    )


def _manifest(path: Path, archive: zipfile.ZipFile) -> Manifest:
    """Return the manifest of an archive that has exactly the files which it names, none of them elsewhere."""
    names = archive.namelist()
    for name in names:
        if not inside(name):
            raise SetupError(
                f"{path} is refused: it has a file {name!r}, which would not lie in the folder asked for."
            )
    if MANIFEST not in names:
        _damaged(path, f"it has no {MANIFEST}")
    if archive.getinfo(MANIFEST).file_size > LARGEST_MANIFEST:
        _damaged(path, f"{MANIFEST} is too large")
    try:
        text = json.loads(archive.read(MANIFEST))
        made = text["format"]
        if made != FORMAT:
            raise SetupError(
                f"{path} is a bundle of format {made!r}, and this Strata reads format {FORMAT}: "
                "unpack the clone that is in it (python3 FILE FOLDER), or make the bundle again."
            )
        manifest = parse(text)
    except (KeyError, TypeError, ValueError, AttributeError):
        _damaged(path, f"{MANIFEST} is not in its format")
    if sorted(names) != sorted([MANIFEST, *manifest.files]):
        _damaged(path, f"its files are not those of {MANIFEST}")
    return manifest


def parse(text: Mapping[str, Any]) -> Manifest:
    """Return a manifest from its JSON; KeyError, TypeError or ValueError where that is not in the format."""
    files = {
        str(name): Entry(int(one["size"]), str(one["sha256"]), bool(one.get("program", False)))
        for name, one in text["files"].items()
    }
    targets = tuple(
        Target(
            system=str(one["system"]),
            python=str(one["python"]),
            packages=str(one["packages"]),
            wheels=tuple(map(str, one["wheels"])),
            lacks=tuple(map(str, one["lacks"])),
        )
        for one in text["targets"]
    )
    for target in targets:
        if any(WHEELS + wheel not in files for wheel in target.wheels) or not re.fullmatch(
            r"\d+\.\d+", target.python
        ):
            raise ValueError(str(target))
    return Manifest(str(text["commit"]), targets, files)


def inside(name: str) -> bool:
    """Return whether a file of that name lies below the folder it is unpacked into, on every system."""
    parts = name.split("/")
    return not ODD.search(name) and not {"", ".", ".."} & set(parts) and not PurePosixPath(name).is_absolute()


def _chunks(path: Path, archive: zipfile.ZipFile, name: str, entry: Entry) -> Iterator[bytes]:
    """Yield the bytes of one file; raise SetupError in place of the last of them if they are not those packed."""
    digest, size, held = hashlib.sha256(), 0, b""
    with archive.open(name) as stream:
        while size <= entry.size and (chunk := stream.read(CHUNK_BYTES)):
            digest.update(chunk)
            size += len(chunk)
            if held:
                yield held
            held = chunk
    if (size, digest.hexdigest()) != (entry.size, entry.sha256):
        _damaged(path, f"{name} was changed")
    yield held


def free_bytes(folder: Path) -> int | None:
    """Return how much can be written at a place that need not exist yet; None where nobody can tell."""
    above = next((one for one in (folder, *folder.absolute().parents) if one.exists()), None)
    try:
        return shutil.disk_usage(above).free if above else None
    except OSError:
        return None


def need_room(folder: Path, size: int) -> None:
    """Raise SetupError where `size` bytes do not fit."""
    free = free_bytes(folder)
    if free is not None and free < size:
        raise SetupError(
            f"{folder} has {free / 1e6:.0f} MB of room and {size / 1e6:.0f} MB are needed: make room, "
            "or choose another place."
        )


def umask() -> int:
    """Return the bits that a new file or folder does not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
