"""The tree of nodes in the panel, by a user's hand: branches unfold, a click chooses, a large scene costs no time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from backends.window import Event
from common.settings import knob
from tests.support.panel import PanelUser, example, seen
from tests.support.scenes import nodes_at, quad_scene, translated
from tests.support.timing import least_time, timed
from tools.panel.panel import open_panel


@dataclass
class Settings:
    """As few as there can be."""

    on: bool = knob(True, "whether it is on")


@pytest.fixture
def panel():
    made = open_panel()
    if made is None:
        pytest.skip("the extra ui is not installed")
    yield made
    made.close()


def house():
    """Return a scene of a root with two branches, the first with two leaves."""
    matrices = [translated(float(number)) for number in range(5)]
    nodes = replace(nodes_at(*matrices), parent=np.array((-1, 0, 0, 1, 1), np.int32))
    nodes.names[:] = ["house", "floor ##1", "roof", "table %s", ""]
    return replace(quad_scene(), nodes=nodes)


def opened(panel, scene) -> PanelUser:
    user = PanelUser(panel, example(Settings(), scene=scene), (640, 1200))
    assert not user.click(*user.place("Scene", 0.5))
    return user


def rows(user: PanelUser) -> list[int]:
    return [int(name.split()[1]) for name in user.panel.places if name.startswith("node ")]


@pytest.mark.feature("scene/tree-inspector")
def test_branches_unfold_and_a_click_chooses_a_node(panel):
    user = opened(panel, house())
    assert rows(user) == [0, 1, 2], "a lone root is unfolded"
    assert "transform" not in user.panel.places
    left, middle = user.place("node 1", 0.0, 0.5)
    arrow = (left + user.panel._imgui.get_tree_node_to_label_spacing() / 2, middle)
    assert not user.click(*arrow)
    assert rows(user) == [0, 1, 3, 4, 2]
    assert user.panel._tree.chosen is None, "the arrow unfolds and chooses nothing"
    assert not user.click(*user.place("node 4", 0.5))
    assert user.panel._tree.chosen == 4
    assert "transform" in user.panel.places
    assert not user.click(*arrow)
    assert rows(user) == [0, 1, 2] and user.panel._tree.chosen == 4
    user.state = example(Settings(), scene=house())
    user.wait()
    assert user.panel._tree.chosen is None, "another scene has other nodes"


@pytest.mark.feature("scene/tree-inspector")
def test_each_backend_shows_the_entries_and_which_one_is_chosen(panel, vulkan_device, gl_context):
    user = opened(panel, house())
    plain, boxes = seen(user, vulkan_device, gl_context), [user.panel.places[f"node {n}"] for n in (0, 1, 2)]
    assert not user.click(*user.place("node 2", 0.5))
    user.frame(Event("move", 1.0, 1.0))  # what is under the mouse is bright, chosen or not
    assert not user.wait() and user.panel._tree.chosen == 2
    for before, after in zip(plain, seen(user, vulkan_device, gl_context), strict=True):
        changed = []
        for left, top, right, bottom in np.rint(boxes).astype(int):
            here = before[top:bottom, left:right]
            assert len(np.unique(here.reshape(-1, 4), axis=0)) > 1, "letters on their ground"
            changed.append((here != after[top:bottom, left:right]).any(-1).mean())
        assert changed[2] > 0.5 and changed[0] == changed[1] == 0.0


@pytest.mark.alone
def test_a_hundred_thousand_roots_are_listed_once_and_drawn_where_they_are_seen(panel):
    count = 100_000
    scene = replace(
        quad_scene(),
        nodes=replace(
            nodes_at(np.eye(4)),
            parent=np.full(count, -1, np.int32),
            names=[""] * count,
            translation=np.zeros((count, 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)),
            scale=np.ones((count, 3)),
            matrix=np.tile(np.eye(4), (count, 1, 1)),
            has_matrix=np.ones(count, bool),
        ),
    )
    user = opened(panel, scene)
    assert 5 < len(rows(user)) < 40
    took = least_time(timed(lambda: user.wait(10)), 0.5, fewest=1)
    assert took < 0.5, "ten frames; listing all rows ten times takes seconds"


def test_without_a_scene_nothing_is_listed(panel):
    user = opened(panel, None)
    assert rows(user) == []
