"""Shading rates for fragments without an extension: the bits of compute, and no invocation that the mask saves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backends.fragments import fragments
from backends.gl.queries import Statistics
from chapters.ch09.rates.model import TEXEL
from chapters.ch09.settings import Settings
from common.environment import Environment
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.jumble import CAMERA, jumble
from tests.support.shadows import PLAIN, point, spot, yard

pytestmark = [pytest.mark.feature("vrs/software"), pytest.mark.variants("vulkan", "gl")]

SIZE = (151, 93)  # no multiple of a texel, a block or a work group
RADIUS = 0.25  # in heights of the picture
BASE = Settings(
    **PLAIN,
    graph="deferred",
    shadows="off",
    rate_policy="radial",
    rate_radius=RADIUS,
    rate_fragments="passes",
    rate_texel=TEXEL,
)
YARD = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
MASK = "rate_mask/rates"
PASSES = {"rate_mask", "rate_depth", "lighting_blocks", "rate_spread", "lighting_pixels"}
SKY = {
    "environment_size": 16,
    "environment_detail": 2.0,
    "irradiance_source": 4,
    "table_size": 8,
    "table_samples": 16,
    "ambient": 0.3,
}


@pytest.fixture(scope="module")
def scene():
    """Return surfaces of all kinds, some of which emit, under a sky that differs in every direction."""
    radiance = np.random.default_rng(7).uniform(0.1, 4.0, (8, 16, 3)).astype(np.float32)
    return replace(jumble(3), environment=Environment("a sky of a test", radiance))


@pytest.fixture(scope="module")
def lamps():
    return yard(spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8)))


def opened(chapter, scene, size=SIZE, inspect=True, **turned):
    outputs = {"color", "color_linear"}
    return chapter.open(scene, size, replaced(BASE, **turned), outputs=outputs, inspect=inspect)


def codes(frame):
    """Return the codes of the mask, (rows, columns)."""
    image = frame.image(MASK)
    return image.reshape(image.shape[:2]).astype(np.int64)


def radial(size=SIZE, radius=RADIUS):
    """Return (rows, columns) which texels have rate 1x1: those with a pixel near the middle of the picture."""
    width, height = size
    y, x = np.indices((height, width)) + 0.5
    near = np.hypot(x - width / 2, y - height / 2) / height <= radius
    rows, columns = -(-height // TEXEL), -(-width // TEXEL)
    padded = np.zeros((rows * TEXEL, columns * TEXEL), bool)
    padded[:height, :width] = near
    return padded.reshape(rows, TEXEL, columns, TEXEL).any(axis=(1, 3))


def by_pixel(fine, size=SIZE):
    return np.kron(fine, np.ones((TEXEL, TEXEL), bool))[: size[1], : size[0]]


def assert_alike(renderer, one, other):
    """Hold two frames to each other: one step of 8 bits, and the same bits where the device computes in software."""
    codes = [frame.image("color").astype(int) for frame in (one, other)]
    assert np.abs(codes[0] - codes[1]).max() <= 1
    if renderer.capabilities.is_software:
        assert np.array_equal(one.image("color_linear"), other.image("color_linear"))


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("coarse", ["2x2", "4x4"])
def test_fragments_and_compute_light_the_same_pixels(chapter, scene, coarse):
    """Surfaces of all kinds, sky, environment and blended objects over them; and half floats at sizes of all kinds."""
    sizes = ((5, 3), (17, 1), (64, 48), SIZE)
    turned = {"rate_coarse": coarse, "color_format": "rgba16f", "gbuffer_format": "octahedral", **SKY}
    with (
        opened(chapter, scene, sizes[0], **turned) as drawn,
        opened(chapter, scene, sizes[0], **turned, graph="compute") as computed,
    ):
        for size in sizes:
            drawn.resize(size)
            computed.resize(size)
            one, other = drawn.render(CAMERA), computed.render(CAMERA)
            assert np.array_equal(codes(one), codes(other))
            assert_alike(drawn, one, other)
        assert {step.name for step in drawn.graph.steps} >= PASSES
        assert one.image("color_linear").std() > 0.05, "a picture of nothing would prove nothing"
        assert 0.1 < by_pixel(codes(one) == 0).mean() < 0.9


def test_a_mask_of_edges_is_the_same_frame_by_frame(chapter, lamps):
    """Each frame's mask follows the picture before it, so one wrong bit would grow. Occlusion is read by both."""
    turned = {"rate_policy": "sobel", "rate_threshold": 2.0, "ssao": "depth", "ambient": 0.2}
    with (
        opened(chapter, lamps, **turned) as drawn,
        opened(chapter, lamps, **turned, graph="compute") as computed,
    ):
        for number in range(4):
            one, other = drawn.render(YARD), computed.render(YARD)
            assert_alike(drawn, one, other)
            if drawn.capabilities.is_software:
                assert np.array_equal(codes(one), codes(other))
            assert number < 1 or {*np.unique(codes(one)).tolist()} == {0, 5}


def test_each_block_has_the_light_of_its_pixel(chapter, lamps):
    """Bit for bit, against a frame in which compute lights every pixel."""
    with opened(chapter, lamps, inspect=False, rate_policy="none", graph="compute") as renderer:
        whole = renderer.render(YARD).image("color_linear")
    with opened(chapter, lamps, rate_coarse="4x4") as renderer:
        frame = renderer.render(YARD)
        assert np.array_equal(codes(frame), np.where(radial(), 0, 10))
        found, software = frame.image("color_linear"), renderer.capabilities.is_software
    fine = by_pixel(radial())
    y, x = np.indices(fine.shape)
    rows, columns = (
        np.where(fine, at, np.minimum(at // 4 * 4 + 2, most - 1)) for at, most in ((y, SIZE[1]), (x, SIZE[0]))
    )
    off = np.abs(found - whole[rows, columns])
    assert off.max() <= (0 if software else 1e-5 * whole.max())
    assert not np.array_equal(found, whole)


def test_what_no_pass_has_written_is_read_by_none(chapter, lamps):
    """Blocks of fine texels are never lit. Memory that is full of NaN, or of either depth, shows them."""
    pictures = []
    for turned in ({}, {"poison": "depth 0"}, {"poison": "depth 1"}, {"alias": False}):
        with opened(chapter, lamps, inspect=False, **turned) as renderer:
            renderer.render(YARD)
            pictures.append(renderer.render(YARD).image("color_linear"))
    assert np.isfinite(pictures[0]).all()
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures[1:])


# --- work -------------------------------------------------------------------------------------------------------------


@contextmanager
def samples(device: Any) -> Iterator[tuple[Callable[[Any], Any], Callable[[], int]]]:
    """Count the samples that pass the depth test, where OpenGL counts no fragments: as many, with one a pixel."""
    statistics = Statistics(device, "samples")
    yield lambda commands: statistics.count(), lambda: statistics.read()["samples_passed"]
    statistics.close()


@contextmanager
def fragments_of(renderer: Any, name: str) -> Iterator[Callable[[], int]]:
    """Count the fragments that a pass runs in one frame; what is yielded reads the number after it."""
    counted = next(one for one in renderer.passes if one.name == name)
    counts = fragments if renderer.device.has("pipeline-statistics") else samples
    with counts(renderer.device) as (counting, read):
        draw = counted.record

        def record(commands: Any) -> None:
            with counting(commands):
                draw(commands)

        counted.record = record
        yield read


@pytest.mark.parametrize(("coarse", "radius"), [("2x2", RADIUS), ("4x4", RADIUS), ("2x2", 0.0), ("2x2", 4.0)])
def test_fragments_that_the_mask_leaves_out_are_not_run(chapter, lamps, coarse, radius):
    """A discard would count. With no fine texel, or with nothing but those, one of the passes runs none."""
    if chapter.backend == "vulkan" and not chapter.device.has("pipeline-statistics"):
        pytest.skip("the device counts no fragments")
    block = int(coarse[0])
    names = ("lighting_blocks", "lighting_pixels")
    with (
        opened(chapter, lamps, inspect=False, rate_coarse=coarse, rate_radius=radius) as renderer,
        ExitStack() as stack,
    ):
        reads = [stack.enter_context(fragments_of(renderer, name)) for name in names]
        renderer.render(YARD).image("color")
        blocks, pixels = (read() for read in reads)
        fine = by_pixel(radial(radius=radius))
        of_blocks = ~fine[::block, ::block]  # a block at the edge of the picture has its first pixel in it
        if renderer.capabilities.is_software:
            assert (blocks, pixels) == (of_blocks.sum(), fine.sum())
        else:  # hardware runs whole quads of fragments; texels are made of whole quads, but for the picture's edge
            assert of_blocks.sum() <= blocks <= 1.1 * of_blocks.sum()
            assert fine.sum() <= pixels <= 1.1 * fine.sum()


@pytest.mark.feature("vrs/detection-and-fallback")
def test_what_is_off_has_no_pass_image_or_pipeline(chapter, lamps):
    bare: dict[str, Any] = {}
    for turned in ({"rate_policy": "none"}, {"rate_policy": "none", "rate_fragments": "auto"}):
        with opened(chapter, lamps, inspect=False, **turned) as renderer:
            renderer.render(YARD).image("color")
            found = {
                "passes": [step.name for step in renderer.graph.steps],
                "images": sorted(renderer.graph.resources),
                "pipelines": sorted(
                    built.described.title for it in renderer.passes for built in it.pipelines
                ),
            }
        assert not bare or found == bare
        bare = found
    assert "lighting" in bare["passes"] and not PASSES & {*bare["passes"]}
    with opened(chapter, lamps, inspect=False) as renderer:
        renderer.render(YARD).image("color")
        steps = {step.name for step in renderer.graph.steps}
        assert steps >= PASSES and "lighting" not in steps and "rate_edges" not in steps
        assert len(renderer.graph.resources) == len(bare["images"]) + 4
