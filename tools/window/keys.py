"""The keys of the window of `strata run N`, and what is said of them."""

from __future__ import annotations

from typing import Any

from common.settings import flat, replaced, set_live
from common.view.inputs import KEYS, Action
from tools.panel import imgui

HELP = (
    "Drag to look, W A S D 1 2 to move, shift to be faster, U to level, wheel to come nearer, "
    "C to change between flying and orbiting, space to stop and go on with time, R to freeze the picture and compare "
    "with it, F for the FLIP error, K to freeze culling from chapter 6 on, Esc to close."
)
"""The keys and what they do."""


def panel_help() -> str:
    """Return what to say about the panel: its keys, or how to get it. Loads the package, as opening the panel does."""
    if imgui.load() is None:
        return "For a panel with every setting: ./strata --extras (the package imgui-bundle)."
    return "F1 or Tab shows and hides the panel."


def freeze_culling(settings: Any) -> bool:
    """Let culling keep its view, or follow the camera again; return whether the chapter of these settings culls."""
    frozen = flat(settings).get("culling_frozen")
    return frozen is not None and set_live(settings, replaced(settings, culling_frozen=not frozen))


BINDINGS = {**{key: action for key, action in KEYS.items() if key != "SPACE"}, "U": Action.RESET_UP}
"""The camera's keys. Space, which levels the camera elsewhere, is what stops time in every player."""
