"""Study: a frame as an ordered list. Each item is enabled or not, and draws on what those before it have left.

Most renderers begin like this: a list of items that are drawn one over the other. An item may draw to a target of its
own, which a later item reads; all other items draw to the screen's pass. An item that is disabled records no commands
and costs nothing.

The list does not know which item reads which target. Here the item "inset" reads the target of "map". They are disabled
together because the programmer remembered it, they are in this order because the programmer wrote it, and the barriers
between them are right until a line is moved. The chapter's frame graph derives all three from the declared reads and
writes of each item.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="ordered layers",
    idea="A frame can be a list: each enabled item draws over those before it, to the screen unless it has a target.",
    order=6,
    features=("composition/ordered-layers",),
)

SCREEN = ""
"""The output of an item that has none of its own."""


@dataclass(frozen=True)
class Item:
    """A layer: its name, its number in layer.frag, where it draws to, and which target it reads."""

    name: str
    number: int
    enabled: bool = True
    output: str = SCREEN
    reads: str = ""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    sky: bool = knob(True, "draw the sky")
    sun: bool = knob(True, "draw the sun")
    hills: bool = knob(True, "draw the hills")
    mist: bool = knob(True, "draw the mist, which hides half of what is behind it")
    inset: bool = knob(True, "draw a map to a target of its own, and show it in a corner")
    merge: bool = knob(False, "let neighbours in the list share one pass, if they draw to the same target")


@dataclass
class LayerWork(Work):
    """What a frame did: `passes` were begun, the one that clears the screen included."""

    passes: int = 0


CLEAR = (0.1, 0.1, 0.12, 1.0)
SHADERS = ("post/fullscreen.vert", "studies/ordered_layers/layer.frag")


def items(settings: Settings) -> list[Item]:
    """Return the frame, from back to front."""
    return [
        Item("sky", 0, settings.sky),
        Item("sun", 1, settings.sun),
        Item("map", 4, settings.inset, output="map"),
        Item("hills", 2, settings.hills),
        Item("mist", 3, settings.mist),
        Item("inset", 5, settings.inset, reads="map"),
    ]


def defines(item: Item) -> tuple[tuple[str, int], ...]:
    """Return what the shader of an item is told."""
    return (("LAYER", item.number), ("READS", int(item.reads != "")))


def passes_of(listed: Sequence[Item], merge: bool) -> list[tuple[str, list[Item]]]:
    """Return the passes of a frame in order, each with its target and the items that draw in it.

    The first clears the screen and may have no item: a frame without any is an empty picture, not the one before.
    """
    passes: list[tuple[str, list[Item]]] = [(SCREEN, [])]
    for item in listed:
        if not item.enabled:
            continue
        if not merge or passes[-1][0] != item.output:
            passes.append((item.output, []))
        passes[-1][1].append(item)
    return passes
