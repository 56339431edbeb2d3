"""Recording: which calls a list of draws becomes, that nothing is bound twice in a row, and what is counted."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.frames.frame import OUTPUTS
from chapters.ch01.frames.vulkan_commands import Rendering
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.scene import Image, Light, Material
from tests.support.chapter import as_modelled, on_path, record_anew
from tests.support.recorded import draws
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated

SIZE = (16, 16)
SUN = Light("directional", node=0, intensity=math.pi)
IMAGES = tuple(Image(f"image {i}", np.full((2, 2, 4), 80 * i + 40, np.uint8)) for i in range(2))


def recorded(device, scene, outputs=("color_linear",), settings=None, read=lambda made, log: log):
    """Return the calls of a frame whose slot is warm, or what `read` makes of them, and its work."""
    log: list = []
    settings = as_modelled(on_path(settings or Settings()), 1)
    with Renderer(scene, SIZE, settings, outputs=set(outputs), device=device) as made:
        made.render(facing())
        made.render(facing())
        record_anew(made)
        device.fn.trace(log)
        work = made.render(facing()).work
        device.fn.trace(None)
        return read(made, log), work


def row_of(materials, count):
    """Return a scene of `count` squares that have the materials in turns."""
    return quad_scene(
        materials=materials,
        images=IMAGES,
        matrices=tuple(translated(z=-0.01 * i) for i in range(count)),
        instance_materials=tuple(i % len(materials) for i in range(count)),
        lights=(SUN,),
    )


@pytest.mark.until(1, "nothing is bound per material once resources are bindless")
def test_objects_of_one_material_share_its_state(vulkan_device):
    """Twelve squares of three materials in turns: three binds of state, three of textures, twelve draws."""
    materials = (
        Material(base_color_texture=texture(0)),
        Material(base_color_texture=texture(1)),
        Material(unlit=True, base_color_texture=texture(0)),
    )
    log, work = recorded(vulkan_device, row_of(materials, 12))
    calls = Counter(name for name, _ in log)
    assert calls["vkCmdDrawIndexed"] == work["draws"] == 12
    assert calls["vkCmdPushConstants"] == 12
    assert calls["vkCmdBindPipeline"] == work["pipeline_binds"] == 2, "two of the materials are of one kind"
    assert calls["vkCmdBindDescriptorSets"] == work["descriptor_binds"]
    textures = [
        arguments for name, arguments in log if name == "vkCmdBindDescriptorSets" and arguments[3] == 1
    ]
    assert len(textures) == 3
    assert work["triangles"] == 24


@pytest.mark.until(1, "indirect draws push nothing")
@pytest.mark.feature("device/push-constants")
def test_a_draw_pushes_the_number_of_its_instance(vulkan_device):
    log, _ = recorded(vulkan_device, row_of((Material(), Material(unlit=True)), 7))
    pushed = []
    for name, arguments in log:
        if name == "vkCmdPushConstants":
            pushed.append(vk.ffi.cast("uint32_t *", arguments[5])[0])
        elif name == "vkCmdDrawIndexed":
            assert arguments[1:] == (6, 1, 0, 0, 0)
    assert sorted(pushed) == list(range(7))


@pytest.mark.until(1, "nothing is bound per material once resources are bindless")
def test_nothing_is_bound_twice_in_a_row(vulkan_device):
    materials = (
        Material(base_color_texture=texture(0)),
        Material(unlit=True),
        Material(base_color_texture=texture(1), alpha_mode="mask"),
        Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend"),
    )
    log, _ = recorded(vulkan_device, row_of(materials, 16), OUTPUTS)
    states: list = []
    for (name, arguments), (_, cull), (_, front) in zip(log, log[1:], log[2:], strict=False):
        if name == "vkCmdBeginRendering":
            states.append(None)
        elif name == "vkCmdBindPipeline":
            states.append((arguments[2], cull[1], front[1]))
    assert len(states) > 8
    assert all(a != b for a, b in itertools.pairwise(states))
    sets: dict = {}
    for name, arguments in log:
        if name == "vkCmdBeginRendering":
            sets.clear()
        elif name == "vkCmdBindPipeline":
            sets.pop(0, None)
        elif name == "vkCmdBindDescriptorSets":
            number, handle = arguments[3], arguments[5][0]
            assert sets.get(number) != handle, "the same set again"
            sets[number] = handle


def test_opaque_then_masked_then_glass_from_the_farthest(vulkan_device):
    """The order of draws, by their instances."""
    glass = Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend")
    masked = Material(alpha_mode="mask")
    scene = quad_scene(
        materials=(glass, masked, Material()),
        matrices=tuple(translated(z=z) for z in (0.1, 0.5, 0.3, -0.2, 0.4, 0.0)),
        instance_materials=(0, 1, 0, 2, 0, 2),
        lights=(SUN,),
    )
    (drawn,), _ = recorded(vulkan_device, scene, read=draws)
    order = [one.instance for one in drawn]
    assert sorted(order[:2]) == [3, 5]
    assert order[2] == 1
    assert order[3:] == [0, 2, 4]


def test_culling_and_front_face_follow_material_and_mirror(vulkan_device):
    scene = quad_scene(
        materials=(Material(), Material(double_sided=True)),
        matrices=(np.eye(4), np.diag((-1.0, 1, 1, 1)), np.eye(4), np.diag((-1.0, 1, 1, 1))),
        instance_materials=(0, 0, 1, 1),
        lights=(SUN,),
    )
    (drawn,), _ = recorded(vulkan_device, scene, read=draws)
    seen = [(one.instance, one.cull, one.front) for one in drawn]
    back, none = vk.VK_CULL_MODE_BACK_BIT, vk.VK_CULL_MODE_NONE
    plain, turned = vk.VK_FRONT_FACE_COUNTER_CLOCKWISE, vk.VK_FRONT_FACE_CLOCKWISE
    assert sorted(seen) == [(0, back, plain), (1, back, turned), (2, none, plain), (3, none, turned)]


@pytest.mark.feature("device/debug-names-and-markers")
def test_every_pass_stands_in_a_label_of_its_name(vulkan_device):
    if not vulkan_device.instance.has_debug_utils:
        pytest.skip("the instance has no debug labels")
    outputs = ("color", "depth", "instance_id")
    log, _ = recorded(vulkan_device, quad_scene(Material(), lights=(SUN,)), outputs)
    stack: list = []
    labels, inside = [], {}
    for name, arguments in log:
        if name == "vkCmdBeginDebugUtilsLabelEXT":
            stack.append(vk.ffi.string(arguments[1].pLabelName).decode())
            labels.append(stack[-1])
        elif name == "vkCmdEndDebugUtilsLabelEXT":
            stack.pop()
        elif name in ("vkCmdDraw", "vkCmdDrawIndexed", "vkCmdBeginRendering", "vkCmdCopyImageToBuffer"):
            inside.setdefault(stack[-1], set()).add(name)
            assert len(stack) == 1
    assert not stack
    assert labels == ["forward", "instance_id", "tonemap", "copy outputs"]
    assert inside["tonemap"] == {"vkCmdBeginRendering", "vkCmdDraw"}
    assert inside["copy outputs"] == {"vkCmdCopyImageToBuffer"}


@pytest.mark.feature("device/debug-names-and-markers")
def test_without_debug_utils_there_are_no_labels_and_the_same_picture(vulkan_device, monkeypatch):
    scene = quad_scene(Material(unlit=True))
    with Renderer(scene, SIZE, device=vulkan_device) as made:
        expected = made.render(facing()).image("color")
    monkeypatch.setattr(vulkan_device.instance, "has_debug_utils", False)
    log: list = []
    with Renderer(scene, SIZE, device=vulkan_device) as made:
        vulkan_device.fn.trace(log)
        picture = made.render(facing()).image("color")
        vulkan_device.fn.trace(None)
    assert np.array_equal(picture, expected)
    assert not [name for name, _ in log if "DebugUtils" in name]


def test_hidden_and_empty_objects_are_not_drawn(vulkan_device):
    scene = row_of((Material(), Material(unlit=True)), 6)
    scene.instances.visible[2:4] = False
    scene.meshes["index_count"][1] = 0
    drawn, work = recorded(vulkan_device, scene, read=draws)
    assert work["draws"] == 2
    assert [one.instance for one in drawn[0]] == [0, 4]


@pytest.mark.until(3, "what attachments begin and end with, the frame graph says")
def test_attachments_are_cleared_or_kept_as_they_were_asked_for(vulkan_device):
    with Renderer(quad_scene(), SIZE, outputs=OUTPUTS, device=vulkan_device) as made:
        targets = made._targets
        clear, load = vk.VK_ATTACHMENT_LOAD_OP_CLEAR, vk.VK_ATTACHMENT_LOAD_OP_LOAD
        both = Rendering(SIZE, targets["color_hdr"], targets["depth"], (0.5, 0.25, 0.0, 1.0), 0.0).info
        assert both.pColorAttachments[0].loadOp == both.pDepthAttachment.loadOp == clear
        assert list(both.pColorAttachments[0].clearValue.color.float32) == [0.5, 0.25, 0.0, 1.0]
        assert both.pDepthAttachment.clearValue.depthStencil.depth == 0.0
        kept = Rendering(SIZE, targets["instance_id"], targets["depth"], (7, 0, 0, 0)).info
        assert kept.pDepthAttachment.loadOp == load
        assert kept.pColorAttachments[0].clearValue.color.uint32[0] == 7
        alone = Rendering((5, 3), None, targets["depth"]).info
        assert alone.colorAttachmentCount == 0
        assert (alone.renderArea.extent.width, alone.renderArea.extent.height) == (5, 3)


def test_objects_far_apart_in_state_and_close_in_space_are_all_there(vulkan_device):
    """A hundred small squares of ten kinds: sorting by state loses none and doubles none."""
    kinds = tuple(
        Material(
            unlit=i % 2 == 0,
            double_sided=i % 3 == 0,
            alpha_mode="mask" if i % 5 == 0 else "opaque",
            alpha_cutoff=0.1,
            base_color_texture=texture(i % 2) if i % 4 == 0 else None,
        )
        for i in range(10)
    )
    tiny = np.diag((0.08, 0.08, 1.0, 1.0))
    matrices = tuple(translated(0.2 * (i % 10) - 0.9, 0.2 * (i // 10) - 0.9) @ tiny for i in range(100))
    scene = quad_scene(
        materials=kinds,
        images=IMAGES,
        matrices=matrices,
        instance_materials=tuple(i * 7 % 10 for i in range(100)),
        lights=(Light("directional", node=100),),
    )
    scene = replace(scene, nodes=nodes_at(*matrices, np.eye(4)))
    with Renderer(scene, (100, 100), outputs={"instance_id"}, device=vulkan_device) as made:
        frame = made.render(facing())
        ids = frame.image("instance_id")
    assert frame.work["draws"] == 200
    assert np.array_equal(ids[::-1][5::10, 5::10], np.arange(1, 101).reshape(10, 10))
