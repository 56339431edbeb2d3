"""What the user does, by keyboard, mouse and wheel: a window translates its events into this."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Flag, auto
from functools import reduce
from operator import or_


class Action(Flag):
    """What a camera can be asked to do."""

    FORWARD = auto()
    BACK = auto()
    LEFT = auto()
    RIGHT = auto()
    UP = auto()
    DOWN = auto()
    FAST = auto()
    RESET_UP = auto()


NOTHING = Action(0)


KEYS: Mapping[str, Action] = {
    "W": Action.FORWARD,
    "S": Action.BACK,
    "A": Action.LEFT,
    "D": Action.RIGHT,
    "1": Action.UP,
    "2": Action.DOWN,
    "SHIFT": Action.FAST,
    "LEFT_SHIFT": Action.FAST,
    "RIGHT_SHIFT": Action.FAST,
    "SPACE": Action.RESET_UP,
}
"""The bindings, by the name of the key as it is printed on it."""


@dataclass
class Inputs:
    """The state of keyboard and mouse. `mouse` is in fractions of the window, (0, 0) at its top left.

    `dragging` is whether the button is down; `scroll` counts wheel steps since it was last taken, up
    positive.
    """

    mouse: tuple[float, float] = (0.5, 0.5)
    dragging: bool = False
    scroll: float = 0.0
    bindings: Mapping[str, Action] = field(default_factory=lambda: KEYS)
    actions: Action = NOTHING  # of all held keys
    _held: set[str] = field(default_factory=set)

    def key(self, name: str, pressed: bool) -> bool:
        """Note that a key went down or up; return whether it is bound to anything."""
        if name not in self.bindings:
            return False
        if pressed:
            self._held.add(name)
        else:
            self._held.discard(name)
        self.actions = reduce(or_, (self.bindings[key] for key in self._held), NOTHING)
        return True

    def take_scroll(self) -> float:
        """Return the wheel steps since the last call."""
        steps, self.scroll = self.scroll, 0.0
        return steps

    def release_all(self) -> None:
        """Forget every key and button: the window lost the focus and will not hear of their release."""
        self._held.clear()
        self.actions = NOTHING
        self.dragging = False
