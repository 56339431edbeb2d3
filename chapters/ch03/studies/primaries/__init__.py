"""Study: several primary command buffers in one submission, recorded at the same time, drawn in the array's order."""

from __future__ import annotations

from dataclasses import dataclass

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="primaries",
    idea="A submission is an array of primary command buffers: their order there counts, not that of recording.",
    order=1,
    features=("recording/primary-and-secondary",),
)

SQUARES = 24
"""Half transparent squares that lie over one another: in another order they are another picture."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    primaries: int = knob(4, "primary buffers that share the squares", minimum=1, maximum=SQUARES)
    threads: int = knob(2, "threads that record beside the renderer's own", minimum=0, maximum=16)
    order: str = knob("array", "how the array is filled", choices=("array", "reversed"))


SHADERS = ("studies/primaries/squares.vert", "studies/primaries/squares.frag")
