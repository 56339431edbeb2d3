"""The panel's section on a frozen picture: the wipe between it and the live one, and how far they are apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ReferenceState:
    """What is known of the frozen picture; `wipe` is the share of the window, from the left, that shows it.

    `largest` is the greatest difference of 255 codes, `changed` the share of pixels with any, `flip` the mean of FLIP.
    They are None before they are measured. `said` is a sentence in place of them.
    """

    frozen: bool = False
    time: float = 0.0
    wipe: float = 0.5
    largest: int | None = None
    changed: float | None = None
    flip: float | None = None
    said: str = ""


class ReferenceSection:
    """The widgets. Moving the handle counts at once: nothing is drawn anew for it but the window."""

    def __init__(self, imgui: Any, placed: Callable[[str], None]) -> None:
        self._imgui, self._placed = imgui, placed

    def build(self, state: ReferenceState) -> dict[str, Any]:
        """Show the section; return what the user wants, by the names of `PanelActions`."""
        imgui = self._imgui
        actions: dict[str, Any] = {}
        if imgui.button("freeze (R)"):
            actions["freeze"] = True
        self._placed("freeze")
        imgui.set_item_tooltip("Keeps this picture, to compare what you change with it.")
        if not state.frozen:
            return actions
        imgui.same_line()
        if imgui.button("let go"):
            actions["freeze"] = False
        self._placed("let go")
        imgui.same_line()
        if imgui.button("FLIP (F)"):
            actions["flip"] = True
        self._placed("flip")
        imgui.set_item_tooltip("Measures the difference that a viewer sees. It takes a moment.")
        changed, wipe = imgui.slider_float(
            "wipe", state.wipe, 0.0, 1.0, "%.2f", imgui.SliderFlags_.always_clamp
        )
        self._placed("wipe")
        imgui.set_item_tooltip("Left of the line is the frozen picture, right of it the live one.")
        if changed:
            actions["wipe"] = float(min(max(wipe, 0.0), 1.0))
        imgui.text(f"frozen at {state.time:.2f} s")
        if state.said:
            imgui.text_wrapped(state.said)
        elif state.largest is not None and state.changed is not None:
            imgui.text(f"largest difference {state.largest} of 255")
            imgui.text(f"{state.changed:.2%} of the pixels differ")
            if state.flip is not None:
                imgui.text(f"FLIP {state.flip:.4f}")
        return actions

    def line(self, state: ReferenceState, size: tuple[int, int], scale: float) -> None:
        """Draw the line between the two pictures, below the panel."""
        x = round(state.wipe * size[0])
        lines = self._imgui.get_background_draw_list()
        lines.add_line((x, 0.0), (x, float(size[1])), 0xD0FFFFFF, 1.5 * scale)
