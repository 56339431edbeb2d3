"""The records of `strata bench` that the site shows, and those that it cannot read, each with why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import chapters
from common.errors import UserError
from tools.bench import bench
from tools.site.draft import Draft

NEEDED = ("chapter", "commit", "date", "device", "points", "size")
"""What every page says of a record."""


def records_of(number: int) -> dict[str, dict[str, Any]]:
    """Return the records of a chapter by the name of their file, those of software first.

    Left out are records without presets in them, of other parts alone, and what `unreadable` has.
    """
    found = {}
    for path in _files(number):
        made, why = _read(path)
        if made is not None and not why and made["points"]:
            found[path.name] = made
    return dict(sorted(found.items(), key=lambda item: item[1]["device"]["class"] != "software"))


def unreadable(number: int) -> dict[str, str]:
    """Return why a file that should be a record of the chapter is none, by its name, as the end of a sentence."""
    return {path.name: why for path in _files(number) for _, why in [_read(path)] if why}


def lacks(draft: Draft, page: str, number: int) -> str:
    """Say which records of a chapter a page cannot show, and return the sentences for it; "" where it shows all."""
    said = [
        draft.lack(page, f"what {name} measured, since {why}.") for name, why in unreadable(number).items()
    ]
    return "\n\n".join(said)


def _files(number: int) -> list[Path]:
    return sorted(bench.FOLDER.glob(f"{chapters.folder_name(number)}-*.json"))


def _read(path: Path) -> tuple[dict[str, Any] | None, str]:
    """Return a record and "", or what is wrong with it; neither for what another program measured, without a format."""
    try:
        made = bench.read_object(path)
        if "format" not in made:
            return None, ""
        made = bench.read_record(path)
    except UserError as error:
        return None, str(error).replace(str(path), "it", 1).rstrip(".")
    if missing := [name for name in NEEDED if name not in made]:
        return None, f"it has no {missing[0]}"
    device = made["device"]
    if not isinstance(device, dict) or not {"name", "class", "driver"} <= {*device}:
        return None, "it does not say of which device it is"
    return (made, "") if isinstance(made["points"], list) else (None, "its points are no list")
