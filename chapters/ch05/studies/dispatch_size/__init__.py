"""Study: how many work groups cover a picture, what the last groups do outside of it, and what happens without a check.

A dispatch takes the number of *groups* to start; the shader declares the invocations of a group. So the size of the
picture is divided by that of a group, and rounded *up*: rounded down, the last columns are left out. Without the
division, a picture of 61x37 starts 61x37 groups of 64 invocations. Hardly any of them has work, but all cost time.

Rounded up, the last groups reach over the edge. The kernel must check whether its place exists. An image would drop
stores outside of it. A buffer has no rows, and a store right of one row lands at the left of the next. Here every
invocation adds one at its place, and the picture shows the counts. Places that were reached once have the colour of
their group. Black places were never reached, white ones several times. Grey are invocations outside of the picture.

The shape of a group costs as well. GPUs run 32 or 64 invocations in step: a group of one leaves all others idle. With
`repeat`, a frame takes long enough for `-v` to show it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.errors import UserError
from common.lessons import Study
from common.settings import knob

from ...frames.dispatches import group_count

STUDY = Study(
    title="dispatch size",
    idea="Size over group, rounded up, covers everything, and invocations over the edge must ask before they write.",
    order=5,
    features=("compute/dispatch-sizing",),
)

LOCALS = ("1x1", "8x1", "64x1", "4x4", "8x8", "16x16", "32x8")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    width: int = knob(61, "columns to cover", minimum=1, maximum=4096)
    height: int = knob(37, "rows to cover", minimum=1, maximum=4096)
    local: str = knob("8x8", "invocations of a work group", choices=LOCALS)
    groups: str = knob(
        "up", "size over group, rounded; or as if groups were invocations", choices=("up", "down", "size")
    )
    guard: bool = knob(True, "let the kernel ask whether its place exists")
    repeat: int = knob(1, "dispatches in a frame, one after the other", minimum=1, maximum=1000)


@dataclass
class DispatchWork(Work):
    """What a frame did, in one dispatch: `idle` invocations had no place in the picture."""

    groups: int = 0
    invocations: int = 0
    idle: int = 0


KERNEL = "studies/dispatch_size/cover.comp"
SHADERS = ("post/fullscreen.vert", "studies/dispatch_size/show.frag")
MOST = 1 << 32
"""Most invocations of a frame: a second or two of a GPU; systems wait for little longer."""

SPARE = 1 << 20
"""Most counted places after the end: without a guard they are written, too."""


def local_size(settings: Settings) -> tuple[int, int]:
    """Return the invocations of a group along x and y."""
    x, _, y = settings.local.partition("x")
    return int(x), int(y)


def groups_of(settings: Settings) -> tuple[int, int]:
    """Return the number of groups along x and y."""
    size, local = (settings.width, settings.height), local_size(settings)
    if settings.groups == "size":
        return size
    if settings.groups == "down":
        return size[0] // local[0], size[1] // local[1]
    return group_count(size, (*local, 1))[:2]


def launched(settings: Settings) -> tuple[int, int]:
    """Return the columns and rows of invocations."""
    groups, local = groups_of(settings), local_size(settings)
    return groups[0] * local[0], groups[1] * local[1]


def check(settings: Settings) -> None:
    """Raise UserError for frames so long that a system would take the GPU for hung."""
    columns, rows = launched(settings)
    total = columns * rows * settings.repeat
    if total > MOST:
        raise UserError(
            f"A frame of {total:,} invocations may take so long that the system ends it: take at most {MOST:,}, with a "
            "smaller width, height or repeat."
        )


def work_of(settings: Settings) -> DispatchWork:
    """Return what a frame does; it is known in advance."""
    groups, (columns, rows) = groups_of(settings), launched(settings)
    inside = min(columns, settings.width) * min(rows, settings.height)
    return DispatchWork(1, 1, groups[0] * groups[1], columns * rows, columns * rows - inside)


def room(settings: Settings) -> int:
    """Return the number of counters: the places of the picture, and some after the last one."""
    columns, rows = launched(settings)
    last = max(0, rows - 1) * settings.width + columns
    return settings.width * settings.height + min(max(0, last - settings.width * settings.height), SPARE)


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the macros of the kernel."""
    x, y = local_size(settings)
    return (("LOCAL_X", x), ("LOCAL_Y", y), ("GUARD", int(settings.guard)))


def push(settings: Settings, picture: tuple[int, int]) -> np.ndarray:
    """Return the push constants of kernel and draw, (8,) uint32."""
    counted = [settings.width, settings.height, *local_size(settings)]
    return np.array([*counted, *launched(settings), *picture], np.uint32)
