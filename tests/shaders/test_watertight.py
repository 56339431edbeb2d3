"""The triangle test without gaps on both backends, against fractions and float64."""

from __future__ import annotations

import numpy as np
import pytest

from backends.shader_text import build_text
from backends.vulkan.shaders.compiler import compile_shader
from tests.support.either import evaluate
from tests.twins.rays import moeller_trumbore, sign_of_difference

UNIT = 2.0**-24
software = pytest.mark.feature("ray-tracing/software-bvh")
BODY = """
    ShearedRay ray = sheared_ray(origin, direction);
    bool backwards;
    t = 0.0;
    hit = hits_triangle(ray, a, b, c, t, at, backwards) ? 1u : 0u;
    back = backwards ? 1u : 0u;
"""
RESULTS = {"t": "float", "at": "vec2", "hit": "uint", "back": "uint"}


def hits(device, corners, origins, directions):
    """Return what the shader says of rays (N, 3) against triangles (N, 3, 3)."""
    corners = np.float32(corners)
    given = {"origin": np.float32(origins), "direction": np.float32(directions)}
    given |= {name: np.ascontiguousarray(corners[:, i]) for i, name in enumerate("abc")}
    return evaluate(device, ["watertight.glsl"], BODY, given, RESULTS)


def some(count, seed=1):
    """Return triangles and rays towards places in and beside them, in every direction."""
    rng = np.random.default_rng(seed)
    corners = np.float32(rng.normal(size=(count, 1, 3)) + rng.normal(size=(count, 3, 3)))
    weights = rng.dirichlet((1, 1, 1), count) * 1.6 - 0.2
    aim = (np.float64(corners) * (weights / weights.sum(axis=1, keepdims=True))[..., None]).sum(axis=1)
    origins = np.float32(aim + rng.normal(size=(count, 3)) * 3)
    directions = np.float32((aim - origins) * 10.0 ** rng.uniform(-2, 2, (count, 1)))
    return corners, origins, directions


@software
def test_hits_are_those_of_float64(either_device):
    """Away from edges; edge functions are off by 2 u of squares of distances, over the area that the ray sees."""
    corners, origins, directions = some(20000)
    got = hits(either_device, corners, origins, directions)
    t, u, v, inside = moeller_trumbore(corners, origins, directions)
    exact = np.float64(corners)
    normal = np.cross(exact[:, 1] - exact[:, 0], exact[:, 2] - exact[:, 0])
    unit = np.float64(directions) / np.linalg.norm(directions.astype(np.float64), axis=1, keepdims=True)
    seen = np.abs((normal * unit).sum(axis=1))
    far = np.linalg.norm(exact - np.float64(origins)[:, None], axis=2).max(axis=1)
    # Corners move by 6 u of their distance from the origin, and the edges they end are at most twice that long.
    bound = 40 * UNIT * far * far / seen
    sure = np.abs(inside) > bound
    assert sure.mean() > 0.99
    assert np.array_equal(got["hit"][sure] == 1, inside[sure] > 0)
    hit = sure & (got["hit"] == 1)
    assert 0.3 < hit.mean() < 0.9
    assert (np.abs(got["at"] - np.stack([u, v], axis=1))[hit].max(axis=1) <= bound[hit]).all()
    length = np.linalg.norm(directions.astype(np.float64), axis=1)
    assert (np.abs(got["t"] - t) * length <= bound * far)[hit].all()
    assert np.array_equal(got["back"][hit] == 1, ((normal * unit).sum(axis=1) > 0)[hit])


@software
def test_signs_of_differences_are_exact(either_device):
    """Products that are equal, one unit apart, of both signs, tiny and huge, and with zeros."""
    rng = np.random.default_rng(3)
    a, b = np.float32(rng.uniform(1, 2, (2, 4000)) * 2.0 ** rng.integers(-60, 60, (2, 4000)))
    c, d = b.copy(), a.copy()
    c[1000:2000] = np.nextafter(c[1000:2000], np.float32(1e30))
    d[2000:3000] = np.nextafter(d[2000:3000], np.float32(0))
    c[1500:1800], d[1500:1800] = c[1500:1800] * 2, np.nextafter(d[1500:1800], np.float32(0)) / 2
    sign = rng.choice(np.float32([-1, 1]), (3, 4000))
    a, b, c, d = a * sign[0], b * sign[1], c * sign[0], d * sign[1]
    d[3500:] *= sign[2][3500:]
    odd = np.float32([0.0, -0.0, 1.0, -1.0, 2.0**-74, 3.0**-40, 1e18, 1 + 2**-23, 1 - 2**-24])
    grid = np.stack(np.meshgrid(odd, odd, odd, odd), axis=-1).reshape(-1, 4)
    values = np.concatenate([np.stack([a, b, c, d], axis=1), grid])
    got = evaluate(
        either_device,
        ["watertight.glsl"],
        "difference = exact_difference(v.x, v.y, v.z, v.w);",
        {"v": values},
        {"difference": "float"},
    )["difference"]
    truth = np.array([sign_of_difference(*row) for row in values])
    assert np.array_equal(np.sign(got), truth)
    assert set(truth) == {-1, 0, 1}
    near = np.abs(np.float64(values[:, 0]) * values[:, 1] - np.float64(values[:, 2]) * values[:, 3])
    checked = (truth != 0) & (np.arange(len(truth)) < 3500) & (near > 2.0**-100)
    assert (np.abs(np.abs(got[checked]) / near[checked] - 1) < 1e-6).all()


def fan(count, seed):
    """Return fans of six triangles around a common corner each, (count, 6, 3, 3), and that corner."""
    rng = np.random.default_rng(seed)
    middle = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 3, (count, 1))
    size = np.linalg.norm(middle, axis=1) * 10.0 ** rng.uniform(-3, 0, count)
    x, y = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0].transpose(1, 0, 2)[:2]
    turn = np.arange(7) % 6 * np.pi / 3
    rim = middle[:, None] + size[:, None, None] * (
        np.cos(turn)[:, None] * x[:, None] + np.sin(turn)[:, None] * y[:, None]
        + 0.1 * rng.normal(size=(count, 6, 3))[:, np.arange(7) % 6]
    )  # fmt: skip
    common = np.broadcast_to(middle[:, None], (count, 6, 3))
    return np.float32(np.stack([common, rim[:, :6], rim[:, 1:]], axis=2)), np.float32(middle)


@software
@pytest.mark.parametrize("place", ["corner", "edge"])
def test_no_ray_slips_through_a_fan(either_device, place):
    """Rays aimed at a corner that six triangles share, and at their common edges, hit one of them at least."""
    count = 4000
    triangles, middle = fan(count, 7)
    rng = np.random.default_rng(8)
    # From a side on which the fan does not fold over: in front of it, up to 60 degrees off its normal.
    normal = np.cross(triangles[:, 0, 1] - middle, triangles[:, 2, 1] - middle).astype(np.float64)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    size = np.linalg.norm(triangles[:, :, 1] - middle[:, None], axis=2).max(axis=1, keepdims=True)
    tilt = rng.normal(size=(count, 3)) * 0.3
    part = rng.uniform(0, 1, (count, 1)) if place == "edge" else 0.0
    aim = middle + part * (triangles[:, 1, 1] - middle).astype(np.float64)
    origins = np.float32(aim + (normal + tilt) * size * 10.0 ** rng.uniform(0, 2, (count, 1)))
    directions = np.float32(aim - origins)
    got = hits(
        either_device,
        triangles.reshape(-1, 3, 3),
        np.repeat(origins, 6, axis=0),
        np.repeat(directions, 6, axis=0),
    )
    assert (got["hit"].reshape(count, 6).sum(axis=1) > 0).all()


@software
def test_exactly_on_edges_and_corners(either_device):
    """Two triangles of a square with whole coordinates: the diagonal and all corners belong to it."""
    square = np.float32([[(0, 0, 0), (4, 0, 0), (4, 4, 0)], [(0, 0, 0), (4, 4, 0), (0, 4, 0)]])
    places = np.float32([(x, y, 0) for x in range(-1, 6) for y in range(-1, 6)])
    for direction in np.float32([(0, 0, -1), (0, 0, 2), (0.5, 0.25, -1), (-1, 2, 4)]):
        origins = places - direction
        both = [
            hits(either_device, np.repeat(half[None], len(places), axis=0), origins, 0 * places + direction)
            for half in square
        ]  # fmt: skip
        hit = (both[0]["hit"] | both[1]["hit"]) == 1
        assert np.array_equal(hit, ((places[:, :2] >= 0) & (places[:, :2] <= 4)).all(axis=1))
        assert np.array_equal((both[0]["hit"] & both[1]["hit"]) == 1, hit & (places[:, 0] == places[:, 1]))
        assert (both[0]["t"][both[0]["hit"] == 1] == 1.0).all()


@software
def test_slivers_whose_products_are_equal_once_rounded(either_device):
    """Corners some roundings off a diagonal, on both sides of the ray: whole numbers decide, as fractions do here."""
    rng = np.random.default_rng(9)
    count = 6000
    places = (1 + rng.integers(0, 9, (count, 3, 2)) * 2.0**-23) * rng.choice([-1, 1], (count, 3, 1))
    corners = np.float32(np.concatenate([places, np.zeros((count, 3, 1))], axis=2))
    rays = np.broadcast_to(np.float32((0, 0, 1)), (count, 3))
    got = hits(either_device, corners, rays, -rays)["hit"] == 1
    signs = np.array([
        [sign_of_difference(q[0], p[1], q[1], p[0]) for p, q in ((a, b), (b, c), (c, a))] for a, b, c in corners
    ])  # fmt: skip
    inside = ((signs >= 0).all(axis=1) | (signs <= 0).all(axis=1)) & (signs != 0).any(axis=1)
    assert 0.02 < inside.mean() < 0.6
    assert np.array_equal(got, inside)


@software
def test_equal_corners_and_what_is_no_number_are_never_hit(either_device):
    corners, origins, directions = some(3000, 5)
    aim = np.float64(corners).mean(axis=1)
    directions = np.float32(aim - origins)
    for odd in (np.nan, np.inf, -np.inf):
        broken = corners.copy()
        broken[np.arange(3000), np.arange(3000) % 3, np.arange(3000) // 3 % 3] = odd
        assert not hits(either_device, broken, origins, directions)["hit"].any()
    for pair in ((0, 1), (1, 2), (2, 0)):
        flat = corners.copy()
        flat[:, pair[0]] = flat[:, pair[1]]
        aim = np.float64(flat[:, pair[0]])
        assert not hits(either_device, flat, origins, np.float32(aim - origins))["hit"].any()
    assert hits(either_device, corners, origins, directions)["hit"].all()


@software
def test_edge_functions_must_not_be_contracted():
    """Each of their products and differences is decorated NoContraction (SPIR-V 3.20).

    The software drivers fuse nothing in any case, so that hits alone would not show a missing `precise`.
    """
    text = """#include "watertight.glsl"
        layout(local_size_x = 1) in;
        layout(BIND(0, 0, 0), std430) buffer Data_ { vec4 data[8]; };
        void main() { float t; vec2 at; bool back;
            ShearedRay ray = sheared_ray(data[0].xyz, data[1].xyz);
            bool hit = hits_triangle(ray, data[2].xyz, data[3].xyz, data[4].xyz, t, at, back);
            data[5] = vec4(t, at, hit ? 1.0 : 0.0); }
    """
    words = np.frombuffer(compile_shader(build_text(text, "comp", "vulkan")), np.uint32)
    decorated, scalar_subtractions, vector_subtractions, at = set(), set(), set(), 5
    while at < len(words):
        operation, size = words[at] & 0xFFFF, words[at] >> 16
        if operation == 71 and words[at + 2] == 42:
            decorated.add(words[at + 1])
        elif operation == 131:
            (scalar_subtractions if words[at + 1] else vector_subtractions).add(words[at + 2])
        at += size
    # Three edge functions; the difference with the origin; two rows of the shear.
    assert len(decorated & scalar_subtractions) >= 6
