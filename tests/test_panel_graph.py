"""The frame graph in the panel without a window: what is listed, what a user's hand asks for, and what stays."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from backends.contract import Access
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.types import GraphError, Node
from chapters.ch04.settings import Settings
from tests.support.panel import PanelUser, example
from tools.panel.graph import GraphLook, PassRow
from tools.panel.panel import PanelActions, open_panel
from tools.window.graph import WindowGraph
from tools.window.stop import Stop

NODES = [
    Node("surface", (), (Access("albedo", "color", "rgba16f"), Access("depth", "depth", "d32f"))),
    Node("light", (Access("albedo", "sampled"), Access("depth", "sampled")), (Access("hdr", "color", "rgba16f"),)),
    Node("lens", (Access("hdr", "sampled"),), (Access("soft", "color", "rgba16f", instead="hdr"),)),
    Node("fog", (), (Access("veil", "color", "rgba8"),), "no fog here"),
    Node("tonemap", (Access("soft", "sampled"),), (Access("color", "color", "rgba8"),)),
]  # fmt: skip


class FakeRenderer:
    """A renderer with a graph that nobody draws; `light` cannot be switched off."""

    def __init__(self, settings=None):
        self.settings, self.off, self.shown = settings or Settings(), set(), None
        self.inspection = SimpleNamespace(names=())
        self._compile()

    def _compile(self):
        nodes = [
            replace(node, why_not="switched off" if node.name in self.off else node.why_not) for node in NODES
        ]
        self.graph = compile_graph(nodes, (64, 32), ("color",), keep={self.shown} - {None})
        self.nodes = self.passes = [node for node in nodes if node.name not in self.graph.left_out]

    @property
    def switches(self):
        return {node.name: node.name not in self.off for node in NODES}

    def switch_pass(self, name, on):
        if name == "light":
            raise GraphError("'tonemap' reads 'hdr', which nobody writes.")
        (self.off.discard if on else self.off.add)(name)
        self._compile()

    def show_resource(self, name):
        if name == "lost":
            raise GraphError("No pass of this frame draws 'lost'.")
        self.shown = name
        self._compile()
        return next(
            (f"{node.name}/{name}" for node in self.nodes for one in node.writes if one.resource == name), ""
        )


def state_of(renderer, shown="", error=""):
    return GraphLook().state(renderer, shown, error)


def test_passes_are_listed_in_the_order_of_the_frame_and_then_those_left_out():
    renderer = FakeRenderer()
    renderer.switch_pass("lens", False)
    state = state_of(renderer)
    assert state.passes == (
        PassRow("surface", True),
        PassRow("light", True),
        PassRow("tonemap", True),
        PassRow("fog", True, "no fog here"),
        PassRow("lens", False, "switched off"),
    )
    assert state.graph == "auto" and state.graphs == ("auto", "deferred", "forward")


def test_resources_say_what_they_are_and_who_shares_their_memory():
    found = {row.names[0]: row for row in state_of(FakeRenderer()).resources}
    assert found["albedo"].about == "rgba16f 64x32" and found["albedo"].memory == "16.0 KiB"
    assert found["albedo"].shared == ("soft",) and found["soft"].shared == ("albedo",)
    assert found["hdr"].drawn == ("hdr",) and found["color"].shared == ()
    renderer = FakeRenderer()
    renderer.show_resource("albedo")
    alone = {row.names[0]: row.shared for row in state_of(renderer).resources}
    assert alone["albedo"] == () and not any("albedo" in shared for shared in alone.values())


def test_the_state_is_made_again_only_when_the_graph_is_another_one():
    renderer, look = FakeRenderer(), GraphLook()
    first = look.state(renderer, "", "")
    assert look.state(renderer, "hdr", "no").passes is first.passes
    renderer.switch_pass("lens", False)
    assert look.state(renderer, "", "").passes is not first.passes
    assert look.state(SimpleNamespace(settings=None), "", "") is None, "before chapter 4 there is no graph"


# --- a user's hand ----------------------------------------------------------------------------------------------------


@pytest.fixture
def user():
    panel = open_panel()
    if panel is None:
        pytest.skip("the extra ui is not installed")
    for _ in range(3):
        panel.history.add({"surface": 1.5})
    made = PanelUser(panel, example(Settings(), graph=state_of(FakeRenderer())), (640, 900))
    made.click(*made.place("Frame graph"))
    yield made
    panel.close()


@pytest.mark.feature("frame-graph/node-enable")
def test_a_box_switches_its_pass_and_a_click_shows_a_resource(user):
    assert user.click(*user.place("pass lens", 0.05)) == [PanelActions(switch=("lens", False))]
    renderer = FakeRenderer()
    renderer.switch_pass("lens", False)
    user.state = example(Settings(), graph=state_of(renderer))
    user.wait()
    assert user.click(*user.place("pass lens", 0.05)) == [PanelActions(switch=("lens", True))]
    assert user.click(*user.place("resource hdr")) == [PanelActions(show="hdr")]
    user.state = example(Settings(), graph=state_of(FakeRenderer(), "hdr", "'light' is needed."))
    user.wait()
    assert user.click(*user.place("resource hdr")) == [PanelActions(show="")]


def test_another_graph_is_chosen_by_name_or_by_file(user):
    assert user.choose("graph", 0, 3) == []
    assert user.choose("graph", 2, 3) == [PanelActions(settings=Settings(graph="forward"))]
    user.click(*user.place("graph file", 0.2))
    assert user.type("own.json") == []
    assert user.type("", "ENTER") == [PanelActions(settings=Settings(graph="own.json"))]
    user.state = example(Settings(), graph=replace(state_of(FakeRenderer()), graph="own.json"))
    user.wait()
    assert user.choose("graph", 1, 4) == [PanelActions(settings=Settings(graph="deferred"))]


def test_without_a_graph_there_is_no_such_section(user):
    user.state = example(Settings())
    user.wait()
    assert "Frame graph" not in user.panel.places


# --- what becomes of it -----------------------------------------------------------------------------------------------


def test_what_is_refused_is_said_until_something_else_is_done():
    renderer, graph = FakeRenderer(), WindowGraph(Stop())
    assert graph.apply(renderer, PanelActions(switch=("light", False)))
    assert graph.state(renderer).error == "'tonemap' reads 'hdr', which nobody writes."
    assert graph.apply(renderer, PanelActions(switch=("lens", False)))
    assert graph.state(renderer).error == "" and not renderer.switches["lens"]
    assert not graph.apply(renderer, PanelActions(paused=True))


def test_what_is_shown_and_switched_off_stays_so_in_a_renderer_with_other_settings():
    stop = Stop()
    renderer, graph = FakeRenderer(), WindowGraph(stop)
    graph.apply(renderer, PanelActions(switch=("lens", False)))
    graph.apply(renderer, PanelActions(show="albedo"))
    assert (stop.after, stop.resource, renderer.shown) == ("surface", "albedo", "albedo")
    other = FakeRenderer()
    graph.restore(other, graph.off(renderer))
    assert (other.off, other.shown, stop.after) == ({"lens"}, "albedo", "surface")
    stop.resource = "lost"
    graph.restore(FakeRenderer(), ["nobody"])
    assert (stop.after, stop.resource) == ("", "") and "draws 'lost'" in graph.refused
    graph.apply(other, PanelActions(stop_after="light"))
    assert (stop.after, stop.resource, other.shown) == ("light", "hdr", "hdr")
    graph.apply(other, PanelActions(stop_after=""))
    assert (stop.after, stop.resource, other.shown) == ("", "", None)
