"""The market has as many lamps as its name says, each a light with a body; eight and more reach most of what is seen.

What a camera sees is found without a renderer: `tests.assets.seen` sends rays through pixels in float64.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from assets import SCENES, locate
from assets.market_plan import LEAST_RANGE, MOST_RANGE, lamps, strings
from assets.market_views import VIEWS
from assets.scenes import find, make
from common.errors import UserError
from common.gltf import load_scene
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, view_of_scene
from tests.assets.seen import opaque_triangles, seen
from tests.assets.test_city import front_hits

NAMES = ["lane-1", "lane-2", "lane-3", "square", "glass", "lamp", "roof", "far"]
GRID = (32, 18)
"""Rays of each camera."""


def load(size, kept):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STRATA_CACHE", str(kept))
        return load_scene(locate(f"market:{size}"))


@pytest.fixture(scope="module")
def market(kept):
    return load("lights=2400", kept)


@pytest.fixture(scope="module")
def pose(market):
    return evaluate_pose(market, 0.0)


@pytest.fixture(scope="module")
def visible(market, pose):
    """Points and instances that each camera sees, without the sky."""
    triangles, owners = opaque_triangles(market, pose)
    found = {}
    for name in NAMES:
        points, who = seen(market, pose, triangles, owners, name, GRID)
        ground = np.array([not material_of(market, k).unlit for k in who])
        found[name] = points[ground], who[ground]
    return found


def material_of(scene, instance):
    return scene.materials[int(scene.meshes["material"][scene.instances.mesh[instance]])]


def lamps_of(scene):
    return [light for light in scene.lights if light.kind != "directional"]


def in_range(scene, pose, points, count=None):
    """Return (N, L) whether a lamp, one of the first `count`, reaches a point: by its range and by its cone."""
    lights = lamps_of(scene)[:count]
    world = np.array([pose.world_from_node[light.node] for light in lights], np.float64)
    offset = points[:, None] - world[:, :3, 3]
    distance = np.linalg.norm(offset, axis=-1)
    along = -(offset * world[:, :3, 2] / np.linalg.norm(world[:, :3, 2], axis=-1, keepdims=True)).sum(-1)
    cone = np.array([math.cos(light.outer_cone) if light.kind == "spot" else -2.0 for light in lights])
    return (distance < [light.range for light in lights]) & (along > cone * distance)


def lights_in(builder):
    """Return the punctual lights of a scene that was not written, and the mesh of each one's node."""
    entries = builder.gltf.extensions["KHR_lights_punctual"]["lights"]
    meshes = {
        node.extensions["KHR_lights_punctual"]["light"]: node.mesh
        for node in builder.gltf.nodes
        if "KHR_lights_punctual" in node.extensions
    }
    return entries, [meshes[k] for k in range(len(entries))]


# --- names ---


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("market", "lights=2400"),
        ("market:lights=400", "lights=400"),
        ("market:lights=0400", "lights=400"),
        ("market:lights=0", "lights=0"),
        ("market:lights=4096", "lights=4096"),
    ],
)
def test_each_number_of_lamps_has_one_name(text, size):
    assert find(text) == (SCENES["market"], size)


@pytest.mark.parametrize(
    ("size", "says"),
    [
        ("", 'The scene "market" has no size ""; write'),
        ("400", 'has no size "400"; write'),
        ("lights", 'has no size "lights"; write'),
        ("lights=", 'has no size "lights="; write'),
        ("lights=-1", 'has no size "lights=-1"; write'),
        ("lights=1.5", 'has no size "lights=1.5"; write'),
        ("lights=1e3", 'has no size "lights=1e3"; write'),
        ("lights=many", 'has no size "lights=many"; write'),
        ("lamps=400", 'has no size "lamps=400"; write'),
        ("Lights=400", 'has no size "Lights=400"; write'),
        ("lights=400 ", 'has no size "lights=400 "; write'),
        ("lights=4097", '"market:lights=4097" has too many lamps; write'),
        ("lights=999999999", "has too many lamps; write"),
        ("lights=99999999999999", 'has no size "lights=99999999999999"; write'),
    ],
)
def test_a_wrong_number_is_one_sentence_that_names_the_limits(size, says):
    with pytest.raises(UserError) as caught:
        locate(f"market:{size}")
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert str(caught.value).endswith(
        "lights= and a whole number from 0 to 4,096, such as lights=2400, lights=400."
    )


# --- lamps ---


@pytest.mark.parametrize("number", [0, 1, 33, 400, 4096])
def test_it_has_so_many_lamps_and_the_moon_and_each_lamp_has_a_body(number):
    entries, meshes = lights_in(make(SCENES["market"], f"lights={number}"))
    assert len(entries) == number + 1
    assert [entry["type"] for entry in entries].count("directional") == 1
    assert entries[-1]["name"] == "moon" and meshes[-1] is None
    assert all(mesh is not None for mesh in meshes[:-1])


def test_fewer_lamps_are_the_first_of_more(market):
    """The lamps of 400 are the first 400 of 2,400, and nothing glows that is not one of them."""
    few = make(SCENES["market"], "lights=400")
    entries, _ = lights_in(few)
    many = lamps_of(market)
    for entry, light in zip(entries[:-1], many, strict=False):
        assert entry["name"] == light.name and entry["intensity"] == pytest.approx(light.intensity)
    materials = [material.name for material in few.gltf.materials]
    glowing = {k for k, name in enumerate(materials) if name.startswith(("string_", "shade_", "head"))}
    bodies = [
        node.mesh
        for node in few.gltf.nodes
        if node.mesh is not None
        and any(part.material in glowing for part in few.gltf.meshes[node.mesh].primitives)
    ]
    assert len(bodies) == 400


@pytest.mark.parametrize("number", [100, 400, 1200])
def test_lamps_thin_out_evenly(number):
    """Each ninth of the market keeps its part of the lamps, within four standard deviations of a random choice."""
    at = np.array([lamp.at for lamp in lamps(2400)])
    cell = (np.clip((at[:, [0, 2]] + 28.5) // 19.0, 0, 2) @ [3, 1]).astype(int)
    whole, part = (np.bincount(cell[:count], minlength=9) for count in (2400, number))
    expected = whole * number / 2400
    assert whole.min() > 50
    assert (np.abs(part - expected) <= 4 * np.sqrt(expected * (1 - number / 2400)) + 1).all()


def test_lamps_are_plausible(market):
    lights = lamps_of(market)
    assert len(lights) == 2400
    points = [light for light in lights if light.kind == "point"]
    spots = [light for light in lights if light.kind == "spot"]
    assert 10 <= len(spots) <= 40 and len(points) + len(spots) == 2400
    ranges, candela = (np.array([getattr(p, name) for p in points]) for name in ("range", "intensity"))
    assert ranges.min() >= LEAST_RANGE == 2.5 and ranges.max() <= MOST_RANGE == 6.0 and np.ptp(ranges) > 3.0
    assert candela.min() >= 4.99 and candela.max() <= 60.0
    assert all(0 < spot.inner_cone < spot.outer_cone < math.pi / 2 for spot in spots)
    colors = np.array([light.color for light in lights])
    assert len(np.unique(colors, axis=0)) >= 6
    assert (colors[:, 0] > colors[:, 2]).mean() > 0.85, "most are warm"
    moon = [light for light in market.lights if light.kind == "directional"]
    assert [light.intensity for light in moon] == [pytest.approx(0.1, abs=1e-3)]


def test_lamps_on_strings_hang_from_a_wire(market):
    """The stem of each ends within 2 cm of the wire above it: no lamp floats."""
    wires = np.concatenate([string.points(np.linspace(0, 1, 401)) for string in strings()])
    stems = {"bulb": 0.09, "paper": 0.22, "drum": 0.23}
    hung = [lamp for lamp in lamps(2400) if lamp.kind in stems]
    assert len(hung) > 1500
    for lamp in hung[::7]:
        top = np.add(lamp.at, (0.0, stems[lamp.kind], 0.0))
        assert np.linalg.norm(wires - top, axis=1).min() < 0.03
    world = evaluate_pose(market, 0.0).world_from_node
    at = np.array([world[light.node][:3, 3] for light in lamps_of(market)])
    assert np.abs(at - [lamp.at for lamp in lamps(2400)]).max() < 1e-3, "the plan is what the file says"


# --- what is seen ---


@pytest.mark.parametrize("name", NAMES)
def test_at_least_eight_lamps_reach_the_median_of_what_is_seen(name, market, pose, visible):
    """And not many more than twenty, since each costs time."""
    points, _ = visible[name]
    assert len(points) > 0.6 * GRID[0] * GRID[1]
    reached = np.median(in_range(market, pose, points).sum(axis=1))
    assert 8 <= reached <= 24


def test_fewer_lamps_reach_a_point_in_proportion(market, pose, visible):
    points, _ = visible["lane-1"]
    mean = in_range(market, pose, points).sum(axis=1).mean()
    for number in (400, 1200):
        part = in_range(market, pose, points, number).sum(axis=1).mean()
        assert part == pytest.approx(mean * number / 2400, rel=0.25)


def test_the_rays_see_the_ground_where_it_is(market, pose, visible):
    """The rays themselves: paving lies at height 0, houses end where they are built to."""
    heights = [
        point[1]
        for points, who in visible.values()
        for point, k in zip(points, who, strict=True)
        if material_of(market, k).name in ("setts", "floor")
    ]
    assert len(heights) > 300 and np.abs(heights).max() < 1e-9
    assert 10.0 < max(points[:, 1].max() for points, _ in visible.values()) < 25.0, "the highest house"


def test_the_rays_see_what_rays_against_every_triangle_meet(market, pose, visible):
    """Each sixteenth point of one camera is where a ray through it enters the first of all triangles."""
    triangles, owners = opaque_triangles(market, pose)
    double = np.array([material_of(market, k).double_sided for k in range(len(market.instances))])[owners]
    both = np.concatenate([triangles, triangles[double][:, ::-1]])
    eye = view_of_scene(market, pose, "square", 16 / 9).eye
    for point in visible["square"][0][8::16]:
        away = np.linalg.norm(point - eye)
        assert front_hits(both, eye, (point - eye) / away)[0] == pytest.approx(away, abs=1e-4)


def test_no_two_surfaces_lie_in_each_other(market, pose):
    """No ray enters two opaque faces at the same distance: which of them is seen would be a matter of rounding."""
    triangles, _ = opaque_triangles(market, pose)
    rng, tested = np.random.default_rng(7), 0
    for name in NAMES:
        eye = view_of_scene(market, pose, name, 16 / 9).eye
        for direction in rng.normal(size=(6, 3)) * [1.0, 0.25, 1.0]:
            hits = front_hits(triangles, eye, direction / np.linalg.norm(direction))
            tested += len(hits)
            assert (np.diff(hits) > 2e-4).all(), f"{name} towards {direction}"
    assert tested > 80


def test_glass_is_before_what_the_camera_glass_sees(market, pose):
    view = view_of_scene(market, pose, "glass", 16 / 9)
    clip = view.clip_from_world(16 / 9)
    panes = 0
    for k in range(len(market.instances)):
        if material_of(market, k).alpha_mode == "blend":
            center = np.append(pose.world_from_object[k][:3, 3], 1.0)
            x, _, _, w = clip @ center
            panes += bool(0 < w < 12 and abs(x) < w)
    assert panes >= 5
    assert sum(material.alpha_mode == "blend" for material in market.materials) >= 3


# --- size and views ---


def test_it_is_small(market):
    triangles = int(market.meshes["index_count"][market.instances.mesh].sum()) // 3
    assert triangles <= 340_000
    assert int(market.meshes["index_count"].sum()) // 3 <= 90_000, "meshes are drawn many times"
    assert len(market.materials) <= 32
    assert max(max(image.pixels.shape[:2]) for image in market.images) <= 512
    used = {int(market.meshes["material"][mesh]) for mesh in market.instances.mesh}
    assert used == set(range(len(market.materials)))
    assert market.path.stat().st_size < 6_000_000


def test_it_is_made_twice_the_same():
    one, two = (make(SCENES["market"], "lights=12") for _ in range(2))
    assert one.blob == two.blob
    assert one.gltf.gltf_to_json() == two.gltf.gltf_to_json()


def test_the_first_view_is_in_a_lane_and_all_have_names(market, pose):
    assert [camera.name for camera in market.cameras] == NAMES == list(VIEWS)
    assert view_of_scene(market, pose, None, 16 / 9) == view_of_scene(market, pose, "lane-1", 16 / 9)
    for name in NAMES:
        assert isinstance(view_of_scene(market, pose, name, 16 / 9).projection, Perspective)
    with pytest.raises(UserError) as caught:
        view_of_scene(market, pose, "nowhere", 16 / 9)
    assert all(f"'{name}'" in str(caught.value) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_right_before_a_camera(name, market, pose, visible):
    points, _ = visible[name]
    eye = view_of_scene(market, pose, name, 16 / 9).eye
    assert np.linalg.norm(points - eye, axis=1).min() > 0.4
