"""What a pass does to its attachments, from a few flags: a table of load, store and layouts (pure, no graphics API).

Flags say what a pass is among all that draw to its target. Layouts are named as states are in
`backends.vulkan.barriers`. The idea is that of the 3D Graphics Rendering Cookbook (chapters 3 and 7). Two things are
different here: what begins undefined and is not cleared is not loaded either, which Vulkan forbids; and
contradictions are refused.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Literal


class Flag(enum.Flag):
    """What a pass is."""

    NONE = 0
    FIRST = enum.auto()  # nothing has been drawn to the target in this frame
    LAST = enum.auto()  # the picture is copied to a file or a window afterwards
    OFFSCREEN = enum.auto()  # shaders read the target afterwards
    INTERNAL = enum.auto()  # goes on in a target that was ready for shaders, and keeps what is there
    CLEAR_COLOR = enum.auto()
    CLEAR_DEPTH = enum.auto()


@dataclass(frozen=True)
class Use:
    """What happens to an attachment: when the pass begins, when it ends, and its state before and after."""

    load: Literal["load", "clear", "dont_care"]
    store: Literal["store", "dont_care"]
    initial: str
    final: str


def uses(flags: Flag) -> tuple[Use, Use]:
    """Return what a pass does to its colour and to its depth; ValueError for flags that contradict one another."""
    if Flag.FIRST in flags and Flag.INTERNAL in flags:
        raise ValueError("the first pass to a target has nothing to go on from")
    if Flag.LAST in flags and flags & (Flag.OFFSCREEN | Flag.INTERNAL):
        raise ValueError("a target is left for copies or for shaders, not for both")
    return _color(flags), _depth(flags)


def _load(flags: Flag, clear: Flag) -> Literal["load", "clear", "dont_care"]:
    if Flag.INTERNAL in flags:
        return "load"
    if clear in flags:
        return "clear"
    return "dont_care" if Flag.FIRST in flags else "load"


def _color(flags: Flag) -> Use:
    initial = "undefined" if Flag.FIRST in flags else "sampled" if Flag.INTERNAL in flags else "color"
    final = "copy_source" if Flag.LAST in flags else "sampled" if Flag.OFFSCREEN in flags else "color"
    return Use(_load(flags, Flag.CLEAR_COLOR), "store", initial, final)


def _depth(flags: Flag) -> Use:
    load = _load(flags, Flag.CLEAR_DEPTH)
    # Only depth tests read depth here, and none comes after the last pass: depth need not reach memory at all.
    store: Literal["store", "dont_care"] = "dont_care" if Flag.LAST in flags else "store"
    return Use(load, store, "depth" if load == "load" else "undefined", "depth")
