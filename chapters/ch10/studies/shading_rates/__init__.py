"""Study: one invocation for several pixels, because the draw says so, or because each primitive does.

A draw has a rate: in the state of its pipeline, or set before the draw where that state is dynamic. A vertex or mesh
shader can write another rate for each primitive. Two combiners decide what becomes of them: the first combines the
rate of the draw with that of the primitive, the second the result with that of an image. By default both keep what
they have, so a rate that a shader writes changes nothing until the first combiner replaces (--set combiner=keep).

The picture has two draws of cells, one above the other. With a rate by draw, the lower draw has it; with a rate by
primitive, every second cell of both. Rings are evaluated where the invocation lies, and the colour is that of the
rate which the fragment shader finds. Coverage stays per pixel: the edges of cells do not change.

The GPU counts the invocations of each draw (pipeline statistics), and fragments count themselves for each cell.
Invocations whose pixels belong to two triangles run for both of them: along a diagonal of a cell nothing is saved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.errors import UserError
from common.lessons import Study
from common.settings import knob

from ...rates.model import LONGEST, decode, encode

STUDY = Study(
    title="shading rates",
    idea="A draw or a primitive chooses how many pixels an invocation covers, and a combiner which of them decides.",
    order=1,
    features=("vrs/per-draw-rate", "vrs/per-primitive-rate"),
)

COLUMNS, ROWS = 8, 6
"""Cells of the picture; each draw has half of the rows."""

FOLDER = "studies/shading_rates"
BY_PRIMITIVE = ("vertex", "mesh")
"""Sources of a rate for each primitive."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    source: str = knob(
        "pipeline",
        "what has the rate: nothing, the state of a pipeline, a command before the draw, or each primitive, by a "
        "vertex or a mesh shader",
        choices=("none", "pipeline", "dynamic", *BY_PRIMITIVE),
    )
    rate: str = knob(
        "2x2",
        "pixels of an invocation, across and down",
        choices=("1x1", "1x2", "2x1", "2x2", "2x4", "4x2", "4x4"),
    )
    combiner: str = knob(
        "replace",
        "with source=vertex or mesh: whether the rate of a primitive replaces that of its draw, or the draw keeps its "
        "own",
        choices=("replace", "keep"),
    )


@dataclass
class RateWork(Work):
    """What a frame did: cells that were drawn, and their pixels."""

    cells: int = 0
    pixels: int = 0


def code_of(settings: Settings) -> int:
    """Return the code of the rate."""
    width, height = map(int, settings.rate.split("x"))
    return encode(width, height)


def side_of(size: tuple[int, int]) -> int:
    """Return the side of a cell in pixels: whole blocks of the coarsest rate, so a block never lies in two cells.

    Raises UserError for a picture that has no room for the cells.
    """
    side = min(size[0] // COLUMNS, size[1] // ROWS) // LONGEST * LONGEST
    if side < LONGEST:
        least = f"{COLUMNS * LONGEST}x{ROWS * LONGEST}"
        raise UserError(
            f"The study shading-rates has {COLUMNS}x{ROWS} cells: it takes {least} pixels or more."
        )
    return side


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders."""
    return (
        ("COLUMNS", COLUMNS),
        ("ROWS", ROWS),
        ("BY_PRIMITIVE", int(settings.source in BY_PRIMITIVE)),
    )


def shaders(settings: Settings) -> tuple[str, str]:
    """Return the shaders of both draws."""
    return (f"{FOLDER}/cell.{'mesh' if settings.source == 'mesh' else 'vert'}", f"{FOLDER}/rings.frag")


def push(settings: Settings, size: tuple[int, int], first: int) -> NDArray[np.uint32]:
    """Return the push constants of the draw whose first cell is `first`, (8,) uint32."""
    return np.array([*size, side_of(size), 0, first, code_of(settings), 0, 0], np.uint32)


def told(fragments: NDArray[np.uint64], counts: NDArray[np.uint32]) -> dict[str, int]:
    """Return counters of a frame: the GPU's own of each draw, and what the fragments counted of all cells."""
    upper, lower = fragments.tolist()
    return {"fragments_upper": upper, "fragments_lower": lower, "fragments": int(counts.sum())}


def names_of(sizes: list[tuple[int, int]]) -> str:
    """Return rates in words, from the finest on."""
    codes = sorted({encode(*size) for size in sizes if max(size) <= LONGEST})
    return ", ".join("{}x{}".format(*decode(code)) for code in codes)
