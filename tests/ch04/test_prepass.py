"""The depth pre-pass: each covered pixel is shaded once, holes of masks stay holes, and no picture changes by a bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backends.gl.queries import Statistics
from backends.vulkan import api as vk
from chapters.ch04.settings import Settings
from common.scene import Image, Material
from tests.support.drivers import needs_whole_quads
from tests.support.jumble import CAMERA, jumble
from tests.support.scenes import facing, quad_scene, texture, translated

SIZE = (32, 32)
PLAIN = Settings(color_format="rgba32f", gbuffer_format="full")
FIRST = {"forward": "forward", "deferred": "gbuffer"}
"""The pass of each path that draws the solid objects."""
OUTPUTS = {"color_linear", "depth", "instance_id"}
WHITE = Material(unlit=True)
INVOCATIONS = vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT


def square(scale: float, z: float, x: float = 0.0) -> np.ndarray:
    """Return the matrix of a square of this half size, `z` nearer to the camera."""
    return translated(x, 0.0, z) @ np.diag((scale, scale, 1.0, 1.0))


@contextmanager
def counted(renderer: Any, name: str) -> Iterator[Callable[[], int]]:
    """Count how often the fragment shader runs in a pass; what is yielded reads it after the frame."""
    device = renderer.device
    made = next(one for one in renderer.passes if one.name == name)
    draw = made.record
    if renderer.capabilities.backend == "gl":
        statistics = Statistics(device, name)

        def record(commands: Any) -> None:
            with statistics.count():
                draw(commands)

        made.record = record
        yield lambda: statistics.read()["samples_passed"]
        statistics.close()
        return
    fn = device.fn
    info = vk.new(
        "VkQueryPoolCreateInfo",
        queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
        queryCount=1,
        pipelineStatistics=INVOCATIONS,
    )
    pool = device.create("vkCreateQueryPool", info, "fragments")

    def between(commands: Any) -> None:
        fn.vkCmdBeginQuery(commands.handle, pool, 0, 0)
        draw(commands)
        fn.vkCmdEndQuery(commands.handle, pool, 0)

    def read() -> int:
        out = np.zeros(1, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        fn.vkGetQueryPoolResults(device.handle, pool, 0, 1, 8, vk.ffi.from_buffer(out), 8, flags)
        return int(out[0])

    made.pre_render = lambda commands: fn.vkCmdResetQueryPool(commands.handle, pool, 0, 1)
    made.record = between
    yield read
    device.wait_idle()
    device.destroy("VkQueryPool", pool)


@pytest.mark.feature("depth-prepass/equal-shading")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("graph", FIRST)
@pytest.mark.parametrize("prepass", [False, True])
def test_with_it_each_covered_pixel_is_shaded_once(chapter, graph, prepass):
    """Squares of 28, 20 and 10 pixels a side, drawn from the farthest on: without it all of their pixels are shaded."""
    if chapter.backend == "vulkan" and not chapter.device.has("pipeline-statistics"):
        pytest.skip("the device counts no fragments")
    scene = quad_scene(WHITE, matrices=(square(0.9, -0.5), square(0.6, 0.0), square(0.3, 0.5)))
    settings = replace(PLAIN, graph=graph, depth_prepass=prepass)
    with (
        chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer,
        counted(renderer, FIRST[graph]) as read,
    ):
        frame = renderer.render(facing())
        covered = int((frame.image("depth") > 0).sum())
        shaded = read()
    assert covered == 28**2
    assert prepass or shaded > covered, "without it there is something to save"
    if renderer.capabilities.is_software:
        assert shaded == (covered if prepass else 28**2 + 20**2 + 10**2)
    else:  # hardware runs whole quads of pixels, and may count those beyond the edge
        assert covered <= shaded < (1.5 * covered if prepass else 2 * (28**2 + 20**2 + 10**2))


@pytest.mark.parametrize(
    "settings", [{"graph": "forward"}, {"graph": "deferred"}, {"graph": "forward", "msaa": 4}]
)
def test_no_bit_of_the_picture_changes(chapter, settings):
    """Equal depth has to be equal to the bit, or surfaces would have gaps; and samples of masks the same ones."""
    needs_whole_quads(chapter.device)
    scene = jumble(1)
    frames = {}
    for prepass in (False, True):
        chosen = replace(PLAIN, depth_prepass=prepass, **settings)
        with chapter.open(scene, SIZE, chosen, outputs=OUTPUTS) as renderer:
            frame = renderer.render(CAMERA)
            frames[prepass] = {name: frame.image(name) for name in OUTPUTS}
            assert frame.work["passes"] == len(renderer.passes)
            assert ("depth_prepass" in [made.name for made in renderer.passes]) == prepass
    assert (frames[True]["depth"] > 0).mean() > 0.3
    for name in OUTPUTS:
        assert np.array_equal(frames[True][name], frames[False][name]), name


@pytest.mark.feature("depth-prepass/alpha-tested")
def test_holes_of_a_mask_leave_depth_alone(chapter):
    """A square of 8x8 texels, a few of them cut out, before a plain one: at holes the depth is that behind them."""
    cut = np.random.default_rng(3).random((8, 8)) < 0.4
    texels = np.full((8, 8, 4), 255, np.uint8)
    texels[..., 3] = np.where(cut, 100, 200)
    masked = Material(alpha_mode="mask", alpha_cutoff=0.5, base_color_texture=texture(), unlit=True)
    scene = quad_scene(
        materials=(masked, WHITE),
        matrices=(square(1.0, 0.5), square(0.5, 0.0)),
        instance_materials=(0, 1),
        images=(Image("cut", texels),),
    )
    settings = replace(PLAIN, graph="deferred", depth_prepass=True)
    with chapter.open(scene, (16, 16), settings, outputs=OUTPUTS, inspect=True) as renderer:
        frame = renderer.render(facing())
        depth = frame.image("depth_prepass/depth")
        ids = frame.image("instance_id")
        stages = stages_of(renderer)
    hole = np.kron(cut, np.ones((2, 2), bool))
    behind = np.zeros((16, 16), bool)
    behind[4:12, 4:12] = True
    # An orthographic view from 2 m with planes at 0.1 and 4 m: depth is (far - distance) / (far - near).
    near, far = 0.1, 4.0
    at_mask, at_plain = ((far - distance) / (far - near) for distance in (1.5, 2.0))
    truth = np.where(~hole, at_mask, np.where(behind, at_plain, 0.0))
    assert np.allclose(depth, truth, atol=1e-6)
    assert not np.allclose(depth, at_mask, atol=1e-2), "a depth that no hole let through"
    assert (depth[hole & ~behind] == 0.0).all()
    assert np.array_equal(ids, np.where(~hole, 1, np.where(behind, 2, 0)))
    assert stages == {"depth": {"vert"}, "depth masked": {"vert", "frag"}}


def stages_of(renderer: Any) -> dict[str, set[str]]:
    """Return the stages of the pre-pass's pipelines by their names."""
    made = next(one for one in renderer.passes if one.name == "depth_prepass")
    found = {}
    for variant in made._built:
        described = made.describe(variant)
        found[described.name] = {file.rpartition(".")[2] for file in described.shaders}
    return found


def test_without_masks_there_is_no_alpha_test(chapter):
    scene = quad_scene(materials=(WHITE, Material()), matrices=(np.eye(4),) * 2, instance_materials=(0, 1))
    with chapter.open(scene, (8, 8), replace(PLAIN, graph="forward", depth_prepass=True)) as renderer:
        renderer.render(facing())
        assert stages_of(renderer) == {"depth": {"vert"}}
        made = next(one for one in renderer.passes if one.name == "depth_prepass")
        assert len(set(map(id, made._built.values()))) == 1, "one pipeline for all that is opaque"


def test_it_is_left_out_where_every_fragment_is_to_be_counted(chapter):
    scene = quad_scene(WHITE, matrices=(square(1.0, 0.0), square(1.0, 0.5)))
    settings = replace(PLAIN, depth_prepass=True, view="overdraw")
    with chapter.open(scene, (8, 8), settings, outputs={"color_linear"}) as renderer:
        counts = renderer.render(facing()).image("color_linear")
        assert "depth_prepass" not in [made.name for made in renderer.passes]
    assert (counts == 2.0).all()


def test_an_empty_scene_has_a_depth_too(chapter):
    scene = quad_scene(matrices=(), instance_materials=())
    with chapter.open(scene, (8, 8), replace(PLAIN, depth_prepass=True), outputs=OUTPUTS) as renderer:
        frame = renderer.render(facing())
        assert not frame.image("depth").any()
        assert np.allclose(frame.image("color_linear"), PLAIN.background, atol=1e-6)
