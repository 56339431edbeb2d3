"""What temporal anti-aliasing reads from images, on both backends: histories, choices of motion; and coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from backends.gl.context import Context
from backends.gl.selftests import bench as gl_bench
from backends.vulkan.selftests import bench as vulkan_bench
from chapters.ch11.pipelines.vulkan import CHAPTER
from tests.support.either import evaluate
from tests.twins import taa as twin

UNIT = 2.0**-24
LARGEST = 65504.0


@pytest.fixture
def bench(either_device):
    module = gl_bench if isinstance(either_device, Context) else vulkan_bench
    with module.Bench(either_device) as made:
        yield made


def texture(bench, texels):
    """Return a texture (rgba32f) of texels (H, W, 4) float32, sampled by the nearest."""
    texels = np.ascontiguousarray(texels, np.float32)
    height, width, _ = texels.shape
    if isinstance(bench, gl_bench.Bench):
        return bench.texture("rgba32f", (width, height), [texels], gl_bench.NEAREST)
    return bench.texture("rgba32f", texels.view("V16")[..., 0])


READ = """
#include "{file}"
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0)) uniform sampler2D image;
layout(BIND(0, 1, 0), std430) readonly buffer Places {{ vec2 places[]; }};
layout(BIND(0, 2, 1), std430) writeonly buffer Found {{ vec4 found[]; }};
void main() {{
    uint i = gl_GlobalInvocationID.x;
    if (i < uint(places.length())) {{ vec2 place = places[i]; found[i] = {what}; }}
}}
"""


def read(bench, name, what, texels, places):
    """Return (N, 4) what an expression of `image` and `place` gives at places (N, 2)."""
    places = np.float32(places)
    output = bench.output(4 * len(places))
    source = READ.format(file=CHAPTER / "taa" / name, what=what)
    resources = [texture(bench, texels), bench.input(places), output]
    bench.dispatch(source, resources, (len(places) + 63) // 64)
    return bench.read(output, np.float32)[: 4 * len(places)].reshape(-1, 4)


def history(bench, name, texels, places):
    return read(bench, "history.glsl", f"vec4({name}(image, place), 0.0)", texels, places)[:, :3]


def picture(size=(13, 9), seed=1):
    """Return (H, W, 4) texels: some dark, some very bright, alpha is not to be read."""
    rng = np.random.default_rng(seed)
    texels = rng.random((size[1], size[0], 4)) * 10.0 ** rng.uniform(-8, 2, (size[1], size[0], 1))
    texels[2, 3, :3], texels[5, 7, :3] = LARGEST, (0, LARGEST, 1e-8)
    return np.float32(texels)


def centres(width, height):
    """Return (H * W, 2) float32 centres of texels as uv, four times: rounded in other ways, by an inverse or nearby."""
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    place = np.stack([x.ravel(), y.ravel()], axis=1) + np.float32(0.5)
    size = np.float32((width, height))
    divided = place / size
    return [
        divided,
        place * (np.float32(1) / size),
        np.nextafter(divided, np.float32(2)),
        np.nextafter(divided, np.float32(-1)),
    ]


FILTERS = {"bilinear": twin.bilinear, "catmull_rom": twin.catmull_rom}


@pytest.mark.feature("taa/history-sampling")
@pytest.mark.parametrize("name", FILTERS)
def test_a_texels_centre_is_that_texel_to_the_bit(bench, name):
    for size in ((13, 9), (1, 1), (333, 2), (2, 1021)):
        texels = np.float32(np.random.default_rng(4).random((size[1], size[0], 4)) * 100)
        for places in centres(*size):
            got = history(bench, name, texels, places)
            assert np.array_equal(got, texels[..., :3].reshape(-1, 3)), size


@pytest.mark.feature("taa/history-sampling")
@pytest.mark.parametrize("name", FILTERS)
def test_a_history_between_texels_is_the_sum_of_its_weights(bench, name):
    """Also beyond the border, where the border's texels are repeated."""
    texels = picture()
    places = np.float32(np.random.default_rng(2).uniform(-0.3, 1.3, (4000, 2)))
    got = history(bench, name, texels, places)
    truth = FILTERS[name](texels[..., :3].astype(np.float64), places.astype(np.float64))
    # The fraction between texels has the error of uv times 13, and the sum that times the largest texel near.
    at = np.float64(places) * (13, 9) - 0.5
    near = np.zeros(len(places))
    for down in range(-1, 3):
        for right in range(-1, 3):
            texel = (np.floor(at).astype(int) + np.array((right, down))).clip(0, (12, 8))
            near = np.maximum(near, texels[texel[:, 1], texel[:, 0], :3].max(axis=1))
    assert (np.abs(got - truth) <= 64 * UNIT * 13 * near[:, None] + 2.0**-126).all()
    assert (got >= 0).all()


@pytest.mark.feature("taa/history-sampling")
@pytest.mark.parametrize("name", FILTERS)
def test_constants_and_ramps_are_reproduced(bench, name):
    """A constant to the bit, everywhere; a linear field to rounding, where no texel is beyond the border."""
    places = np.float32(np.random.default_rng(3).uniform(0, 1, (3000, 2)))
    for value in ((0, 1e-8, LARGEST), (0.1, 0.7, 3.3)):
        texels = np.full((9, 13, 4), (*value, 1.0), np.float32)
        got = history(bench, name, texels, places)
        assert np.array_equal(got, np.broadcast_to(np.float32(value), got.shape))
    x, y = np.meshgrid(np.arange(13) + 0.5, np.arange(9) + 0.5)
    ramp = np.stack([3 * x, 2 * y + 1, x + 4 * y, 0 * x], axis=-1)
    inner = places * np.float32((9 / 13, 5 / 9)) + np.float32((2 / 13, 2 / 9))
    got = history(bench, name, ramp, inner)
    u, v = (np.float64(inner) * (13, 9)).T
    assert np.abs(got - np.stack([3 * u, 2 * v + 1, u + 4 * v], axis=-1)).max() < 2e-5


@pytest.mark.feature("taa/history-sampling")
def test_weights_of_catmull_rom_sum_to_one(either_device):
    f = np.float32(np.linspace(0, 1, 5001))
    body = "found = catmull_rom_weights(f);"
    got = evaluate(either_device, [str(CHAPTER / "taa" / "history.glsl")], body, {"f": f}, {"found": "vec4"})[
        "found"
    ]
    truth = np.stack([twin.cubic(f.astype(np.float64) - at, 0.0, 0.5) for at in (-1, 0, 1, 2)], axis=1)
    assert np.abs(got - truth).max() <= 8 * UNIT
    assert np.abs(got.astype(np.float64).sum(axis=1) - 1).max() <= 6 * UNIT
    assert -0.0742 < got.min() < -0.0735


@pytest.mark.feature("taa/history-sampling")
@pytest.mark.parametrize("name", FILTERS)
def test_a_texel_that_is_not_a_number_is_nothing(bench, name):
    """It counts as 0, an infinity as the largest colour: neither spreads."""
    texels = picture()
    texels[4, 6, 1] = np.nan
    texels[6, 2, 0], texels[7, 2, 2] = np.inf, -np.inf
    meant = texels.copy()
    meant[4, 6, 1], meant[6, 2, 0], meant[7, 2, 2] = 0.0, LARGEST, 0.0
    places = np.concatenate(
        [np.float32(np.random.default_rng(5).uniform(0, 1, (2000, 2))), centres(13, 9)[0]]
    )
    got = history(bench, name, texels, places)
    assert np.isfinite(got).all()
    assert np.array_equal(got, history(bench, name, meant, places))
    assert not np.array_equal(got, history(bench, name, picture(), places)), "those texels are seen"
    far = history(bench, name, texels, [(1e30, -1e30), (np.inf, 0.5), (np.nan, np.nan)])
    assert np.isfinite(far).all() and np.array_equal(far[0], texels[0, 12, :3])


# --- the vector that a pixel follows ----------------------------------------------------------------------------------


def pixels(width, height):
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def depths():
    """Return (9, 13) reversed depths: sky, a near object with a silhouette, and equal ones beside each other."""
    depth = np.zeros((9, 13), np.float32)
    depth[2:6, 3:8] = 0.25
    depth[4, 5:12] = 0.75
    depth[7:, 9:] = np.random.default_rng(1).random((2, 4))
    return depth


@pytest.mark.feature("taa/velocity-selection")
def test_the_closest_pixel_of_nine_is_that_of_the_cpu(bench):
    depth = depths()
    texels = np.repeat(depth[..., None], 4, axis=2)
    texels[..., 1:] = 9.0  # is not read
    what = "vec4(closest(image, ivec2(place)), 0, 0)"
    got = read(bench, "velocity.glsl", what, texels, pixels(13, 9))[:, :2].reshape(9, 13, 2)
    assert np.array_equal(got, twin.closest(depth.astype(np.float64)))
    silhouette, sky = got[1, 4], got[8, 1]
    assert silhouette.tolist()[1] == 2, "outside an edge the object's own pixel is followed"
    assert sky.tolist() == [1, 8], "sky alone stays where it is"
    around = read(bench, "velocity.glsl", what, texels, [(-5, -7), (99, 4)])[:, :2]
    assert around.tolist() == [[0, 0], [12, 4]]


@pytest.mark.feature("taa/velocity-selection")
def test_the_longest_vector_of_nine_is_that_of_the_cpu(bench):
    rng = np.random.default_rng(6)
    motion = np.zeros((9, 13, 2), np.float32)
    motion[1:5, 2:9] = rng.normal(0, 0.1, (4, 7, 2))
    motion[6, 6], motion[6, 7] = (0.13, 0.0), (0.0, 0.15)  # 1.69 pixels, and 1.35: longer in uv alone
    texels = np.concatenate([motion, np.full_like(motion, 7.0)], axis=2)
    what = "vec4(longest(image, ivec2(place)), 0, 0)"
    got = read(bench, "velocity.glsl", what, texels, pixels(13, 9))[:, :2].reshape(9, 13, 2)
    assert np.array_equal(got, twin.longest(motion.astype(np.float64)).astype(np.float32))
    assert np.array_equal(got[6, 7], motion[6, 6])
    assert (got[8] == 0).all() and (got != motion).any()


# --- coordinates ------------------------------------------------------------------------------------------------------

PLANE = """
layout(location = 0) out vec2 uv;
void main() {{
    vec2 at = vec2(VERTEX_ID == 1 ? 12 : -4, VERTEX_ID == 2 ? 12 : -4);
    uv = vec2(0.25 * at.x - 0.1 * at.y, 0.15 * at.x + 0.3 * at.y);
    float w = 4.0 + {slope} * at.x + 0.5 * {slope} * at.y;
    gl_Position = vec4(at * 1.3, 0.5 * w, w);
    gl_Position.xy += vec2({x}, {y}) * w;
}}
"""
SHOWN = """
#include "{file}"
layout(location = 0) in vec2 uv;
layout(location = 0) out uint found;
void main() {{
    vec2 at = {what};
    found = floatBitsToUint(at[{axis}]);
}}
"""
SIDE = 16


def drawn(bench, slope, shift, what):
    """Return (16, 16, 2): coordinates of a plane that is drawn with a shift in pixels."""
    in_ndc = [repr(2.0 * part / SIDE) for part in shift]
    vertex = PLANE.format(slope=repr(slope), x=in_ndc[0], y=in_ndc[1])
    found = []
    for axis in (0, 1):
        fragment = SHOWN.format(file=CHAPTER / "taa" / "unjitter.glsl", what=what, axis=axis)
        if isinstance(bench, gl_bench.Bench):
            program = bench.graphics(vertex, fragment)
            words = bench.render(program, lambda: bench.fn.glDrawArrays(0x0004, 0, 3))
        else:
            program = bench.graphics({"vert": vertex, "frag": fragment})
            words = bench.render(
                program, (SIDE, SIDE), lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0)
            )
        found.append(words.view(np.float32).reshape(SIDE, SIDE))
    return np.stack(found, axis=-1).astype(np.float64)


@pytest.mark.feature("taa/uv-unjitter")
@pytest.mark.parametrize("shift", [(0.375, -0.25), (-0.5, 0.4375)])
def test_corrected_coordinates_are_those_without_the_shift(bench, shift):
    """Facing the camera to rounding. On a slanted plane the slope is that of one pixel, and its change is left."""
    what = f"unjittered(uv, vec2({shift[0]!r}, {shift[1]!r}))"
    for slope, bound in ((0.0, 2e-6), (0.01, 1e-4)):
        steady, moved = drawn(bench, slope, (0, 0), "uv"), drawn(bench, slope, shift, "uv")
        fixed = drawn(bench, slope, shift, what)
        assert np.ptp(steady, axis=(0, 1)).min() > 1.0
        assert np.abs(moved - steady).max() > 0.02
        assert np.abs(fixed - steady).max() < bound, slope
        other = drawn(bench, slope, shift, what.replace("uv, vec2(", "uv, -vec2("))
        assert np.abs(other - steady).max() > 0.04, "the other sign would be seen"
