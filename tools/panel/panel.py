"""The panel in the window of `strata run N`: knobs, times, nodes, work, plan, camera and time of whatever chapter runs.

It knows neither backend nor window: `PanelState` says what is, `PanelActions` what the user wants changed, and
`Panel.drawn` is the picture of it, for the backend's own renderer of draw lists. It needs the extra `ui`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from backends.window import Event
from common.scene import Scene
from common.settings import flat, preset, replaced
from common.view.draw_lists import DrawList
from tools.panel import imgui as panel_imgui
from tools.panel.error import show_error
from tools.panel.graph import GraphSection, GraphState
from tools.panel.knobs import Knobs, Widget, widgets
from tools.panel.reference import ReferenceSection, ReferenceState
from tools.panel.tree import Tree

if TYPE_CHECKING:
    from backends.contract import Plan

KEPT = 200
"""Frames whose times are shown."""

WIDTH = 400.0
TIMES_WIDTH = 260.0
"""Of the times in a window of their own; in a narrower window they are a section of the panel."""
EV_RANGE = 8.0
SPEEDS = (0.05, 20.0)

Mode = Literal["first person", "orbit"]
MODES: tuple[Mode, ...] = ("first person", "orbit")

_COLORS = (0xFF5DC0FF, 0xFFFFB35D, 0xFF7DE37D, 0xFFC98CFF, 0xFF6E6EFF, 0xFFE6E66E, 0xFFB0B0B0)
"""Of the lines of passes, as ImGui packs colours: 0xAABBGGRR."""


@dataclass(frozen=True)
class PanelState:
    """What the panel shows. `camera` is the view as text for --camera, "" where it has none."""

    settings: Any
    plan: Plan | None = None
    scene: Scene | None = None
    device: str = ""
    quality: str = ""  # how the preset was chosen
    frame_rate: float = 0.0  # frames per second, 0 while nothing moves
    work: Mapping[str, int] = field(default_factory=dict)
    mode: Mode = "orbit"
    camera: str = ""
    ev_offset: float = 0.0
    time: float = 0.0
    paused: bool = False
    speed: float = 1.0
    message: str = ""  # what came of the last action
    error: str = ""  # what is wrong with a shader that is being edited
    passes: tuple[str, ...] = ()
    stop_after: str = ""  # the pass whose output is shown, "" for the finished picture
    stopped: str = ""  # what that is, in words
    graph: GraphState | None = None  # before chapter 4 there is none
    reference: ReferenceState = field(default_factory=ReferenceState)
    explained: Mapping[str, str] = field(default_factory=dict)  # of a knob: the part of a README


@dataclass(frozen=True)
class PanelActions:
    """What the user wants changed; None and False change nothing. `settings` is a whole new settings object."""

    settings: Any = None
    mode: Mode | None = None
    ev_offset: float | None = None
    paused: bool | None = None
    speed: float | None = None
    step: bool = False  # one frame further while time stands still
    screenshot: bool = False
    stop_after: str | None = None  # "": after none
    switch: tuple[str, bool] | None = None  # a pass on or off
    show: str | None = None  # a resource of the graph, "": the finished picture
    copy: str = ""  # text for the clipboard
    freeze: bool | None = None  # True: keep this picture to compare with, False: forget it
    wipe: float | None = None  # the share of the window that shows the frozen picture
    flip: bool = False  # measure FLIP against the frozen picture
    read: str = ""  # the knob whose part of a README is wanted

    def __bool__(self) -> bool:
        """Whether there is anything to do."""
        return self != PanelActions()


class History:
    """The last values of several series that grow together; a series that is missing in a frame has a gap there."""

    def __init__(self, kept: int = KEPT) -> None:
        self._columns: dict[str, int] = {}
        self._values = np.full((kept, 0), np.nan)  # the newest in the last row; NaN where nothing was

    def add(self, values: Mapping[str, float]) -> None:
        """Note one frame."""
        for name in values:
            self._columns.setdefault(name, len(self._columns))
        missing = len(self._columns) - self._values.shape[1]
        if missing:
            self._values = np.pad(self._values, ((0, 0), (0, missing)), constant_values=np.nan)
        self._values[:-1] = self._values[1:]
        self._values[-1] = [values.get(name, np.nan) for name in self._columns]

    def names(self) -> list[str]:
        """Return the series in the order in which they first came."""
        return list(self._columns)

    def median(self, name: str) -> float:
        """Return the median of a series without its gaps, NaN if it has nothing else."""
        values = self._values[:, self._columns[name]]
        values = values[np.isfinite(values)]
        return float(np.median(values)) if values.size else math.nan

    def points(self, name: str, low: float, high: float) -> np.ndarray:
        """Return (M, 2) of a series without its gaps in the unit square: the newest at x = 1, `low` at y = 0."""
        values = self._values[:, self._columns[name]]
        inside = np.isfinite(values)
        x = np.linspace(0.0, 1.0, len(values))[inside]
        return np.stack([x, np.clip((values[inside] - low) / (high - low), 0.0, 1.0)], -1)

    def limits(self) -> tuple[float, float]:
        """Return low < high that hold every value and 0; (0, 1) where there is nothing but zeros."""
        values = self._values[np.isfinite(self._values)]
        low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
        return (low, high) if low < high else (0.0, 1.0)


def preset_of(settings: Any) -> str:
    """Return the preset whose values these settings have, "" if none has."""
    for name in getattr(type(settings), "PRESETS", {}):
        if preset(type(settings), name) == settings:
            return str(name)
    return ""


def open_panel(scale: float = 1.0) -> Panel | None:
    """Return a panel, or None where the extra `ui` is not installed."""
    imgui = panel_imgui.load()
    return None if imgui is None else Panel(imgui, scale)


class Panel:
    """The widgets. `places` holds where each was last, as (left, top, right, bottom) in pixels."""

    def __init__(self, imgui: Any, scale: float = 1.0) -> None:
        self._imgui, self._scale = imgui, scale
        self.interface = panel_imgui.Interface(imgui, scale)
        self.history = History()
        self.drawn: DrawList | None = None
        self.places: dict[str, tuple[float, float, float, float]] = {}
        self._knobs = Knobs(imgui, self._placed)
        self._tree = Tree(imgui, self._placed)
        self._graph = GraphSection(imgui, self._placed)
        self._reference = ReferenceSection(imgui, self._placed)
        self._widgets: dict[type, list[Widget]] = {}  # of each class of settings
        self._ev: float | None = None  # while its slider moves
        self._speed: float | None = None
        self._error = ""

    # --- for the window: backends.window.Listener ---

    @property
    def visible(self) -> bool:
        """Whether it is shown; hidden it takes no input."""
        return self.interface.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self.interface.visible = visible

    @property
    def restless(self) -> bool:
        """Whether it must be drawn again although nothing new is to be shown, since the user did something."""
        return self.visible and self.interface.restless

    def event(self, event: Event) -> None:
        """Note what the user did."""
        self.interface.event(event)

    def takes_mouse(self, x: float, y: float) -> bool:
        """Whether the pixel (x, y) belongs to the panel."""
        return self.interface.takes_mouse(x, y)

    def takes_keys(self) -> bool:
        """Whether keys are meant for the panel."""
        return self.interface.takes_keys()

    # --- a frame ---

    def frame(self, state: PanelState, size: tuple[int, int], dt: float) -> PanelActions:
        """Show `state` on a window of (width, height) pixels, in `drawn`; return what the user wants."""
        actions: dict[str, Any] = {}
        self.places.clear()
        if state.error != self._error:
            self._error = state.error
            self.interface.stir()
        self.drawn = self.interface.frame(size, dt, lambda: self._build(state, size, actions))
        return PanelActions(**actions)

    def _build(self, state: PanelState, size: tuple[int, int], actions: dict[str, Any]) -> None:
        imgui, scale = self._imgui, self._scale
        once, margin = imgui.Cond_.first_use_ever, 10.0 * scale
        if state.reference.frozen:
            self._reference.line(state.reference, size, scale)
        beside = size[0] >= (WIDTH + TIMES_WIDTH) * scale + 3 * margin
        imgui.set_next_window_pos((margin, margin), once)
        imgui.set_next_window_size((WIDTH * scale, max(size[1] - 2 * margin, 80.0)), once)
        open_, _ = imgui.begin("Panel (F1)", None)
        if open_:
            imgui.push_item_width(imgui.get_content_region_avail().x * 0.5)
            self._head(state, actions)
            if state.graph is not None:
                unfolded = imgui.collapsing_header("Frame graph")
                self._placed("Frame graph")
                if unfolded:
                    actions |= self._graph.build(state.graph, state.settings, self._time_of)
            if imgui.collapsing_header("Settings", imgui.TreeNodeFlags_.default_open):
                self._settings(state, actions)
            if imgui.collapsing_header("Camera and time", imgui.TreeNodeFlags_.default_open):
                self._camera(state, actions)
                self._time(state, actions)
            unfolded = imgui.collapsing_header("Compare")
            self._placed("Compare")
            if unfolded:
                actions |= self._reference.build(state.reference)
            if not beside and imgui.collapsing_header("GPU times", imgui.TreeNodeFlags_.default_open):
                self._times()
            if imgui.collapsing_header("Scene") and state.scene is not None:
                self._tree.build(state.scene, state.time)
            self._placed("Scene")
            if imgui.collapsing_header("Work"):
                self._table("work", [(name, f"{count:,}") for name, count in state.work.items()])
            self._placed("Work")
            if imgui.collapsing_header("Plan") and state.plan is not None:
                self._plan(state.plan)
            self._placed("Plan")
            imgui.pop_item_width()
        imgui.end()
        if beside:  # so that the times stay in sight while knobs are turned
            self._times_beside(size)
        if state.error:
            show_error(imgui, state.error, size, scale)
        self._overlay(state, size)

    def _times_beside(self, size: tuple[int, int]) -> None:
        imgui, margin = self._imgui, 10.0 * self._scale
        once = imgui.Cond_.first_use_ever
        imgui.set_next_window_pos((size[0] - margin, 5 * margin), once, (1.0, 0.0))
        imgui.set_next_window_size((TIMES_WIDTH * self._scale, 0.0), once)
        open_, _ = imgui.begin("GPU times", None)
        if open_:
            self._times()
        imgui.end()

    def _head(self, state: PanelState, actions: dict[str, Any]) -> None:
        imgui = self._imgui
        imgui.text_wrapped(state.device)
        if imgui.button("Screenshot"):
            actions["screenshot"] = True
        self._placed("screenshot")
        imgui.set_item_tooltip("Writes the picture without this panel to out/.")
        if state.message:
            imgui.text_wrapped(state.message)
        if state.passes:  # a study has none
            self._stop(state, actions)

    def _stop(self, state: PanelState, actions: dict[str, Any]) -> None:
        imgui, listed = self._imgui, ["(none)", *state.passes]
        now = listed.index(state.stop_after) if state.stop_after in state.passes else 0
        changed, index = imgui.combo("stop after pass", now, listed)
        self._placed("stop_after")
        imgui.set_item_tooltip("Shows what this pass wrote; strata frame N writes that of all passes.")
        if changed and index != now:
            actions["stop_after"] = listed[index] if index else ""
        if state.stopped:
            imgui.text_wrapped(state.stopped)

    def _settings(self, state: PanelState, actions: dict[str, Any]) -> None:
        imgui, kind = self._imgui, type(state.settings)
        presets = list(getattr(kind, "PRESETS", {}))
        now = preset_of(state.settings)
        if presets:
            listed = presets if now else [*presets, "(own)"]
            changed, index = imgui.combo("preset", presets.index(now) if now else len(presets), listed)
            self._placed("preset")
            imgui.set_item_tooltip("Points on the chapter's measured curve of time against error.")
            if changed and index < len(presets) and presets[index] != now:
                actions["settings"] = preset(kind, presets[index])
        if state.quality:
            imgui.text_wrapped(state.quality)
        if kind not in self._widgets:
            self._widgets[kind] = widgets(kind)
        shown = self._widgets[kind]
        values = flat(state.settings)
        changes = self._knobs.build(shown, {one.name: values[one.name] for one in shown}, state.explained)
        if self._knobs.asked:
            actions["read"] = self._knobs.asked
        if changes:
            actions["settings"] = replaced(state.settings, **changes)

    def _camera(self, state: PanelState, actions: dict[str, Any]) -> None:
        imgui = self._imgui
        changed, index = imgui.combo("camera", MODES.index(state.mode), list(MODES))
        self._placed("mode")
        if changed and MODES[index] != state.mode:
            actions["mode"] = MODES[index]
        shown = state.ev_offset if self._ev is None else self._ev
        changed, value = imgui.slider_float("exposure [EV]", shown, -EV_RANGE, EV_RANGE, "%+.2f")
        self._placed("ev_offset")
        imgui.set_item_tooltip("Added to the camera's EV100: +1 halves the picture's brightness.")
        self._ev = value if imgui.is_item_active() else None
        if changed:  # no renderer is opened anew for it, so it follows the slider
            actions["ev_offset"] = float(np.clip(round(value, 4), -EV_RANGE, EV_RANGE))
        if state.camera:
            if imgui.button("copy"):
                actions["copy"] = state.camera
            self._placed("copy")
            imgui.set_item_tooltip("The view as text: strata run N --camera TEXT")
            imgui.same_line()
            imgui.text_wrapped(state.camera)

    def _time(self, state: PanelState, actions: dict[str, Any]) -> None:
        imgui = self._imgui
        changed, value = imgui.checkbox("pause", state.paused)
        self._placed("paused")
        if changed:
            actions["paused"] = bool(value)
        imgui.same_line()
        if imgui.button("step"):
            actions["step"] = True
        self._placed("step")
        imgui.set_item_tooltip("One sixtieth of a second further, and stop.")
        imgui.same_line()
        imgui.text(f"{state.time:.2f} s")
        shown = state.speed if self._speed is None else self._speed
        flags = imgui.SliderFlags_.logarithmic | imgui.SliderFlags_.always_clamp
        changed, value = imgui.slider_float("speed of time", shown, *SPEEDS, "%.2f", flags)
        self._placed("speed")
        self._speed = value if imgui.is_item_active() else None
        if changed:
            actions["speed"] = float(np.clip(float(f"{value:.4g}"), *SPEEDS))

    def _times(self) -> None:
        imgui, history = self._imgui, self.history
        names = history.names()
        if not names:
            imgui.text("no frame yet")
            return
        low, high = history.limits()
        self._plot(names, low, high)
        rows = [(name, f"{history.median(name):.3f} ms") for name in names]
        total = sum(value for name in names if math.isfinite(value := history.median(name)))
        self._table("times", [*rows, ("all passes", f"{total:.3f} ms")], colored=True)

    def _time_of(self, name: str) -> float:
        return self.history.median(name) if name in self.history.names() else math.nan

    def _plot(self, names: Sequence[str], low: float, high: float) -> None:
        """Draw a line for each series over the last frames, on one scale."""
        imgui = self._imgui
        width, height = imgui.get_content_region_avail().x, 90.0 * self._scale
        corner = imgui.get_cursor_screen_pos()
        imgui.dummy((width, height))
        self._placed("plot")
        imgui.set_item_tooltip(f"GPU milliseconds of each pass over the last {KEPT} frames; medians below.")
        lines = imgui.get_window_draw_list()
        frame = imgui.get_color_u32(imgui.Col_.frame_bg)
        lines.add_rect_filled((corner.x, corner.y), (corner.x + width, corner.y + height), frame)
        for name, color in zip(names, _cycled(len(names)), strict=True):
            points = self.history.points(name, low, high)
            places = [(corner.x + x * width, corner.y + (1.0 - y) * height) for x, y in points.tolist()]
            if len(places) > 1:
                lines.add_polyline([imgui.ImVec2(*place) for place in places], color, 1.5 * self._scale, 0)
        lines.add_text((corner.x + 4.0, corner.y + 2.0), 0xA0FFFFFF, f"{high:.2f} ms")

    def _table(self, name: str, rows: Sequence[tuple[str, str]], colored: bool = False) -> None:
        imgui = self._imgui
        if not imgui.begin_table(name, 2):
            return
        for (left, right), color in zip(rows, _cycled(len(rows)), strict=True):
            imgui.table_next_row()
            imgui.table_next_column()
            if colored and left in self.history.names():
                imgui.push_style_color(imgui.Col_.text, color)
                imgui.text(left)
                imgui.pop_style_color()
            else:
                imgui.text(left)
            imgui.table_next_column()
            imgui.text(right)
        imgui.end_table()

    def _plan(self, plan: Plan) -> None:
        imgui = self._imgui
        if not imgui.begin_table("plan", 2):
            return
        for choice in plan.choices:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(choice.feature)
            imgui.table_next_column()
            imgui.text_wrapped(choice.path)
            imgui.set_item_tooltip(choice.reason)
        imgui.end_table()

    def _overlay(self, state: PanelState, size: tuple[int, int]) -> None:
        """Show frames per second in the corner, without a border and out of the mouse's way."""
        imgui, flags = self._imgui, self._imgui.WindowFlags_
        margin = 10.0 * self._scale
        imgui.set_next_window_pos((size[0] - margin, margin), imgui.Cond_.always, (1.0, 0.0))
        imgui.set_next_window_bg_alpha(0.5)
        plain = flags.no_decoration | flags.no_inputs | flags.no_nav | flags.no_saved_settings
        imgui.begin("rate", None, plain | flags.always_auto_resize | flags.no_focus_on_appearing)
        imgui.text(f"{state.frame_rate:.0f} frames/s" if state.frame_rate else "nothing moves")
        imgui.end()

    def _placed(self, name: str) -> None:
        low, high = self._imgui.get_item_rect_min(), self._imgui.get_item_rect_max()
        self.places[name] = (low.x, low.y, high.x, high.y)

    def close(self) -> None:
        """Free what the widgets need."""
        self.interface.close()


def _cycled(count: int) -> list[int]:
    return [_COLORS[number % len(_COLORS)] for number in range(count)]
