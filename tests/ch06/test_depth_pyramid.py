"""The depth pyramid: each texel of each level is the minimum of the depth below it, bit for bit, at any size."""

from __future__ import annotations

import numpy as np
import pytest

from chapters import ch06
from chapters.ch06.culling.pyramid import PyramidLayout
from chapters.ch06.pipelines.description import PipelineDescription
from chapters.ch06.pipelines.vulkan import CHAPTER
from tests.support.depth_pyramids import pyramid_of, sample_pipelines
from tests.support.kernels import kernels_on
from tests.twins.bounds import pyramid_levels

pytestmark = pytest.mark.variants("vulkan", "gl")  # the kernel needs nothing that a device may lack
depth_pyramid = pytest.mark.feature("culling/depth-pyramid")

KERNEL = CHAPTER / "culling" / "pyramid.comp"
SIZES = [
    *((1, 1), (2, 1), (1, 2), (1, 57), (129, 1), (3, 3), (5, 4)),
    *((64, 64), (65, 65), (63, 64), (127, 131), (509, 251), (4097, 3), (2, 4099)),
]


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch06.__name__) as made:
        yield made


def depths(size, seed=0):
    """Return (height, width) float32: a slope with noise, many pixels without a surface, and the values at the ends."""
    rng = np.random.default_rng(seed)
    width, height = size
    depth = rng.random((height, width), np.float32) * np.linspace(0.1, 1, width, dtype=np.float32)
    depth[rng.random((height, width)) < 0.001] = 0.0
    depth[rng.random((height, width)) < 0.05] = 1.0
    return depth


def assert_same(found, truth):
    assert [level.shape for level in found] == [level.shape for level in truth]
    for number, (level, true) in enumerate(zip(found, truth, strict=True), 1):
        assert np.array_equal(level.view(np.uint32), true.view(np.uint32)), f"level {number}"


@depth_pyramid
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_each_texel_is_the_minimum_of_the_depth_below_it(kernels, size):
    depth = depths(size)
    assert_same(
        pyramid_of(kernels, depth, PyramidLayout.of(size), kernels.pipeline(KERNEL)), pyramid_levels(depth)
    )


@depth_pyramid
def test_a_whole_picture_of_a_depth_format(kernels):
    depth = depths((1920, 1080))
    found = pyramid_of(
        kernels, depth, PyramidLayout.of((1920, 1080)), kernels.pipeline(KERNEL), format="d32f"
    )
    assert_same(found, pyramid_levels(depth))


@depth_pyramid
def test_levels_that_are_rounded_down_would_miss_the_last_pixels(kernels):
    """The control: in a chain of mips of odd sizes the farthest pixels, at the end, are below no texel."""
    depth = np.full((67, 131), 0.5, np.float32)
    depth[:, -1] = depth[-1] = 0.25
    levels = pyramid_of(kernels, depth, PyramidLayout.of((131, 67)), kernels.pipeline(KERNEL))
    halved = depth[:66, :130].reshape(33, 2, 65, 2).min(axis=(1, 3))
    assert (levels[0][:, -1] == 0.25).all() and (levels[0][-1] == 0.25).all()
    assert (halved == 0.5).all() and levels[-1][0, 0] == 0.25 != halved.min()


@depth_pyramid
@pytest.mark.parametrize("samples", [4])
def test_of_several_samples_the_farthest_counts(kernels, tmp_path, samples):
    rng = np.random.default_rng(5)
    depth = rng.random((37, 75, samples), np.float32)
    draw = sample_pipelines(kernels, PipelineDescription, tmp_path / "sample.frag", depth.shape)
    pipeline = kernels.pipeline(KERNEL, defines=(("SAMPLES", samples),))
    found = pyramid_of(kernels, depth, PyramidLayout.of((75, 37)), pipeline, samples=draw)
    assert_same(found, pyramid_levels(depth))
    assert (found[0] < pyramid_levels(depth[..., 0])[0]).any(), "one sample is not enough"


def test_a_depth_that_is_no_number_hides_nothing(kernels):
    depth = depths((70, 70)) * np.float32(0.5) + np.float32(0.25)
    depth[3, 5], depth[69, 69], depth[40, 1], depth[0, 0] = np.nan, -np.nan, np.inf, np.inf
    found = pyramid_of(kernels, depth, PyramidLayout.of((70, 70)), kernels.pipeline(KERNEL))
    assert_same(found, pyramid_levels(depth))
    assert found[0][1, 2] == found[0][34, 34] == found[-1][0, 0] == 0.0
    assert found[0][20, 0] > 0 and np.isfinite(found[0]).all()


# --- without a device ---


def test_the_layout_has_every_level_down_to_one_texel_without_gaps():
    for size in [*SIZES, (1920, 1080), (16384, 16384)]:
        layout = PyramidLayout.of(size)
        first = 0
        for number, level in enumerate(layout.levels, 1):
            expected = tuple(-(-side // 2**number) for side in size)
            assert (level.width, level.height) == expected == layout.extent(number) and level.first == first
            first += level.width * level.height
        assert layout.picture == first and layout.extent(len(layout.levels)) == (1, 1)
        assert len(layout.levels) == max(1, (max(size) - 1).bit_length())


def test_two_dispatches_are_enough_for_4096_pixels():
    assert [one.groups for one in PyramidLayout.of((64, 64)).reductions] == [(1, 1)]
    assert [one.groups for one in PyramidLayout.of((4096, 4096)).reductions] == [(64, 64), (1, 1)]
    assert [one.source for one in PyramidLayout.of((1920, 1080)).reductions] == [0, 6]
    assert [(one.source, one.groups) for one in PyramidLayout.of((4097, 3)).reductions] == [
        (0, (65, 1)),
        (6, (2, 1)),
        (12, (1, 1)),
    ]
    layout = PyramidLayout.of((1920, 1080))
    assert layout.constants(layout.reductions[1]).tolist() == [6, 1920, 1080, 0]
