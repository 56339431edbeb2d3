"""The frame graph in the panel: passes that can be switched, images that can be looked at, and which graph it is.

`GraphState` is what is shown, made anew only when the graph is another one; `GraphSection` draws it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tools.frames import report

if TYPE_CHECKING:
    from backends.contract import Renderer

GREY = 0xFFA0A0A0
"""As ImGui packs colours: 0xAABBGGRR."""
RED = 0xFF6E6EFF

LONGEST = 4096
"""Characters of a path."""


@dataclass(frozen=True)
class PassRow:
    """A pass: whether it is on, None where nobody may switch it, and why it is not in the frame, "" where it is."""

    name: str
    on: bool | None
    why_not: str = ""


@dataclass(frozen=True)
class ResourceRow:
    """What lies in one place in memory, under the `names` that it has from pass to pass.

    `drawn` are those of its names that can be looked at; `shared` are the others that lie in the same bytes.
    """

    names: tuple[str, ...]
    drawn: tuple[str, ...]
    about: str
    memory: str
    shared: tuple[str, ...] = ()


@dataclass(frozen=True)
class GraphState:
    """A frame graph as the panel shows it. `graph` is the setting, `graphs` are those of the chapter."""

    passes: tuple[PassRow, ...]
    resources: tuple[ResourceRow, ...]
    graph: str = "auto"
    graphs: tuple[str, ...] = ("auto",)
    memory: str = ""
    shown: str = ""  # the name that is looked at
    error: str = ""  # why the last change was refused


def graph_of(renderer: Renderer) -> GraphState | None:
    """Return the state of a renderer's graph, with nothing shown and no error; None before chapters have graphs."""
    switches = getattr(renderer, "switches", None)
    if switches is None:
        return None
    package = type(renderer.settings).__module__.rpartition(".")[0]
    graph, memory = renderer.graph, renderer.graph.memory
    passes = [PassRow(step.name, switches.get(step.name)) for step in graph.steps]
    passes += [PassRow(name, switches.get(name), why) for name, why in graph.left_out.items()]
    drawn = {one.resource for node in renderer.nodes for one in node.writes if one.use in ("color", "depth")}
    resources = []
    for row in report.rows(graph):
        one = row.resource
        size = f" {one.size[0]}x{one.size[1]}" if one.size else ""
        samples = f" x{one.samples}" if one.samples > 1 else ""
        shared = report.sharing(graph, row.name) if row.name in memory.places else []
        names = one.names if row.name == one.name else (row.name,)
        resources.append(
            ResourceRow(
                names,
                tuple(name for name in names if name in drawn),
                f"{one.format or one.kind}{samples}{size}",
                report.shown_bytes(report.bytes_of(one)),
                tuple(shared),
            )
        )
    own = sorted(path.stem for path in import_module(f"{package}.graph.file").GRAPHS.glob("*.json"))
    less = f", {100 * (1 - memory.size / memory.alone):.0f} % less" if memory.size < memory.alone else ""
    return GraphState(
        tuple(passes),
        tuple(resources),
        renderer.settings.graph,
        ("auto", *own),
        f"transients: {report.shown_bytes(memory.size)}; each alone {report.shown_bytes(memory.alone)}{less}",
    )


class GraphLook:
    """Makes the state of whatever renderer runs, again only when its graph is another one."""

    def __init__(self) -> None:
        self._of: tuple[Any, Any] = None, None
        self._state: GraphState | None = None

    def state(self, renderer: Renderer, shown: str, error: str) -> GraphState | None:
        """Return the graph of `renderer`, with what is looked at and what was refused last."""
        of = renderer, getattr(renderer, "graph", None)
        if any(one is not other for one, other in zip(of, self._of, strict=True)):
            self._of, self._state = of, graph_of(renderer)
        return self._state and replace(self._state, shown=shown, error=error)


class GraphSection:
    """The widgets of a `GraphState`, on an ImGui context."""

    def __init__(self, imgui: Any, placed: Callable[[str], None]) -> None:
        self._imgui, self._placed = imgui, placed
        self._path: str | None = None  # while it is typed

    def build(self, state: GraphState, settings: Any, time_of: Callable[[str], float]) -> dict[str, Any]:
        """Show the graph; return what the user wants, as arguments of `PanelActions`.

        `time_of` gives the GPU milliseconds of a pass by name, NaN where they are not known.
        """
        self._imgui.push_id("frame graph")  # settings have labels of passes
        actions = self._choose(state, settings)
        self._passes(state, time_of, actions)
        if state.error:
            self._colored(RED, state.error)
        self._resources(state, actions)
        self._imgui.pop_id()
        return actions

    def _choose(self, state: GraphState, settings: Any) -> dict[str, Any]:
        imgui, listed = self._imgui, list(state.graphs)
        file = "" if state.graph in listed else state.graph
        listed += [file] if file else []
        changed, index = imgui.combo("graph", listed.index(state.graph), listed)
        self._placed("graph")
        imgui.set_item_tooltip("Graphs of the chapter. auto: deferred, where nothing asks for the other one.")
        chosen = listed[index] if changed else state.graph
        flags = imgui.InputTextFlags_.enter_returns_true
        entered, text = imgui.input_text("graph file", file if self._path is None else self._path, flags)
        self._placed("graph file")
        imgui.set_item_tooltip("A JSON file of your own; once it is drawn, every edit of it is taken over.")
        self._path = text[:LONGEST] if imgui.is_item_active() else None
        if entered and text.strip():
            chosen = text.strip()
        return {"settings": replace(settings, graph=chosen)} if chosen != state.graph else {}

    def _passes(self, state: GraphState, time_of: Callable[[str], float], actions: dict[str, Any]) -> None:
        imgui = self._imgui
        if not imgui.begin_table("passes", 2):
            return
        for row in state.passes:
            imgui.table_next_row()
            imgui.table_next_column()
            if row.on is None:
                imgui.text(row.name)
            else:
                changed, on = imgui.checkbox(row.name, row.on)
                if changed:
                    actions["switch"] = (row.name, bool(on))
            self._placed(f"pass {row.name}")
            imgui.table_next_column()
            if row.why_not:
                self._colored(GREY, row.why_not)
            elif math.isfinite(taken := time_of(row.name)):
                imgui.text(f"{taken:.3f} ms")
        imgui.end_table()

    def _resources(self, state: GraphState, actions: dict[str, Any]) -> None:
        imgui = self._imgui
        imgui.text_wrapped(state.memory)
        if not imgui.begin_table("resources", 3):
            return
        for column, share in (("name", 1.4), ("what", 1.0), ("memory", 1.1)):
            imgui.table_setup_column(column, imgui.TableColumnFlags_.width_stretch, share)
        for row in state.resources:
            imgui.table_next_row()
            imgui.table_next_column()
            for name in row.names:
                self._resource(name, name in row.drawn, state.shown, actions)
            imgui.table_next_column()
            imgui.text_wrapped(row.about)
            imgui.table_next_column()
            imgui.text(row.memory)
            if row.shared:
                self._colored(GREY, f"with {', '.join(row.shared)}")
        imgui.end_table()

    def _resource(self, name: str, drawn: bool, shown: str, actions: dict[str, Any]) -> None:
        imgui = self._imgui
        if not drawn:
            imgui.text_wrapped(name)
            return
        clicked, _ = imgui.selectable(name, name == shown)
        self._placed(f"resource {name}")
        imgui.set_item_tooltip(
            "A click shows it as its pass leaves it; another click the finished picture again."
        )
        if clicked:
            actions["show"] = "" if name == shown else name

    def _colored(self, color: int, text: str) -> None:
        imgui = self._imgui
        imgui.push_style_color(imgui.Col_.text, color)
        imgui.text_wrapped(text)
        imgui.pop_style_color()
