"""Frames drawn by a graph: the same bits however it is written, shared or recorded, and work only when it changes."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch04.graph.file import graph_path
from chapters.ch04.settings import Settings
from common.scene import Image, Light, Material
from common.settings import replaced
from common.view.camera import View
from tests.support.chapter import building
from tests.support.scenes import facing, quad_scene, texture, translated

SIZE = (48, 32)
SUN = Light("directional", node=0, intensity=math.pi)
SOLID = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.4)
GLASS = Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend")
SMOKE = Material(base_color=(0.5, 0.5, 0.5, 0.25), alpha_mode="blend", double_sided=True)
SETTINGS = Settings(default_light=False, ambient=0.3, anisotropy=1.0, aperture=0.5, focus_distance=1.0)
OUTPUTS = {"color", "color_linear", "depth", "instance_id"}


@pytest.fixture(scope="module")
def scene():
    """Something solid behind something transparent, both in part of the picture."""
    return quad_scene(
        matrices=(translated(-0.5, 0, 0), translated(0.2, 0.3, 0.4), translated(0.6, 0, 0.8)),
        materials=(SOLID, GLASS, SMOKE),
        instance_materials=(0, 1, 2),
        lights=(SUN,),
    )


def pictures(chapter, scene, settings, view=None, frames=3):
    """Return the outputs of the last of some frames, and its work."""
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        for _ in range(frames):
            frame = renderer.render(view or facing())
        return {name: frame.image(name) for name in OUTPUTS}, frame.work


def assert_equal(one, other):
    for name in OUTPUTS:
        assert np.array_equal(one[name], other[name]), name


@pytest.fixture(scope="module")
def usual(chapter, scene):
    """Return the pictures of each graph as it comes."""
    return {
        graph: pictures(chapter, scene, replaced(SETTINGS, graph=graph))[0]
        for graph in ("deferred", "forward")
    }


@pytest.mark.core
@pytest.mark.parametrize("graph", ["deferred", "forward"])
@pytest.mark.parametrize(
    "turned",
    [{"alias": False}, {"resubmit": False}, {"poison": "depth 0"}, {"poison": "depth 1"}],
    ids=lambda turned: " ".join(f"{name}={value}" for name, value in turned.items()),
)
@pytest.mark.feature("frame-graph/resource-aliasing")
@pytest.mark.feature("device/command-buffers")
def test_sharing_memory_recording_once_and_what_was_in_memory_change_no_bit(
    chapter, scene, usual, graph, turned
):
    found, _ = pictures(chapter, scene, replaced(SETTINGS, graph=graph, **turned))
    assert_equal(found, usual[graph])


def test_poison_is_seen_where_somebody_reads_what_nobody_wrote(chapter, scene):
    """The test of the test: the lens, told to read a depth that no pass of the frame writes, shows the poison."""
    seen = []
    for poison in ("depth 0", "depth 1"):
        with chapter.open(
            scene, SIZE, replaced(SETTINGS, graph="deferred", poison=poison), outputs={"depth"}
        ) as made:
            gbuffer = next(one for one in made.passes if one.name == "gbuffer")
            # As if the pass had forgotten to clear: what is not drawn to keeps what was there.
            steps = [
                ready
                for slot in made._api.executor._slots
                for ready in (slot if chapter.backend == "gl" else slot.steps)
                if ready.step.name == gbuffer.name
            ]
            for ready in steps:
                if chapter.backend == "gl":
                    rendering = ready.targets._rendering
                    ready.targets._rendering = replace(rendering, clear_depth=None)
                else:
                    ready.targets.info.pDepthAttachment.loadOp = 0  # VK_ATTACHMENT_LOAD_OP_LOAD
            seen.append(made.render(facing()).image("depth"))
    assert not np.array_equal(*seen)


@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_the_order_in_which_passes_are_declared_changes_no_bit(chapter, scene, usual, graph, tmp_path):
    file = json.loads(graph_path(graph).read_text(encoding="utf-8"))
    rng = np.random.default_rng(4)
    for number in range(2):
        file["passes"] = [file["passes"][place] for place in rng.permutation(len(file["passes"]))]
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(file), encoding="utf-8")
        found, _ = pictures(chapter, scene, replaced(SETTINGS, graph=str(path)))
        assert_equal(found, usual[graph])


@pytest.mark.feature("frame-graph/resource-aliasing")
def test_shared_memory_is_at_least_30_percent_less(chapter, scene):
    with chapter.open(scene, (640, 360), replaced(SETTINGS, graph="deferred")) as renderer:
        memory = renderer.graph.memory
        assert memory.size <= 0.7 * memory.alone
        assert memory.size >= memory.bound


def test_a_moved_camera_is_one_record_and_no_recording(chapter, scene):
    with chapter.open(scene, SIZE, SETTINGS) as renderer:
        for _ in range(3):
            renderer.render(facing())
        moved = View(facing().world_from_view @ translated(0.01, 0, 0), facing().projection)
        with chapter.calls() as calls:
            frames = [renderer.render(moved).work for _ in range(2)]
        assert [work["recorded"] for work in frames] == [0, 0]
        assert not building(calls)
        assert not [name for name in calls if name.startswith("vkCmd")]


def test_what_changes_the_draws_is_recorded_once_for_each_slot(chapter, scene):
    """Hidden objects, and transparent ones that change places with a different material in the front."""
    with chapter.open(scene, SIZE, SETTINGS) as renderer:

        def recorded(view):
            return [renderer.render(view).work["recorded"] for _ in range(4)]

        behind = View(np.diag([-1.0, 1.0, -1.0, 1.0]) @ facing().world_from_view, facing().projection)
        assert recorded(facing()) == [1, 1, 0, 0]
        assert recorded(behind) == [1, 1, 0, 0]
        with renderer.scene.edit() as edit:
            edit.set_visible(0, False)
        assert recorded(behind) == [1, 1, 0, 0]
        with renderer.scene.edit() as edit:
            edit.set_visible(0, True)
        renderer.resize((40, 30))
        assert recorded(facing()) == [1, 1, 0, 0]


@pytest.mark.feature("frame-graph/node-enable")
def test_a_pass_that_a_changed_material_needs_comes_and_goes(chapter):
    """Glass in place of wood makes a pass for what is transparent; the picture is that of a scene opened with glass."""
    settings = replaced(SETTINGS, graph="deferred", aperture=0.0)
    wood, glass = (quad_scene(material, lights=(SUN,)) for material in (SOLID, GLASS))
    expected, _ = pictures(chapter, glass, settings)
    before, _ = pictures(chapter, wood, settings)
    with chapter.open(wood, SIZE, settings, outputs=OUTPUTS) as renderer:
        renderer.render(facing())
        assert "transparent" in renderer.graph.left_out
        for material, picture, left_out in ((GLASS, expected, False), (SOLID, before, True)):
            with renderer.scene.edit() as edit:
                edit.set_material(0, material)
            frame = renderer.render(facing())
            assert_equal({name: frame.image(name) for name in OUTPUTS}, picture)
            assert ("transparent" in renderer.graph.left_out) == left_out


def test_a_recording_holds_over_a_reset_of_the_history(chapter):
    """That is no change of the structure."""
    textured = quad_scene(
        replace(SOLID, base_color_texture=texture()),
        images=(Image("texels", np.random.default_rng(3).integers(0, 256, (8, 8, 4), dtype=np.uint8)),),
        lights=(SUN,),
    )
    with chapter.open(textured, SIZE, SETTINGS) as renderer:
        first = renderer.render(facing()).image("color")
        renderer.render(facing())
        renderer.reset_history("a test")
        frame = renderer.render(facing())
        assert frame.work["recorded"] == 0 and frame.work["history_resets"] == 1
        assert np.array_equal(frame.image("color"), first)
