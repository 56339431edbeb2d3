"""Where rays leave triangles, on both backends: no ray meets its triangle again, and none begins behind a near one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate

offsets = pytest.mark.feature("ray-tracing/self-intersection-offset")
FILES = ["watertight.glsl", "ray_offset.glsl"]
BODY = """
    mat3x4 world_from_object = mat3x4(row0, row1, row2);
    vec3 direction = vec3(inverse0.w, inverse1.w, inverse2.w), a = a_u.xyz, b = b_v.xyz;
    SurfacePoint point = surface_point(world_from_object, a, b, c, vec2(a_u.w, b_v.w));
    position_offset = vec4(point.position, point.offset);
    normal = point.normal;
    vec3 origin = PLAIN ? point.position : ray_origin(point, direction);
    // As a traversal does: the ray goes to object space.
    mat3 inverse = mat3(inverse0.xyz, inverse1.xyz, inverse2.xyz);
    vec3 there = (origin - vec3(row0.w, row1.w, row2.w)) * inverse, turned = direction * inverse;
    float t;
    vec2 at_;
    bool back;
    bool again = hits_triangle(sheared_ray(there, turned), a, b, c, t, at_, back) && t > 0.0;
    origin_again = vec4(origin, again ? 1.0 : 0.0);
"""
RESULTS = {"position_offset": "vec4", "normal": "vec3", "origin_again": "vec4"}


def case(count, seed, scale=1.0, away=0.0, instanced=True):
    """Return inputs, triangles in the world, their normals and the rays; half of these run nearly along the
    triangle."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) * 5 + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(
        -2, 1, (count, 1, 1)
    )
    matrix = np.tile(np.eye(4), (count, 1, 1))
    if instanced:
        turn = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]  # of both signs
        matrix[:, :3, :3] = turn * 10.0 ** rng.uniform(-1, 1, (count, 1, 3))
        matrix[:, :3, 3] = rng.normal(size=(count, 3)) * 10
    matrix[:, :3] *= scale
    matrix[:, :3, 3] += away * np.array([1.0, -0.7, 0.4]) * (1 if instanced else 0)
    corners = np.float32(corners if instanced else corners * scale + away * np.array([1.0, -0.7, 0.4]))
    if not instanced:
        matrix = np.tile(np.eye(4), (count, 1, 1))
    matrix = np.float64(np.float32(matrix))
    inverse = np.linalg.inv(matrix)
    weights = rng.dirichlet((1, 1, 1), count)
    world = np.einsum("nij,nkj->nki", matrix[:, :3, :3], np.float64(corners)) + matrix[:, None, :3, 3]
    e1, e2 = world[:, 1] - world[:, 0], world[:, 2] - world[:, 0]
    normal = np.cross(e1, e2)
    with np.errstate(all="ignore"):
        aspect = np.linalg.norm(e1, axis=1) * np.linalg.norm(e2, axis=1) / np.linalg.norm(normal, axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.linalg.det(matrix[:, :3, :3]))[:, None]
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    along = rng.random(count) < 0.5
    flat = directions - (directions * normal).sum(axis=1, keepdims=True) * normal
    lift = normal * (rng.choice([-1, 1], count) * 10.0 ** rng.uniform(-6, -1, count))[:, None]
    directions = np.where(along[:, None], flat + lift, directions)
    given = {f"row{i}": matrix[:, i] for i in range(3)} | {f"inverse{i}": inverse[:, i, :3] for i in range(3)}
    given |= {name: corners[:, i] for i, name in enumerate("abc")}
    given |= {"at": weights[:, 1:], "direction": directions}
    kept = np.isfinite(aspect) & (aspect < 100)
    given = {name: np.ascontiguousarray(values[kept], np.float32) for name, values in given.items()}
    return given, world[kept], normal[kept], np.float64(given["direction"])


def run(device, given, plain=False):
    """Return position, offset, normal, origin, and whether the ray meets the triangle again.

    OpenGL drivers have room for few storage buffers, so what belongs together shares one: there are twelve.
    """
    packed = {name: given[name] for name in ("row0", "row1", "row2", "c")}
    packed |= {
        f"inverse{i}": np.column_stack([given[f"inverse{i}"], given["direction"][:, i]]) for i in range(3)
    }
    packed |= {"a_u": np.column_stack([given["a"], given["at"][:, 0]])}
    packed |= {"b_v": np.column_stack([given["b"], given["at"][:, 1]])}
    got = evaluate(device, FILES, BODY, packed, RESULTS, defines={"PLAIN": "true" if plain else "false"})
    place, start = got["position_offset"], got["origin_again"]
    return {
        "position": place[:, :3],
        "offset": place[:, 3],
        "normal": got["normal"],
        "origin": start[:, :3],
        "again": start[:, 3] != 0.0,
    }


@offsets
@pytest.mark.parametrize("instanced", [True, False])
@pytest.mark.parametrize(("scale", "away"), [(1.0, 0.0), (1e-3, 0.0), (1e3, 0.0), (1.0, 1e5)])
def test_no_ray_meets_the_triangle_that_it_leaves(either_device, scale, away, instanced):
    given, world, normal, directions = case(20000, 11, scale, away, instanced)
    got = run(either_device, given)
    assert not got["again"].any()
    # The origin is on the side to which the ray leads, in float64.
    height = ((np.float64(got["origin"]) - world[:, 0]) * normal).sum(axis=1)
    side = np.sign((directions * np.float64(got["normal"])).sum(axis=1))
    assert (height * side > 0).all()
    # It is as near as the numbers allow: within some dozens of roundings of coordinates and edges.
    reach = np.abs(world).max(axis=(1, 2)) + (
        np.abs(np.stack([given[f"row{i}"][:, 3] for i in range(3)])).max(axis=0)
    )
    edges = np.abs(world - world[:, :1]).max(axis=(1, 2))
    assert (got["offset"] <= 2.0**-24 * (80 * reach + 300 * edges)).all()
    assert (np.abs(height) <= 2.1 * got["offset"]).all()
    # Without an offset many a ray meets its own triangle.
    assert run(either_device, given, plain=True)["again"].mean() > 0.02


@offsets
def test_positions_and_normals_are_those_of_float64(either_device):
    given, world, normal, _ = case(20000, 12)
    got = run(either_device, given)
    at = np.float64(given["at"])
    exact = world[:, 0] + at[:, :1] * (world[:, 1] - world[:, 0]) + at[:, 1:] * (world[:, 2] - world[:, 0])
    reach = np.abs(world).max(axis=(1, 2)) + 30
    assert (np.abs(got["position"] - exact).max(axis=1) <= 2.0**-24 * 30 * reach).all()
    assert (np.linalg.norm(got["normal"] - normal, axis=1) < 1e-4).all()
    assert np.abs(np.linalg.norm(got["normal"], axis=1) - 1).max() < 1e-6


@offsets
def test_a_sheet_just_behind_is_not_reached(either_device):
    """No leak: a parallel sheet that is 1e-4 of the scene away is not behind the origin of a ray, at each scale."""
    for scale in (1e-3, 1.0, 1e3):
        given, world, _, _ = case(5000, 13, scale, instanced=False)
        got = run(either_device, given)
        size = np.abs(world).max()
        assert (got["offset"] < 1e-4 * size).all()
