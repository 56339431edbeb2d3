"""The tests of culling in `shaders/bounds.glsl`, on both backends: never visible taken for hidden, and tight.

The truths are points: of a sphere's surface, corners of boxes, vertices in float32, triangles on the screen
(tests/twins/bounds.py). Matrices of views go in as arrays of one matrix for each element.
"""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics.transforms import look_at, orthographic, perspective
from tests.support.drawing import draw
from tests.support.either import evaluate
from tests.twins import bounds as twin

BOUNDS = ["bounds.glsl"]
NAN, INFINITE = np.float32(np.nan), np.float32(np.inf)
NEAR = 0.1
sphere_projection = pytest.mark.feature("culling/sphere-projection")

LENSES = {
    "perspective": perspective(1.0, 1.6, NEAR),
    "narrow": perspective(0.05, 0.5, 2.0),
    "wide": perspective(2.6, 2.0, 1e-3),
    "orthographic": orthographic(3.0, 1.5, 0.5, 60.0),
}
JITTER = (0.013, -0.021)


def lens(name):
    """Return a projection with jitter, as float32 has it."""
    matrix = LENSES[name].copy()
    matrix[:2] += np.outer(JITTER, matrix[3])
    return matrix.astype(np.float32).astype(np.float64)


every_lens = pytest.mark.parametrize("name", LENSES)


def rows(matrices):
    """Return the rows of affine matrices (N, 3, 4) as inputs `row0` to `row2`."""
    matrices = np.asarray(matrices, np.float32)
    return {f"row{i}": np.ascontiguousarray(matrices[:, i]) for i in range(3)}


WORLD = "mat3x4 world_from_object = mat3x4(row0, row1, row2);"


def lens_text(name):
    """Return the declaration of a projection as a constant of GLSL."""
    numbers = ", ".join(repr(float(number)) for number in lens(name).T.reshape(-1))
    return f"const mat4 clip_from_view = mat4({numbers});"


def is_flat(name):
    return "true" if name == "orthographic" else "false"


# --- what transforms do -----------------------------------------------------------------------------------------------


def stretched(device, linear):
    matrices = np.concatenate([linear, np.ones((len(linear), 3, 1))], axis=2)
    body = f"{WORLD} result = stretch_bound(world_from_object);"
    return evaluate(device, BOUNDS, body, rows(matrices), {"result": "float"})["result"]


def rotations(rng, count):
    q, r = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    return q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]


def test_no_vector_is_stretched_more_than_the_bound_says(either_device):
    rng = np.random.default_rng(1)
    linear = rng.normal(size=(4000, 3, 3)) * 10.0 ** rng.uniform(-3, 3, (4000, 3, 1)) ** rng.integers(
        0, 2, (4000, 1, 1)
    )
    linear[:1000] *= 10.0 ** rng.uniform(-25, 25, (1000, 1, 1))
    linear[1000:1100, :, 2] = 0.0
    linear = linear.astype(np.float32)
    found, truth = stretched(either_device, linear), twin.largest_stretch(linear)
    assert (found >= truth).all()
    assert (found <= truth * np.sqrt(3) * 1.00001).all(), "the largest row sum of a 3x3 matrix is no larger"


def test_for_a_rotation_and_a_scale_the_bound_is_the_largest_scale(either_device):
    rng = np.random.default_rng(2)
    scale = 10.0 ** rng.uniform(-3, 3, (2000, 3)) * rng.choice([-1.0, 1.0], (2000, 3))
    linear = (rotations(rng, 2000) * scale[:, None, :]).astype(np.float32)
    found, largest = stretched(either_device, linear), np.abs(scale).max(axis=1)
    assert (found >= twin.largest_stretch(linear)).all()
    assert (found <= largest * (1 + 4e-6)).all()


def test_what_is_no_number_has_no_bound_and_nothing_has_the_bound_0(either_device):
    linear = np.tile(np.eye(3, dtype=np.float32), (8, 1, 1))
    linear[0, 1, 2], linear[1, 0, 0], linear[2, 2, 1] = NAN, INFINITE, -INFINITE
    linear[3] = NAN
    linear[4] = 0.0
    linear[5, 0, 0] = 3.4e38  # the sum of its entries is infinite
    linear[5, 1, 1] = 3.4e38
    found = stretched(either_device, linear)
    assert np.isnan(found[:4]).all() and found[4] == 0.0 and not found[5] < 3.4e38
    assert found[6] == pytest.approx(1.0, rel=4e-6)


FAR_VERTICES = f"""
    {WORLD}
    {lens_text("perspective")}
    mat4 view_from_world = mat4(v0, v1, v2, v3);
    view = matrix_times(view_from_world, vec4(transform_point(world_from_object, point), 1.0)).xyz;
    vec3 world = transform_point(world_from_object, centre);
    middle = matrix_times(view_from_world, vec4(world, 1.0)).xyz;
    vec3 half_edges = vec3(
        dot(abs(row0.xyz), extent), dot(abs(row1.xyz), extent), dot(abs(row2.xyz), extent)
    );
    rounding.x = view_rounding(view_from_world, object_reach(world_from_object, centre, extent));
    rounding.y = view_rounding(view_from_world, world_reach(world_from_object, world, half_edges));
    clip = matrix_times(clip_from_view, vec4(view, 1.0));
    shift = clip_rounding(clip_from_view, rounding.x);
"""


@pytest.mark.parametrize("far", [1.0, 1e5])
def test_no_vertex_is_farther_from_its_place_than_the_rounding_says(either_device, far):
    """Vertices up to 1e5 m from the origin, of objects that are scaled by 1e-3 to 1e3, some of them sheared."""
    rng, count = np.random.default_rng(int(far)), 4000
    scale = 10.0 ** rng.uniform(-3, 3, (count, 1))
    linear = rotations(rng, count) * (scale * rng.uniform(0.2, 1.0, (count, 3)))[:, None, :]
    linear[::4] = rng.normal(size=(count // 4, 3, 3)) * scale[::4, :, None]
    place, eye = rng.uniform(-far, far, (count, 3)), rng.uniform(-far, far, (count, 3))
    matrices = np.concatenate([linear, place[:, :, None]], axis=2).astype(np.float32)
    eye[::2] = place[::2] + rng.normal(size=(count // 2, 3)) * 3.0
    view = np.zeros((count, 4, 4))
    view[:, :3, :3] = rotations(rng, count)
    view[:, :3, 3] = -np.einsum("nij,nj->ni", view[:, :3, :3], eye)
    view[:, 3, 3] = 1.0
    view = view.astype(np.float32)
    extent = 10.0 ** rng.uniform(-1, 2, (count, 3)) / scale
    centre = rng.normal(size=(count, 3)) * extent
    point = np.float32(centre + extent * rng.uniform(-1, 1, (count, 3)))
    inputs = {
        **rows(matrices),
        **{f"v{j}": np.ascontiguousarray(view[:, :, j]) for j in range(4)},
        "point": point,
        "centre": np.float32(centre),
        "extent": np.float32(extent),
    }
    outputs = {"view": "vec3", "middle": "vec3", "rounding": "vec2", "clip": "vec4", "shift": "vec4"}
    got = evaluate(either_device, ["transform.glsl", *BOUNDS], FAR_VERTICES, inputs, outputs)

    def placed(points):
        world = np.einsum("nij,nj->ni", matrices[:, :, :3].astype(np.float64), points) + matrices[:, :, 3]
        return np.einsum("nij,nj->ni", view[:, :3, :3].astype(np.float64), world) + view[:, :3, 3]

    exact = placed(point.astype(np.float64))
    off = np.linalg.norm(got["view"] - exact, axis=1)
    middle_off = np.linalg.norm(got["middle"] - placed(inputs["centre"].astype(np.float64)), axis=1)
    assert (off + middle_off <= got["rounding"][:, 0]).all()
    assert (off + middle_off).max() > 1e-8 * far, "there is something to be bounded"
    plain = np.arange(count) % 4 != 0  # rotations and scales
    assert (off + middle_off <= got["rounding"][:, 1])[plain].all()
    truth = np.concatenate([exact, np.ones((count, 1))], axis=1) @ lens("perspective").T
    assert (np.abs(got["clip"] - truth) <= got["shift"] + 4 * 2.0**-24 * np.abs(truth)).all()


def test_no_sum_of_terms_is_longer_than_its_reach(either_device):
    """The terms of a vertex's coordinates in the world, in float64, for corners of boxes; scaled and turned objects."""
    rng, count = np.random.default_rng(15), 3000
    linear = rotations(rng, count) * (10.0 ** rng.uniform(-2, 2, (count, 3)))[:, None, :]
    extent = 10.0 ** rng.uniform(-2, 2, (count, 3))
    centre = rng.normal(size=(count, 3)) * extent * 10.0 ** rng.uniform(-2, 1, (count, 1))
    moved = np.einsum("nij,nj->ni", linear, centre)
    place = -moved * rng.uniform(0, 1.2, (count, 1))  # it cancels, more or less
    body = f"""{WORLD}
        own = object_reach(world_from_object, centre, extent);
        seen = world_reach(world_from_object, world, half_edges);
    """
    inputs = {
        **rows(np.concatenate([linear, place[:, :, None]], axis=2)),
        "centre": np.float32(centre),
        "extent": np.float32(extent),
        "world": np.float32(moved + place),
        "half_edges": np.float32(np.einsum("nij,nj->ni", np.abs(linear), extent)),
    }
    got = evaluate(either_device, BOUNDS, body, inputs, {"own": "vec3", "seen": "vec3"})
    corners = twin.box_corners(centre, *(extent * axis for axis in np.eye(3)))
    terms = np.einsum("nij,nkj->nki", np.abs(linear), np.abs(corners)) + np.abs(place)[:, None]
    longest = np.linalg.norm(terms, axis=2).max(axis=1) * (1 - 1e-6)
    assert (np.linalg.norm(got["own"], axis=1) >= longest).all()
    assert (np.linalg.norm(got["seen"], axis=1) >= longest).all()
    assert (np.linalg.norm(got["own"], axis=1) <= 1.001 * longest).all()


def test_a_projection_with_a_translation_rounds_as_well(either_device):
    rng = np.random.default_rng(16)
    view = np.float32(np.column_stack([rng.uniform(-5, 5, (4000, 2)), rng.uniform(-60, 0, 4000)]))
    body = f"""{lens_text("orthographic")}
        clip = matrix_times(clip_from_view, vec4(view, 1.0));
        shift = clip_rounding(clip_from_view, 0.0);
    """
    outputs = {"clip": "vec4", "shift": "vec4"}
    got = evaluate(either_device, ["transform.glsl", *BOUNDS], body, {"view": view}, outputs)
    truth = view @ lens("orthographic")[:, :3].T + lens("orthographic")[:, 3]
    error, own = np.abs(got["clip"] - truth), 4 * 2.0**-24 * np.abs(truth)
    assert (error <= got["shift"] + own).all()
    assert (error > own).any(), "its own roundings are not all"


# --- outside of the view ----------------------------------------------------------------------------------------------


def balls(name, count=4000, seed=3):
    """Return centres and radii of spheres in and around the frustum of a lens, of many sizes."""
    rng = np.random.default_rng(seed)
    matrix = lens(name)
    ndc = rng.uniform(-3, 3, (count, 2))
    if name == "orthographic":
        distance = rng.uniform(-20, 100, count)
        centre = np.column_stack([ndc / np.abs(np.diag(matrix)[:2]), -distance])
        radius = 10.0 ** rng.uniform(-2, 1.3, count)
    else:
        distance = matrix[2, 3] * 10.0 ** rng.uniform(-0.5, 5, count) * rng.choice([1, 1, 1, -1], count)
        centre = np.column_stack([ndc * distance[:, None] / np.abs(np.diag(matrix)[:2]), -distance])
        radius = np.abs(distance) * 10.0 ** rng.uniform(-4, 0.3, count) / np.diag(matrix)[0]
    return centre.astype(np.float32), radius.astype(np.float32)


def spheres_outside(device, name, centre, radius):
    call = f"sphere_outside(centre, radius, clip_from_view, {is_flat(name)})"
    body = f"{lens_text(name)} kept = uint(!{call});"  # as a kernel asks, so that NaN has to be on the right side
    return evaluate(device, BOUNDS, body, {"centre": centre, "radius": radius}, {"kept": "uint"})["kept"] == 0


@every_lens
def test_a_sphere_is_outside_where_a_plane_says_so(either_device, name):
    centre, radius = balls(name)
    found = spheres_outside(either_device, name, centre, radius)
    outside = twin.distances_outside(centre[:, None].astype(np.float64), lens(name)) - radius
    margin = 4e-6 * (np.linalg.norm(centre, axis=1) + radius + 1.0)
    assert not found[outside <= 0].any(), "a sphere that touches the frustum was left out"
    assert found[outside > margin].all()
    assert 0.1 < found.mean() < 0.95


@every_lens
def test_a_sphere_that_is_no_number_is_not_outside(either_device, name):
    centre, radius = np.tile(np.float32((1e4, 0, 5)), (6, 1)), np.full(6, np.float32(1.0))
    centre[0, 0], centre[1, 1], centre[2, 2] = NAN, NAN, INFINITE
    centre[3] = NAN
    radius[4], radius[5] = NAN, INFINITE
    assert not spheres_outside(either_device, name, centre, radius).any()


def boxes(name, count=4000, seed=4):
    """Return centre and half axes of boxes in clip space, each (N, 4) float32: in and around the frustum, turned."""
    rng = np.random.default_rng(seed)
    centre, radius = balls(name, count, seed)
    axes = rotations(rng, count) * (radius[:, None] * 10.0 ** rng.uniform(-1.5, 0, (count, 3)))[:, None, :]
    axes[: count // 8, :, 2] = 0.0  # flat
    axes[: count // 16, :, 1] = 0.0
    matrix = lens(name)
    clip = [centre @ matrix[:, :3].T + matrix[:, 3], *(axes[:, :, i] @ matrix[:, :3].T for i in range(3))]
    return [part.astype(np.float32) for part in clip]


BOX = "centre, x, y, z"


def box_inputs(parts):
    return dict(zip(("centre", "x", "y", "z"), parts, strict=True))


def boxes_outside(device, parts, rounding=None):
    inputs = box_inputs(parts)
    call = BOX
    if rounding is not None:
        inputs["rounding"], call = rounding, f"{BOX}, rounding"
    body = f"kept = uint(!box_outside({call}));"
    return evaluate(device, BOUNDS, body, inputs, {"kept": "uint"})["kept"] == 0


def clip_distances(corners):
    """Return (N,): how far corners (N, 8, 4) in clip space are outside of one plane, all of them."""
    x, y, z, w = np.moveaxis(corners, -1, 0)
    inside = np.stack([w + x, w - x, w + y, w - y, w - z, z])
    return -inside.max(axis=-1).min(axis=0)


@every_lens
def test_a_box_is_outside_where_all_corners_are_beyond_one_plane(either_device, name):
    parts = boxes(name)
    found = boxes_outside(either_device, parts)
    corners = twin.box_corners(*parts)
    outside = clip_distances(corners)
    assert not found[outside <= 0].any(), "a box was left out that no plane separates from the view"
    assert found[outside > 1e-5 * np.abs(corners).max(axis=(1, 2))].all()
    assert 0.1 < found.mean() < 0.95


@every_lens
def test_a_box_that_is_off_by_its_rounding_is_not_outside(either_device, name):
    """Each box is moved out of the view by what its corners may be off: then it might be inside."""
    parts = boxes(name)
    outside = clip_distances(twin.box_corners(*parts))
    shares = np.array([0.5, 0.5, 1.0, 0.5])  # x + w and w - z get theirs from two, z alone from one
    rounding = np.float32(np.maximum(outside, 1e-30)[:, None] * shares * 1.00001)
    assert boxes_outside(either_device, parts).any()
    assert not boxes_outside(either_device, parts, rounding).any()


def test_a_box_that_is_no_number_is_not_outside(either_device):
    for part in range(4):
        for place in range(4):
            for value in (NAN, INFINITE):
                parts = [np.float32([[9, 0, 0.1, 1]])] + [np.float32([[0.1, 0, 0, 0]])] * 3
                parts[part] = parts[part].copy()
                parts[part][0, place] = value
                if value == INFINITE and (part, place) in ((0, 0), (0, 1)):
                    continue  # infinitely far to the side
                assert not boxes_outside(either_device, parts).any(), (part, place, value)


# --- the part of the picture ------------------------------------------------------------------------------------------

FOOTPRINT = """
    low = footprint.low; high = footprint.high; nearest = footprint.nearest; known = uint(footprint.known);
"""
FOOTPRINT_OUTPUTS = {"low": "vec2", "high": "vec2", "nearest": "float", "known": "uint"}


def sphere_footprints(device, name, centre, radius):
    call = f"sphere_footprint(centre, radius, clip_from_view, {is_flat(name)})"
    body = f"{lens_text(name)} Footprint footprint = {call}; {FOOTPRINT}"
    got = evaluate(device, BOUNDS, body, {"centre": centre, "radius": radius}, FOOTPRINT_OUTPUTS)
    return got, got["known"] != 0


def in_front(name, count=300):
    """Return spheres wholly beyond the near plane, many of them close to it."""
    centre, radius = balls(name, 20 * count, seed=5)
    front = -centre[:, 2] - radius.astype(np.float64)
    near = 0.5 if name == "orthographic" else lens(name)[2, 3]
    kept = np.flatnonzero(front > near * 1.001)[:count]
    assert len(kept) == count
    return centre[kept], radius[kept]


@sphere_projection
@every_lens
def test_the_rectangle_encloses_the_sampled_sphere_and_no_more_than_a_thousandth_else(either_device, name):
    centre, radius = in_front(name)
    got, known = sphere_footprints(either_device, name, centre, radius)
    assert known.all()
    low, high = twin.sphere_extremes(centre, radius, lens(name))
    size = 1.0 + np.maximum(np.abs(low), np.abs(high))[:, :2].max(axis=1, keepdims=True)
    assert (got["low"] <= low[:, :2] + 1e-6 * size).all() and (got["high"] >= high[:, :2] - 1e-6 * size).all()
    excess = np.maximum(low[:, :2] - got["low"], got["high"] - high[:, :2])
    distance = -centre[:, 2].astype(np.float64)
    near = 1.0 if name == "orthographic" else (distance / (distance - radius))[:, None]
    assert (excess < 4e-6 * size * near).all(), "some roundings of the distance, for its nearest point"
    usual = (size * near < 300).all(axis=1)
    assert (excess[usual] < 2e-3).all() and usual.mean() > 0.9, "a thousandth in uv is 2e-3 in ndc"
    strictly = radius > 0.3 * distance  # a large sphere has a margin that is more than roundings of its place
    assert (got["low"] < low[:, :2])[strictly].all() and (got["high"] > high[:, :2])[strictly].all()
    assert (got["nearest"] > high[:, 2] * (1 + 9e-6) + (high - low)[:, 2] / 65).all()
    assert (got["nearest"] < high[:, 2] + (high - low)[:, 2] / 50 + 2e-5).all()


@sphere_projection
def test_the_projected_radius_would_not_enclose_a_sphere(either_device):
    """The control: radius / distance around the projected centre, as is often written, leaves parts of it out."""
    centre, radius = in_front("perspective")
    got, _ = sphere_footprints(either_device, "perspective", centre, radius)
    matrix = lens("perspective")
    middle = twin.ndc_of(centre, matrix)[:, :2]
    plain = middle + np.abs(np.diag(matrix)[:2]) * (radius / -centre[:, 2])[:, None]
    assert (got["high"] - plain > 1e-3).any(axis=1).mean() > 0.3


@sphere_projection
@every_lens
def test_a_sphere_across_the_near_plane_is_anywhere(either_device, name):
    near = 0.5 if name == "orthographic" else lens(name)[2, 3]
    rng = np.random.default_rng(6)
    radius = near * 10.0 ** rng.uniform(-1, 3, 500)
    distance = near + radius * rng.uniform(-2, 0.999, 500)  # the eye itself is in many of them
    centre = np.column_stack([rng.normal(size=(500, 2)) * radius[:, None], -distance])
    got, known = sphere_footprints(either_device, name, np.float32(centre), np.float32(radius))
    assert not known.any()
    assert (got["nearest"] > 1.0).all() and (got["low"] == -1.0).all() and (got["high"] == 1.0).all()


@sphere_projection
@every_lens
def test_points_have_footprints_and_what_is_no_number_is_anywhere(either_device, name):
    centre = np.tile(np.float32((0.5, -0.25, -4)), (10, 1))
    radius = np.full(10, np.float32(0.5))
    centre[0, 0], centre[1, 1], centre[2, 2], radius[3] = NAN, NAN, NAN, NAN
    centre[4, 0], centre[5, 2], radius[6], radius[7] = INFINITE, -INFINITE, INFINITE, -1.0
    radius[8:] = 0.0
    centre[9, :2] = 0.0
    got, known = sphere_footprints(either_device, name, centre, radius)
    assert not known[[0, 1, 2, 3, 4, 6, 7]].any() and known[8:].all()
    truth = twin.ndc_of(centre[8:], lens(name))
    assert np.abs(got["low"][8:] - truth[:, :2]).max() < 1e-6
    assert np.abs(got["high"][8:] - truth[:, :2]).max() < 1e-6


@every_lens
def test_the_rectangle_of_a_box_is_that_of_its_corners(either_device, name):
    parts = boxes(name)
    body = f"Footprint footprint = box_footprint({BOX}); {FOOTPRINT}"
    got = evaluate(either_device, BOUNDS, body, box_inputs(parts), FOOTPRINT_OUTPUTS)
    known = got["known"] != 0
    corners = twin.box_corners(*parts)
    w, beyond = corners[..., 3], (corners[..., 3] - corners[..., 2])
    size = np.abs(corners).max(axis=(1, 2))
    clearly = (w.min(axis=1) > 1e-4 * size) & (beyond.min(axis=1) > 1e-4 * size)
    assert not known[(w.min(axis=1) <= 0) | (beyond.min(axis=1) < 0)].any(), "it reaches the near plane"
    assert known[clearly].all() and 0.2 < known.mean() < 0.9
    with np.errstate(divide="ignore", invalid="ignore"):
        ndc = corners[known][..., :3] / corners[known][..., 3:]
    low, high = ndc.min(axis=1), ndc.max(axis=1)
    assert (got["low"][known] <= low[:, :2]).all() and (got["high"][known] >= high[:, :2]).all()
    assert (got["nearest"][known] > high[:, 2] + np.ptp(ndc[..., 2], axis=1) / 65).all()
    if name == "orthographic":
        assert (got["nearest"][known] > high[:, 2] + 9e-7).all()
    sure = clearly[known]
    room = 2e-6 * (size / w.min(axis=1))[known][:, None] * (1 + np.abs(ndc).max(axis=(1, 2)))[:, None]
    assert (low[:, :2] - got["low"][known] < room)[sure].all()
    assert (got["high"][known] - high[:, :2] < room)[sure].all()
    most = high[:, 2] + 1e-4 * np.abs(high[:, 2]) + np.ptp(ndc[..., 2], axis=1) / 60 + 2 * room[:, 0]
    assert (got["nearest"][known] < most)[sure].all()


def test_a_box_whose_corners_may_be_off_has_a_larger_rectangle(either_device):
    """The corners are moved at random within the rounding: none leaves the rectangle, and none is nearer."""
    parts = boxes("perspective", 1000)
    rng = np.random.default_rng(8)
    corners = twin.box_corners(*parts)
    rounding = np.float32(np.abs(corners).max(axis=1) * 10.0 ** rng.uniform(-6, -1, (1000, 1)))
    body = f"Footprint footprint = box_footprint({BOX}, rounding); {FOOTPRINT}"
    inputs = {**box_inputs(parts), "rounding": rounding}
    got = evaluate(either_device, BOUNDS, body, inputs, FOOTPRINT_OUTPUTS)
    known = got["known"] != 0
    assert 0.2 < known.mean() < 0.9
    for _ in range(8):
        moved = corners + rounding[:, None] * rng.choice([-1.0, 1.0], corners.shape)
        ndc = (moved[..., :3] / moved[..., 3:])[known]
        assert (moved[known][..., 3] > 0).all()
        assert (ndc[..., :2] >= got["low"][known][:, None]).all()
        assert (ndc[..., :2] <= got["high"][known][:, None]).all()
        assert (ndc[..., 2] <= got["nearest"][known][:, None]).all()


def test_a_box_that_is_no_number_is_anywhere(either_device):
    parts = [
        np.tile(np.float32(row), (16, 1))
        for row in ((0, 0, 0.1, 4), (1, 0, 0, 0.1), (0, 1, 0, 0.1), (0, 0, 0, 0.5))
    ]
    for number in range(16):
        parts[number // 4][number, number % 4] = NAN
    body = f"Footprint footprint = box_footprint({BOX}); {FOOTPRINT}"
    got = evaluate(either_device, BOUNDS, body, box_inputs(parts), FOOTPRINT_OUTPUTS)
    assert not got["known"].any() and (got["nearest"] > 1.0).all()


SNAP = 1 / 256


def pixel_rects(device, low, high, size, known=None):
    body = """
        uvec2 start, end;
        pixel_rect(Footprint(low, high, 0.5, known != 0u), size, start, end);
        first = start; last = end;
    """
    known = np.ones(len(low), np.uint32) if known is None else known
    inputs = {
        "low": low,
        "high": high,
        "size": np.broadcast_to(np.float32(size), low.shape).copy(),
        "known": known,
    }
    got = evaluate(device, BOUNDS, body, inputs, {"first": "uvec2", "last": "uvec2"})
    return got["first"].astype(np.int64), got["last"].astype(np.int64)


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (1920, 1080), (16384, 16384)])
def test_every_pixel_that_a_rectangle_touches_is_in_its_range(either_device, size):
    """Its edges may move by 1/256 of a pixel. A range is too wide that has more than that and some roundings."""
    rng = np.random.default_rng(size[0])
    ends = np.sort(rng.uniform(-1.2, 1.2, (2, 4000, 2)), axis=0)
    ends[1, :2000] = ends[0, :2000] + rng.uniform(0, 10, (2000, 2)) / size
    pixels = np.round(rng.uniform(0, 1, (500, 2)) * size)  # edges of pixels
    ends[:, :500] = pixels / size * 2 - 1
    ends = np.float32(ends)
    first, last = pixel_rects(either_device, ends[0], ends[1], size)
    low, high = (ends.astype(np.float64) * 0.5 + 0.5) * size
    end = np.array(size) - 1

    def pixel(place):
        return np.clip(np.floor(place), 0, end)

    assert (first <= pixel(low - SNAP)).all() and (last >= pixel(high + SNAP)).all()
    margin = SNAP + 3e-6 * np.array(size)
    assert (first >= pixel(low - margin)).all() and (last <= np.maximum(pixel(high + margin), first)).all()
    assert (first >= 0).all() and (first <= last).all() and (last <= end).all()
    first, last = pixel_rects(either_device, ends[1], ends[0], size)  # as what two footprints share may be
    assert (first >= 0).all() and (first <= last).all() and (last <= end).all()


def test_what_is_anywhere_touches_every_pixel(either_device):
    low = np.float32([[NAN, 0.3], [0.2, 0.2], [-INFINITE, 5.0]])
    first, last = pixel_rects(either_device, low, low, (640, 360), np.zeros(3, np.uint32))
    assert (first == 0).all() and (last == (639, 359)).all()


def test_the_level_is_the_lowest_with_four_texels(either_device):
    rng = np.random.default_rng(9)
    a, b = np.mgrid[0:70, 0:70].reshape(2, -1)
    pairs = np.stack([a[a <= b], b[a <= b]], axis=1)
    wide = np.sort(rng.integers(0, 16384, (4000, 2)), axis=1)
    near = np.minimum(wide[:, :1] + rng.integers(0, [1, 2**12], (4000, 2)), 16383)
    x = np.concatenate([pairs, wide, near])
    y = rng.permutation(x)
    first, last = (np.uint32(np.stack([x[:, i], y[:, i]], axis=1)) for i in range(2))
    inputs = {"first": first, "last": last}
    got = evaluate(either_device, BOUNDS, "level = occlusion_level(first, last);", inputs, {"level": "uint"})[
        "level"
    ]
    assert np.array_equal(got, twin.coarsest_fit(first, last))
    assert got.min() == 1 and got.max() == 13


# --- facing away ------------------------------------------------------------------------------------------------------


def affine(rng, count, spread=1.0):
    """Return affine matrices (N, 3, 4) float32: turned, scaled unevenly, sheared, half of them mirrored."""
    linear = rotations(rng, count) * (10.0 ** rng.uniform(-spread, spread, (count, 3)))[:, None, :]
    linear[::3] = linear[::3] @ (np.eye(3) + 0.7 * np.triu(rng.normal(size=(len(linear[::3]), 3, 3)), 1))
    linear[::2, :, 0] *= -1
    size = 10.0 ** rng.uniform(-3, 3, (count, 1, 1))
    return np.concatenate([linear * size, rng.normal(size=(count, 3, 1)) * 10], axis=2).astype(np.float32)


def eyes_in_object(device, matrices, eye, flat=False):
    body = f"{WORLD} result = eye_in_object(world_from_object, eye, {str(flat).lower()});"
    inputs = {**rows(matrices), "eye": np.float32(eye)}
    return evaluate(device, BOUNDS, body, inputs, {"result": "vec3"})["result"]


def test_the_eye_goes_to_object_space_through_every_affine_matrix(either_device):
    rng = np.random.default_rng(10)
    matrices = affine(rng, 3000)
    eye = np.float32(rng.normal(size=(3000, 3)) * 20)
    linear = matrices[:, :, :3].astype(np.float64)
    condition = np.linalg.cond(linear)
    for flat, vector in ((False, eye.astype(np.float64) - matrices[:, :, 3]), (True, eye)):
        found = eyes_in_object(either_device, matrices, eye, flat)
        truth = np.linalg.solve(linear, vector[..., None])[..., 0]
        error = np.linalg.norm(found - truth, axis=1) / np.linalg.norm(truth, axis=1)
        assert (error[condition < 400] < 8e-7 * condition[condition < 400]).all()
        assert np.isnan(found[condition > 4200]).all() and (condition < 400).mean() > 0.5


def test_a_flat_matrix_and_one_that_is_no_number_have_no_eye_in_object_space(either_device):
    matrices = np.tile(np.eye(3, 4, dtype=np.float32), (9, 1, 1))
    matrices[0, :, 1] = 0.0
    matrices[1, :, 1] = matrices[1, :, 0]
    matrices[2, :, :3] = 0.0
    matrices[3, 0, 0], matrices[4, 2, 1], matrices[5, 1, 3] = NAN, INFINITE, NAN
    matrices[6, 1, 1] = 1e-5
    matrices[7, :, :3] *= 1e-3
    matrices[8, :, :3] *= 1e3
    found = eyes_in_object(either_device, matrices, np.ones((9, 3)))
    assert np.isnan(found[:7]).any(axis=1).all()
    assert np.allclose(found[7:], [[1e3] * 3, [1e-3] * 3])


def cones(rng, count, triangles=12):
    """Return meshlets in object space: triangles (N, T, 3, 3), centre, radius and cone, as a builder makes them.

    Normals lie around an axis within up to 70 degrees; the bytes are rounded to the safe side in float64.
    """
    axis = twin.unit_sphere(count)[rng.permutation(count)]
    spread = np.radians(rng.uniform(1, 70, count))
    away = rng.normal(size=(count, triangles, 3))
    normal = axis[:, None] * np.cos(spread)[:, None, None]
    side = np.cross(axis[:, None], away)
    normal = normal + side / np.linalg.norm(side, axis=2, keepdims=True) * np.sin(spread)[:, None, None]
    u = np.cross(normal, away)
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    v = np.cross(normal, u)
    middle = rng.normal(size=(count, 1, 3)) * 5 + rng.normal(size=(count, triangles, 3)) * 0.3
    turn = np.array([0.0, 2.1, 4.2])
    corners = middle[:, :, None] + 0.2 * (
        np.cos(turn)[:, None] * u[:, :, None] + np.sin(turn)[:, None] * v[:, :, None]
    )
    centre = corners.mean(axis=(1, 2)).astype(np.float32)
    radius = np.linalg.norm(corners - centre[:, None, None], axis=3).max(axis=(1, 2))
    radius = np.nextafter(radius.astype(np.float32), INFINITE)
    bytes_ = np.zeros((count, 4), np.int8)
    bytes_[:, :3] = np.round(axis * 127)
    decoded = bytes_[:, :3] / 127.0
    made = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    made /= np.linalg.norm(made, axis=2, keepdims=True)
    least = np.einsum("ntc,nc->nt", made, decoded).min(axis=1)
    length = np.linalg.norm(decoded, axis=1)
    # The sine of the half angle around an axis of this length: what is behind the cone is so for the decoded axis.
    sine = np.sqrt(np.maximum(0, length**2 - least**2)) + 1e-6
    bytes_[:, 3] = np.where(least > 0, np.minimum(127, np.ceil(sine * 127)), 127)
    return corners, centre, radius, bytes_.view(np.uint32)[:, 0]


def faces_away(device, cone, centre, radius, eye, flat=False, margin=None):
    more = "" if margin is None else ", margin"
    body = f"kept = uint(!cone_faces_away(cone, centre, radius, eye, {str(flat).lower()}{more}));"
    inputs = {"cone": cone, "centre": centre, "radius": radius, "eye": np.float32(eye)}
    if margin is not None:
        inputs["margin"] = margin
    return evaluate(device, BOUNDS, body, inputs, {"kept": "uint"})["kept"] == 0


@pytest.mark.parametrize("flat", [False, True], ids=["perspective", "orthographic"])
def test_no_triangle_is_seen_from_its_front_where_the_cone_faces_away(either_device, flat):
    """Of mirrored and sheared instances too, on the screen, with the winding that a mirrored instance turns around."""
    rng, count = np.random.default_rng(11), 1500
    corners, centre, radius, cone = cones(rng, count)
    matrices = affine(rng, count, 0.6)
    linear, place = matrices[:, :, :3].astype(np.float64), matrices[:, :, 3].astype(np.float64)
    size = np.linalg.norm(linear, axis=(1, 2))
    world = np.einsum("nij,ntkj->ntki", linear, corners) + place[:, None, None]
    target = np.einsum("nij,nj->ni", linear, centre) + place
    direction = twin.unit_sphere(count)[rng.permutation(count)]
    eye = np.float32(target - direction * (size * rng.uniform(0.5, 8, count))[:, None])
    given = np.float32(direction) if flat else eye
    local = eyes_in_object(either_device, matrices, given, flat)
    found = faces_away(either_device, cone, centre, radius, local, flat)
    mirrored = np.linalg.det(linear) < 0
    projection = orthographic(1.0, 1.0, 0.1, 10.0) if flat else perspective(1.0, 1.0, 0.1)
    front = np.zeros((count, corners.shape[1]), bool)
    for number in range(count):
        view = look_at(eye[number], eye[number] + direction[number], rng.normal(size=3))
        area = twin.screen_area(world[number], projection @ view)
        front[number] = (area < 0) if mirrored[number] else (area > 0)
    assert not front[found].any(), "a triangle that is seen was culled"
    hidden = ~front.any(axis=1)
    assert found.mean() > 0.05 and found.sum() > 0.4 * hidden.sum()
    assert 0.45 < mirrored.mean() < 0.55 and found[mirrored].mean() == pytest.approx(
        found[~mirrored].mean(), abs=0.05
    )
    unturned = np.where(mirrored[:, None], ~front, front)
    assert unturned[found].any(), "with one winding for all, mirrored instances would show their backs"


def test_a_cone_that_is_unknown_never_faces_away(either_device):
    rng = np.random.default_rng(12)
    _, centre, radius, cone = cones(rng, 1000)
    eye = np.float32(centre - 10 * twin.unit_sphere(1000))
    assert faces_away(either_device, cone, centre, radius, eye).any()
    unknown = cone & np.uint32(0x00FFFFFF) | np.uint32(127 << 24)
    assert not faces_away(either_device, unknown, centre, radius, eye).any()
    longer = np.full(
        1000, np.array([73, 73, 74, 127], np.int8).view(np.uint32)[0]
    )  # its axis is longer than 1
    straight = np.float32(centre - 1e4 * np.array([73, 73, 74]) / 127)
    tiny, none = np.full(1000, np.float32(1e-3)), np.zeros(1000, np.float32)
    assert not faces_away(either_device, longer, centre, tiny, straight, margin=none).any()
    for part in (eye, centre):
        for value in (NAN, INFINITE):
            before = part.copy()
            part[:, 1] = value
            assert not faces_away(either_device, cone, centre, radius, eye).any()
            part[:] = before
    assert not faces_away(either_device, cone, centre, np.full(1000, NAN), eye).any()


def test_a_triangle_near_its_edge_keeps_its_side_only_outside_of_the_margin(either_device):
    """A flat meshlet is seen at small angles from behind: culled from about a degree on, later with a larger margin."""
    angle = np.radians(np.linspace(-5, 30, 701))
    eye = np.column_stack([1000 * np.cos(angle), np.zeros(701), -1000 * np.sin(angle)])
    cone = np.full(701, np.array([0, 0, 127, 0], np.int8).view(np.uint32)[0])
    centre, radius = np.zeros((701, 3), np.float32), np.full(701, np.float32(1e-3))
    for margin in (None, 0.1, 0.3, 2.0):
        given = None if margin is None else np.full(701, np.float32(margin))
        found = faces_away(either_device, cone, centre, radius, eye, margin=given)
        from_ = 1 / 64 if margin is None else margin
        assert np.array_equal(found, np.sin(angle) >= from_ + 1e-6)


def test_small_meshlets_and_rounded_ones_have_larger_margins(either_device):
    radius = np.float32([1.0, 1.0, 0.1, 0.0])
    shift = np.float32([0.0, 1e-3, 1e-3, 1e-3])
    inputs = {"radius": radius, "shift": shift}
    found = evaluate(
        either_device, BOUNDS, "result = grazing_margin(radius, shift);", inputs, {"result": "float"}
    )["result"]
    assert np.allclose(found[:3], [1 / 64, 1 / 64 + 0.096, 1 / 64 + 0.96]) and not found[3] < 1.0


# --- on a rasteriser --------------------------------------------------------------------------------------------------

TRIANGLES = """
layout(location = 0) in vec4 in_position;
layout(location = 0) flat out float number;
void main() {
    number = float(VERTEX_ID / 3 + 1);
    gl_Position = in_position;
}
"""
DRAWN = """
layout(location = 0) flat in float number;
layout(location = 0) out vec4 value;
void main() { value = vec4(number, gl_FragCoord.z, gl_FrontFacing, 1.0); }
"""
PICTURE = (256, 160)


def drawn(device, clip):
    """Return (triangle, pixel (2,), depth, whether its front) of all pixels that show one of triangles (N, 3, 4)."""
    picture = draw(device, DRAWN, PICTURE, vertex=TRIANGLES, vertices=clip.reshape(-1, 4))
    y, x = np.nonzero(picture[..., 0])
    value = picture[y, x]
    return value[:, 0].astype(int) - 1, np.stack([x, y], axis=1), value[:, 1], value[:, 2] != 0


def triangles(rng, count):
    """Return triangles (N, 3, 3) in view space: of all sizes, half of them thin, half of them seen along an edge."""
    matrix = lens("perspective")
    distance = 10.0 ** rng.uniform(-0.5, 3, count)
    place = np.column_stack(
        [rng.uniform(-1, 1, (count, 2)) / np.abs(np.diag(matrix)[:2]), np.full(count, -1.0)]
    )
    place *= distance[:, None]
    edges = rng.normal(size=(count, 2, 3)) * (distance * 10.0 ** rng.uniform(-2.5, 0, count))[:, None, None]
    thin, steep = rng.random((2, count)) < 0.5
    edges[thin, 1] = edges[thin, 0] * rng.uniform(-1, 1, (thin.sum(), 1)) + 0.03 * edges[thin, 1]
    edges[steep, 0] = place[steep] * rng.uniform(0.01, 0.4, (steep.sum(), 1)) + 0.02 * edges[steep, 0]
    return np.stack([place, place + edges[:, 0], place + edges[:, 1]], axis=1)


def heights_px(clip):
    """Return the least height of triangles (N, 3, 4) on the screen, in pixels."""
    at = clip[..., :2] / clip[..., 3:] * np.array(PICTURE) / 2
    sides = np.roll(at, -1, axis=1) - at
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    return area / np.linalg.norm(sides, axis=2).max(axis=1)


def test_what_a_rasteriser_draws_is_inside_of_its_footprint(vulkan_device):
    """Each triangle has the footprint of the parallelogram that it is half of: three corners of both are the same."""
    rng, pixels = np.random.default_rng(13), 0
    matrix = lens("perspective")
    body = f"""
        Footprint footprint = box_footprint({BOX});
        uvec2 start, end;
        pixel_rect(footprint, vec2({PICTURE[0]}.0, {PICTURE[1]}.0), start, end);
        first = start; last = end; nearest = footprint.nearest; known = uint(footprint.known);
    """
    outputs = {"first": "uvec2", "last": "uvec2", "nearest": "float", "known": "uint"}
    for _ in range(4):
        clip = (triangles(rng, 600) @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)
        exact = clip.astype(np.float64)
        clip = clip[(exact[..., 3] > NEAR).all(axis=1) & (heights_px(exact) > 0.2)]
        exact = clip.astype(np.float64)
        a, b, c = exact[:, 0], exact[:, 1], exact[:, 2]
        parts = [np.float32(part) for part in ((b + c) / 2, (b - a) / 2, (c - a) / 2, 0 * a)]
        got = evaluate(vulkan_device, BOUNDS, body, box_inputs(parts), outputs)
        which, pixel, depth, _ = drawn(vulkan_device, clip)
        kept = got["known"][which] != 0
        which, pixel, depth = which[kept], pixel[kept], depth[kept]
        assert (pixel >= got["first"][which]).all() and (pixel <= got["last"][which]).all()
        assert (depth <= got["nearest"][which]).all()
        pixels += len(pixel)
    assert pixels > 30_000


def test_a_triangle_shows_its_other_side_only_within_the_margin(vulkan_device):
    """Triangles that are turned away by little: all that a rasteriser takes for fronts are within it."""
    rng, count = np.random.default_rng(14), 100_000
    matrix = lens("perspective")
    pixel = 2 / (np.abs(matrix[1, 1]) * PICTURE[1])  # at one metre, in metres
    place = np.column_stack(
        [rng.uniform(-1, 1, (count, 2)) / np.abs(np.diag(matrix)[:2]), np.full(count, -1.0)]
    )
    seen = place / np.linalg.norm(place, axis=1, keepdims=True)
    sine, radius = 10.0 ** rng.uniform(-5, -1, count), 10.0 ** rng.uniform(0, 1.5, count) * pixel
    side = np.cross(seen, rng.normal(size=(count, 3)))
    normal = sine[:, None] * seen + side / np.linalg.norm(side, axis=1, keepdims=True)
    u = np.cross(normal, rng.normal(size=(count, 3)))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u) / np.linalg.norm(normal, axis=1, keepdims=True)
    turn = np.array([0.0, 2.1, 4.2])[:, None]
    corners = place[:, None] + radius[:, None, None] * (np.cos(turn) * u[:, None] + np.sin(turn) * v[:, None])
    away = twin.screen_area(corners, matrix) < 0
    which, _, _, front = drawn(
        vulkan_device, (corners[away] @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)
    )
    turned = np.unique(which[front])
    assert len(turned) > 3, "there are some"
    faced = np.einsum("ni,nki->nk", normal, corners) / np.linalg.norm(corners, axis=2)
    height = 1.5 * radius[away][turned]
    # The margin is that of 16 heights; a triangle is a meshlet of its own here, of one height.
    inputs = {"radius": np.float32(16 * height), "shift": np.full(len(turned), np.float32(pixel / 256))}
    margin = evaluate(
        vulkan_device, BOUNDS, "result = grazing_margin(radius, shift);", inputs, {"result": "float"}
    )
    assert (np.abs(faced[away][turned]).max(axis=1) < margin["result"] - 1 / 64).all()
