"""Files of assets that were named on a system which does not tell large letters from small ones."""

from __future__ import annotations

import os
import re
import unicodedata
from contextlib import suppress
from functools import cache
from pathlib import Path

from common.files.regular_files import leads_outside


def as_typed(name: str) -> str:
    """Return a file name as an asset has it with "/" between its parts, and without parts that lead nowhere."""
    parts: list[str] = []
    for part in name.replace("\\", "/").split("/"):
        if part == ".." and parts and parts[-1] != "..":
            parts.pop()
        elif part not in ("", "."):
            parts.append(part)
    return "/".join(parts)


def leads_out(name: str) -> bool:
    """Whether a name as an asset has it begins at a root or a drive, or climbs out of its folder."""
    absolute = name.startswith(("/", "\\")) or re.match("[A-Za-z]:", name) is not None
    return absolute or as_typed(name).split("/")[0] == ".."


class Finder:
    """Finds files below a folder by names as they stand in assets. Folders are listed once, so files must not move."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._listed = cache(_listed)

    def find(self, name: str) -> Path | None:
        """Return the file that a relative name means, or None where there is none in the folder or below it.

        A file of exactly that name is taken before all others, whose letters may be large where the name's are small
        and accents composed in another way (macOS takes them apart); of several the first by name. A file outside the
        folder, by a drive, a "..", or a link that leads there, is none.
        """
        typed = as_typed(name)
        if not typed or leads_out(name) or "\0" in name:
            return None
        with suppress(OSError, RuntimeError):  # folders that cannot be read, and links in a circle
            return self._find(self.folder, typed.split("/"))
        return None

    def _find(self, folder: Path, parts: list[str]) -> Path | None:
        for entry in self._candidates(folder, parts[0]):
            path = folder / entry
            if len(parts) > 1:
                repaired = self._find(path, parts[1:]) if path.is_dir() else None
                if repaired is not None:
                    return repaired
            elif path.is_file() and not leads_outside(path, self.folder):
                return path
        return None

    def _candidates(self, folder: Path, name: str) -> list[str]:
        if name == "..":
            return []
        names = self._listed(folder).get(_folded(name), [])
        return [name] * (name in names) + [other for other in names if other != name]


def _listed(folder: Path) -> dict[str, list[str]]:
    """Return the sorted names of the entries of a folder by what `_folded` makes of them."""
    by_folded: dict[str, list[str]] = {}
    with suppress(OSError):
        for name in sorted(os.listdir(folder)):
            by_folded.setdefault(_folded(name), []).append(name)
    return by_folded


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
