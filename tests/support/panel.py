"""A user at the panel without a window, and the list that it draws, recorded: `python -m tests.support.panel`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from backends.contract import Choice, Plan
from backends.gl.context import Context
from backends.vulkan.device import Device
from backends.window import Event
from common.view.draw_lists import TextureUpdate, save
from tests.support.draw_lists import on_gl, on_vulkan
from tools.panel.panel import Panel, PanelActions, PanelState, open_panel

RECORDED = Path(__file__).with_name("panel.npz")
"""A panel's draw list with all its glyphs, for machines without the package that makes such lists."""

SIZE = (640, 720)


class PanelUser:
    """Somebody with a mouse and a keyboard, in front of a panel that shows `state` and does what it is asked."""

    def __init__(self, panel: Panel, state: PanelState, size: tuple[int, int] = SIZE) -> None:
        self.panel, self.state, self.size = panel, state, size
        self.updates: list[TextureUpdate] = []
        self.wait()

    def frame(self, *events: Event) -> PanelActions:
        """Let events happen and the panel be drawn once; return what it asks for."""
        for event in events:
            self.panel.event(event)
        actions = self.panel.frame(self.state, self.size, 1 / 60)
        assert self.panel.drawn is not None
        self.panel.drawn.check()
        self.updates += self.panel.drawn.updates
        return actions

    def wait(self, frames: int = 4) -> list[PanelActions]:
        """Return what the panel asks for in some frames in which nothing happens."""
        return [actions for _ in range(frames) if (actions := self.frame())]

    def place(self, name: str, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
        """Return a place in a widget, in fractions of its width and height."""
        left, top, right, bottom = self.panel.places[name]
        return left + x * (right - left), top + y * (bottom - top)

    def click(self, x: float, y: float, button: int = 0) -> list[PanelActions]:
        """Press and release a button at a pixel; return what the panel asks for."""
        found = [self.frame(Event("move", x, y)), self.frame()]
        for down in (True, False):
            found += [self.frame(Event("button", button=button, down=down)), self.frame()]
        return [actions for actions in [*found, *self.wait()] if actions]

    def drag(
        self, start: tuple[float, float], end: tuple[float, float]
    ) -> tuple[list[PanelActions], list[PanelActions]]:
        """Drag from one pixel to another; return what the panel asks for on the way, and after the release."""
        self.frame(Event("move", *start))
        found = [self.frame(Event("button", down=True))]
        for step in range(1, 5):
            part = step / 4
            place = [a + part * (b - a) for a, b in zip(start, end, strict=True)]
            found += [self.frame(Event("move", *place)), self.frame()]
        on_the_way = [actions for actions in [*found, *self.wait()] if actions]
        after = [self.frame(Event("button", down=False)), *self.wait()]
        return on_the_way, [actions for actions in after if actions]

    def choose(self, name: str, index: int, count: int) -> list[PanelActions]:
        """Open a combo of `count` entries and take one; return what the panel asks for."""
        before = list(self.panel.interface._areas)
        assert not self.click(*self.place(name, 0.2))
        (popup,) = [area for area in self.panel.interface._areas if area not in before]
        left, top, right, bottom = popup
        return self.click((left + right) / 2, top + (index + 0.5) / count * (bottom - top))

    def type(self, text: str, *keys: str) -> list[PanelActions]:
        """Type a text, then press and release keys; return what the panel asks for."""
        found = [self.frame(Event("text", name=letter)) for letter in text]
        for key in keys:
            found += [self.frame(Event("key", name=key, down=True)), self.frame(Event("key", name=key))]
        return [actions for actions in [*found, *self.wait()] if actions]


def example(settings: Any, **more: Any) -> PanelState:
    """Return a state with something in every part."""
    plan = Plan((Choice("anisotropy", True, "anisotropic texture filtering", "the device has it"),))
    shown = {"plan": plan, "device": "a device", "work": {"draws": 12, "triangles": 3456789}}
    return PanelState(settings, **{**shown, "camera": "1,2,3:0,0,0:50", **more})


def seen(user: PanelUser, vulkan: Device, opengl: Context) -> list[np.ndarray]:
    """Return what each backend shows of the panel over grey, (H, W, 4) uint8."""
    assert user.panel.drawn is not None
    drawn = replace(user.panel.drawn, updates=tuple(user.updates))
    grey = np.full((user.size[1], user.size[0], 4), (90, 110, 130, 255), np.uint8)
    return [*on_vulkan(vulkan, [drawn], grey), *on_gl(opengl, [drawn], grey)]


def record() -> None:
    """Write `RECORDED` anew, with the first chapter's settings."""
    first = chapters.available()[0]
    settings = chapters.settings_class(first)()
    panel = open_panel()
    assert panel is not None, "the extra ui is not installed"
    for number in range(60):
        panel.history.add({"forward": 3 + number % 7, "tonemap": 1.5})
    user = PanelUser(
        panel, example(settings, message=f"wrote out/{chapters.folder_name(first)}.png", frame_rate=60.0)
    )
    assert panel.drawn is not None
    save(RECORDED, replace(panel.drawn, updates=tuple(user.updates)))
    panel.close()


if __name__ == "__main__":
    record()
