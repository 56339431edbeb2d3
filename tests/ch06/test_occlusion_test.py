"""The occlusion test of shaders: no object of which a pixel is visible is rejected, and what is well hidden is.

Pictures of depth are ray-cast in float64, and so is each object, pixel by pixel, which says whether it is visible.
"""

from __future__ import annotations

from copy import copy
from functools import cache

import numpy as np
import pytest

from chapters import ch06
from common.numerics.transforms import orthographic, perspective
from tests.support.kernels import kernels_on
from tests.twins.bounds import pyramid_levels

pytestmark = pytest.mark.variants("vulkan", "gl")  # the kernel needs nothing that a device may lack
occlusion_test = pytest.mark.feature("culling/occlusion-test")

KERNEL = """
layout(local_size_x = 64) in;
struct Push { uvec4 numbers; };  // width and height of the picture, number of objects
PUSH(Push, push)
layout(BIND(0, 0, 0), std430) readonly buffer Pyramid_ { float pyramid[]; };
layout(BIND(0, 1, 1), std430) readonly buffer Lens_ { mat4 clip_from_view; };
layout(BIND(0, 2, 2), std430) readonly buffer Spheres_ { vec4 spheres[]; };
layout(BIND(0, 3, 3), std430) readonly buffer Boxes_ { vec4 boxes[]; };
layout(BIND(0, 4, 4), std430) writeonly buffer Hidden_ { uvec2 hidden[]; };
#include "culling/pyramid.glsl"

bool is_hidden(Footprint footprint) {
    uvec2 picture = push.numbers.xy, first, last;
    if (!footprint.known) {
        return false;
    }
    pixel_rect(footprint, vec2(picture), first, last);
#ifdef ONE_TEXEL
    uvec2 size = last - first + 1u;
    uint level = uint(findMSB(max(max(size.x, size.y), 2u)));
    return footprint.nearest < pyramid_texel(level, (first + last) / 2u >> level, picture);
#else
    return footprint.nearest < farthest_depth(first, last, picture);
#endif
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.numbers.z) {
        bool flat_ = clip_from_view[3].w == 1.0;
        hidden[i] = uvec2(
            is_hidden(sphere_footprint(spheres[i].xyz, spheres[i].w, clip_from_view, flat_)),
            is_hidden(box_footprint(boxes[4u * i], boxes[4u * i + 1u], boxes[4u * i + 2u], boxes[4u * i + 3u]))
        );
    }
}
"""
LENSES = {"perspective": perspective(1.1, 1.5, 0.2), "orthographic": orthographic(8.0, 1.5, 0.5, 80.0)}
SIZES = [(96, 64), (131, 77)]
SHAPES = ("sphere", "box")


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch06.__name__) as made:
        yield made


@pytest.fixture
def rejected(kernels, tmp_path):
    """Return a function: (N, 2) bool, whether the test rejects each sphere and each box, with defines of the kernel."""
    file = tmp_path / "occlusion.comp"
    file.write_text(KERNEL, "utf-8")

    def run(scene, *defines):
        pipeline = kernels.pipeline(file, defines=tuple((name, 1) for name in defines))
        levels = pyramid_levels(scene.depth)
        arrays = [
            np.concatenate([level.reshape(-1) for level in levels]),
            scene.lens.T.astype(np.float32).copy(),
            np.column_stack([scene.centre, scene.radius]).astype(np.float32),
            scene.boxes_in_clip().astype(np.float32),
            np.zeros((len(scene.radius), 2), np.uint32),
        ]
        count = len(scene.radius)
        push = np.array([*scene.depth.shape[::-1], count, 0], np.uint32)
        arrays = [np.ascontiguousarray(array) for array in arrays]
        return kernels.run(pipeline, arrays, (count,), push)[4] != 0

    return run


class Scene:
    """A picture of depth (H, W) and objects: spheres, and boxes with the same centres, in view space."""

    def __init__(self, name, size, seed, count=120):
        rng = np.random.default_rng(seed)
        self.lens, (width, height) = LENSES[name], size
        self.lens = self.lens.astype(np.float32).astype(np.float64)
        ndc = np.stack(
            np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height), axis=-1
        )
        ndc = ndc * 2 - 1
        inverse = np.linalg.inv(self.lens)
        ends = [
            np.concatenate([ndc, np.broadcast_to((z, 1.0), ndc.shape)], axis=-1) @ inverse.T for z in (1, 0.5)
        ]
        begin, end = (one[..., :3] / one[..., 3:] for one in ends)
        self.origin, self.direction = begin, (end - begin) / (begin - end)[..., 2:]  # one metre along -z
        distance = 10.0 ** rng.uniform(-0.4, 1.7, count)
        across = rng.uniform(-1, 1, (count, 2)) / np.abs(np.diag(self.lens)[:2])
        across = across * (distance[:, None] if self.lens[3, 3] == 0 else 1.0)
        self.centre = np.column_stack([across, -distance]).astype(np.float32).astype(np.float64)
        self.radius = distance * 10.0 ** rng.uniform(-2.5, -0.3, count)
        self.radius = self.radius.astype(np.float32).astype(np.float64)
        q, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
        self.axes = q * (self.radius[:, None] * rng.uniform(0.02, 0.7, (count, 3)))[:, None, :]
        self.depth = np.zeros((height, width), np.float32)
        self.add_occluders(rng)

    def add_occluders(self, rng):
        """Draw walls with slits and holes, and a few large spheres, into the picture."""
        height, width = self.depth.shape
        for _ in range(3):
            wall = self.depth_at(np.full((height, width), rng.uniform(2, 20)))
            mask = np.ones((height, width), bool)
            for _ in range(rng.integers(1, 6)):
                x, y = rng.integers(0, width), rng.integers(0, height)
                w, h = rng.integers(1, 30, 2)
                mask[y : y + h, x : x + w] = False
            mask[:, : rng.integers(0, width // 2)] = False
            self.depth = np.where(mask, np.maximum(self.depth, wall), self.depth).astype(np.float32)
        for _ in range(4):
            centre = np.array([*rng.uniform(-3, 3, 2), -rng.uniform(4, 12)])
            seen = self.sphere_depth(centre, rng.uniform(0.5, 3))
            self.depth = np.maximum(self.depth, seen).astype(np.float32)

    def depth_at(self, along):
        """Return the depth of the points `along` (H, W) metres along the ray of each pixel, -1 for NaN."""
        points = self.origin + self.direction * along[..., None]
        clip = points @ self.lens[:, :3].T + self.lens[:, 3]
        return np.where(np.isnan(along) | (along < 0), -1.0, clip[..., 2] / clip[..., 3])

    def sphere_depth(self, centre, radius):
        """Return (H, W) the depth of a sphere, -1 where a pixel's centre misses it."""
        to_centre = centre - self.origin
        a = (self.direction**2).sum(axis=-1)
        b = (self.direction * to_centre).sum(axis=-1)
        c = (to_centre**2).sum(axis=-1) - radius**2
        square = b * b - a * c
        return self.depth_at(np.where(square >= 0, (b - np.sqrt(np.maximum(square, 0))) / a, np.nan))

    def box_depth(self, centre, axes):
        """Return (H, W) the depth of a box with half axes in the columns of `axes`, -1 where a pixel misses it."""
        inverse = np.linalg.inv(axes)
        begin, along = (self.origin - centre) @ inverse.T, self.direction @ inverse.T
        with np.errstate(divide="ignore"):
            one, other = (-1 - begin) / along, (1 - begin) / along
        enter, leave = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
        return self.depth_at(np.where(enter <= leave, enter, np.nan))

    def boxes_in_clip(self):
        """Return (N, 4, 4): centre and half axes of the boxes in clip space."""
        centre = self.centre @ self.lens[:, :3].T + self.lens[:, 3]
        axes = np.einsum("ij,njk->nki", self.lens[:, :3], self.axes)
        return np.concatenate([centre[:, None], axes], axis=1)

    def visible_and_hidden(self):
        """Return (N, 2) whether any pixel of a sphere and of a box is visible, and whether it is well hidden.

        An object is well hidden if everything around it is nearer, as far as the texels reach that the test may take.
        """
        visible, hidden = (np.zeros((len(self.radius), 2), bool) for _ in range(2))
        for number, (centre, radius, axes) in enumerate(
            zip(self.centre, self.radius, self.axes, strict=True)
        ):
            shapes = (self.sphere_depth(centre, radius), self.box_depth(centre, axes))
            for shape, depth in enumerate(shapes):
                covered = depth >= 0
                visible[number, shape] = (covered & (depth >= self.depth)).any()
                if covered.any():
                    hidden[number, shape] = self.is_well_hidden(covered, depth.max())
        return visible, hidden

    def is_well_hidden(self, covered, nearest):
        rows, columns = np.nonzero(covered.any(axis=1))[0], np.nonzero(covered.any(axis=0))[0]
        reach = 3 * max(np.ptp(rows), np.ptp(columns)) + 8
        around = self.depth[
            max(0, rows[0] - reach) : rows[-1] + reach, max(0, columns[0] - reach) : columns[-1] + reach
        ]
        return around.min() > 1.05 * nearest + 1e-5


@cache
def scene_and_truth(name, size, seed):
    """Return a scene, and what is visible and well hidden in it; the tests of both backends share them."""
    scene = Scene(name, size, seed)
    return scene, *scene.visible_and_hidden()


@cache
def gaps():
    """Return scenes behind a wall with a gap of one pixel, each with (N,) whether a sphere covers that pixel."""
    scene, rng = Scene("perspective", (61, 43), 8, count=60), np.random.default_rng(9)
    wall = scene.depth_at(np.full(scene.depth.shape, 0.3)).astype(np.float32)
    covered = [scene.sphere_depth(c, r) >= 0 for c, r in zip(scene.centre, scene.radius, strict=True)]
    scenes = []
    for _ in range(20):
        x, y = rng.integers(0, 61), rng.integers(0, 43)
        behind = copy(scene)
        behind.depth = wall.copy()
        behind.depth[y, x] = 0.0
        scenes.append((behind, np.array([mask[y, x] for mask in covered])))
    return scenes


every_lens = pytest.mark.parametrize("name", LENSES)


@occlusion_test
@pytest.mark.parametrize(
    ("name", "size"),
    [
        pytest.param(
            name, size, id=f"{name}-{size[0]}x{size[1]}", marks=[pytest.mark.long] * (place == other)
        )
        for place, name in enumerate(LENSES)
        for other, size in enumerate(SIZES)
    ],
)
def test_nothing_that_is_seen_is_rejected_and_what_is_well_hidden_is(rejected, name, size):
    rejections = 0
    for seed in range(2):
        scene, visible, hidden = scene_and_truth(name, size, seed)
        found = rejected(scene)
        assert not found[visible].any(), "an object of which a pixel is visible was rejected"
        assert found[hidden].all(), "an object was kept that is well hidden"
        assert visible.mean() > 0.1 and hidden.any(axis=0).all()
        rejections += found.sum() / (~visible).sum()
    assert rejections / 2 > 0.2


@occlusion_test
@every_lens
def test_behind_a_wall_everything_is_rejected_and_in_front_of_it_nothing(rejected, name):
    scene = copy(scene_and_truth(name, SIZES[1], 1)[0])
    nearest = -scene.centre[:, 2] - scene.radius
    for distance, some in ((0.6, True), (200.0, False)):
        scene.depth = scene.depth_at(np.full(scene.depth.shape, distance)).astype(np.float32)
        found = rejected(scene)
        assert not found[nearest < distance].any()
        assert found[nearest > 1.1 * distance + 0.5].all() and found.any() == some
    scene.depth = np.zeros_like(scene.depth)
    assert not rejected(scene).any(), "nothing hides behind the sky"


@occlusion_test
def test_a_gap_of_one_pixel_shows_what_is_behind_it(rejected):
    rejections = 0
    for scene, behind in gaps():
        found = rejected(scene)[:, 0]
        assert not found[behind].any()
        rejections += found.mean()
    assert rejections > 0.3 * len(gaps())


@occlusion_test
def test_one_texel_of_a_level_that_is_rounded_down_rejects_what_is_seen(rejected):
    """The control: without 2x2 texels of a level that is high enough, some pixels of an object are not looked at."""
    seen = lost = 0
    for scene, behind in gaps():
        found = rejected(scene, "ONE_TEXEL")[:, 0]
        seen += behind.sum()
        lost += found[behind].sum()
    assert lost > 0.2 * seen
