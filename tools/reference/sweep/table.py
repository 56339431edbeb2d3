"""The table of a sweep: a row for each reference, as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from common.errors import UserError
from common.paths import write_whole

COLUMNS = (
    *(
        "file",
        "chapter",
        "scene",
        "environment",
        "camera",
        "size",
        "time",
        "ev100",
        "filter",
        "seed",
        "settings",
    ),
    *("error_asked", "error_estimated", "paths", "paths_left_out", "seconds", "devices", "note"),
)
"""What a row has. `seconds` are those in which this run traced it; `paths_left_out` had light that was no number."""

MIXED = "mixed: bits depend on which worker took which part"
"""The note on a reference of several devices."""


def write_table(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows, dicts by COLUMNS, whole or not at all. Raises UserError."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    try:
        write_whole(path, stream.getvalue().encode())
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None
