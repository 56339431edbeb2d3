"""The light lists hold every light that may reach a pixel, in one order, and few others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.clusters.model import LEAST_LIGHTS, ListLayout
from chapters.ch07.settings import Settings
from common.errors import UnsupportedError
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.lamps import lit_town
from tests.support.light_lists import Lists
from tests.twins.light_lists import built, reaches, seen_at

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (123, 77)
LIT = Settings(color_format="rgba32f", gbuffer_format="full", anisotropy=1.0, ambient=0.0)
VIEWS = {
    "inside": View(pose_looking_at((-9.0, 1.2, 8.0), (1.0, 0.5, -2.0)), Perspective(0.9, 0.05)),
    "above": View(pose_looking_at((0.0, 14.0, 1.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05)),
    "wide": View(pose_looking_at((3.0, 1.0, 3.0), (0.0, 1.0, 0.0)), Perspective(2.4, 0.01)),
    "flat": View(pose_looking_at((9.0, 6.0, 9.0), (0.0, 0.0, 0.0)), Orthographic(5.0, 0.1, 40.0)),
}


def lists_of(chapter, scene, *views, size=SIZE):
    """Return the lists of a frame of each view."""
    found = []
    with chapter.open(scene, size, LIT) as renderer:
        for view in views:
            renderer.render(view).image("color")
            found.append(Lists(renderer))
    return found


@pytest.fixture(scope="module")
def scene():
    return lit_town(100, directional=3)


@pytest.fixture(scope="module")
def lists(chapter, scene):
    """The lists of each view, by its name."""
    return dict(zip(VIEWS, lists_of(chapter, scene, *VIEWS.values()), strict=True))


@pytest.mark.feature("clustered/light-sort")
@pytest.mark.parametrize("view", VIEWS)
def test_the_order_is_one_of_ascending_depth(scene, lists, view):
    found = lists[view]
    assert sorted(found.order) == list(range(3, 100)), "directional lights come first, without a place"
    bounds = found.words[found.layout.first_bound :][: 8 * found.local].reshape(-1, 8)
    intervals = bounds[:, 5:7].copy().view(np.float32)
    middles = 0.5 * (intervals[:, 0] + intervals[:, 1])
    assert (np.diff(middles) >= 0).all()
    assert not (np.diff(middles[np.argsort(found.order)]) >= 0).all(), "the scene has them in another order"
    # A point light's middle is its own depth, in double precision; what is added to both ends cancels.
    world_from_node = scene.nodes.matrix
    depths = []
    for record in found.order:
        light = scene.lights[record]
        if light.kind == "point":
            position = world_from_node[light.node][:3, 3]
            depths.append(seen_at(position[None], VIEWS[view], SIZE)[1][0])
    kinds = np.array([scene.lights[record].kind for record in found.order])
    finite = intervals[kinds == "point", 1] < 1e4
    np.testing.assert_allclose(middles[kinds == "point"][finite], np.array(depths)[finite], atol=2e-3)


def test_equal_depths_keep_the_order_of_the_scene(chapter):
    scene = lit_town(40)
    scene.nodes.matrix[-40:] = scene.nodes.matrix[-40]
    lights = [
        replace(light, kind="point", range=3.0, intensity=1.0, color=(1, 1, 1)) for light in scene.lights
    ]
    (found,) = lists_of(chapter, replace(scene, lights=lights), VIEWS["inside"])
    assert found.order.tolist() == list(range(40))


def assert_every_point_finds_its_light(scene, found, view, size, directional=0):
    """Hold lists to brute force in double precision: points within range and cone, projected one by one."""
    place_of = {record: place for place, record in enumerate(found.order)}
    random = np.random.default_rng(3)
    tested = 0
    for number, reach in enumerate(reaches(scene, 0.001)):
        pixels, depths = seen_at(reach.points(random, 500), view, size)
        inside = ~np.isnan(pixels[:, 0])
        place = place_of[directional + number]
        low, high = found.bins[found.bin_of(depths[inside])].T
        assert ((low <= place + 1) & (place + 1 <= high)).all(), f"light {number} is missing in a bin"
        assert found.depths[found.bin_of(depths[inside]), place].all(), (
            f"light {number} is missing in a bin's bits"
        )
        tile = pixels[inside].astype(int) >> found.layout.tile_log2
        assert found.tiles[tile[:, 1], tile[:, 0], place].all(), f"light {number} is missing in a tile"
        tested += inside.sum()
    assert tested > 1000


@pytest.mark.feature("clustered/depth-bins", "clustered/tile-bitfields")
@pytest.mark.parametrize("view", VIEWS)
def test_every_point_that_a_light_reaches_finds_it(scene, lists, view):
    assert_every_point_finds_its_light(scene, lists[view], VIEWS[view], SIZE, directional=3)


@pytest.mark.feature("clustered/tile-bitfields")
def test_33_lights_and_sizes_that_are_no_multiple_of_8(chapter):
    """The second word of a tile is not the first word of the next one."""
    scene, size = lit_town(33), (65, 41)
    (found,) = lists_of(chapter, scene, VIEWS["inside"], size=size)
    assert found.layout.words_of_set == 2 and found.layout.tiles == (9, 6)
    assert_every_point_finds_its_light(scene, found, VIEWS["inside"], size)
    # The printed address, y (tiles words) + x + word, takes the second word of a tile from the tile beside it.
    words = np.packbits(found.tiles.astype(np.uint8), axis=-1, bitorder="little").view(np.uint32)
    row = words.reshape(words.shape[0], -1)
    printed = np.stack([row[:, x : x + 2] for x in range(words.shape[1])], axis=1)
    assert not np.array_equal(printed, words)


@pytest.mark.feature("clustered/light-sort", "clustered/depth-bins", "clustered/tile-bitfields")
@pytest.mark.parametrize("view", ["inside", "above"])
def test_the_lists_of_numpy_hold_every_point_that_a_light_reaches(view):
    """Without a device: what the kernels are compared with holds what brute force finds, and not everything."""
    scene, shown = lit_town(60), VIEWS[view]
    lists_of_numpy = built(scene, shown, SIZE, 0.001, 1e-6)
    order = np.argsort(lists_of_numpy.middles, kind="stable")
    assert (np.diff(lists_of_numpy.middles[order]) >= 0).all() and sorted(order) == list(range(60))
    random = np.random.default_rng(4)
    for number, reach in enumerate(reaches(scene, 0.001)):
        pixels, depths = seen_at(reach.points(random, 300), shown, SIZE)
        inside = ~np.isnan(pixels[:, 0])
        low, high = lists_of_numpy.intervals[number] + 1e-6 * np.array((-1.0, 1.0)) * reach.radius
        assert ((low <= depths[inside]) & (depths[inside] <= high)).all()
        tile = pixels[inside].astype(int) >> 3
        assert lists_of_numpy.tiles[tile[:, 1], tile[:, 0], number].all()
    assert not lists_of_numpy.tiles.all()


@pytest.mark.feature("clustered/light-sort", "clustered/depth-bins", "clustered/tile-bitfields")
@pytest.mark.parametrize("view", ["inside", "above"])
def test_the_lists_are_those_of_numpy(scene, lists, view):
    """Between the lists in double precision and those with all radii longer by a thousandth.

    The kernels lengthen a radius by 1e-4 of itself and 4e-6 of the distances, which are up to 30 radii here.
    """
    found = lists[view]
    least, most = (built(scene, VIEWS[view], SIZE, 0.001, wider) for wider in (0.0, 1e-3))
    order = found.order - 3
    assert (np.diff(least.middles[order]) > -1e-4).all()
    tiles = found.tiles[:, :, : len(order)] > 0
    assert (tiles >= least.tiles[:, :, order]).all() and (tiles <= most.tiles[:, :, order]).all()
    for numpy_lists, narrower in ((least, 1), (most, -1)):
        first, last = (found.bin_of(numpy_lists.intervals[order, end]) for end in (0, 1))
        for number, (low, high) in enumerate(found.bins):
            places = (
                np.flatnonzero((first <= number) & (number <= last) & (numpy_lists.intervals[order, 1] >= 0))
                + 1
            )
            wanted = (places.min(), places.max()) if len(places) else (0xFFFF, 0)
            assert narrower * low <= narrower * wanted[0] and narrower * high >= narrower * wanted[1]


@pytest.mark.parametrize("view", VIEWS)
def test_what_cannot_be_seen_is_in_no_list(scene, lists, view):
    """A light has no bit if its sphere is behind the eye, or beside the picture by more than four tiles.

    A sphere is outside of a plane through the eye if its centre is farther from it than its radius. The planes here are
    those of the sides of the picture, moved outward by four tiles: a cone around a tile is wider than the tile.
    """
    shown, found = VIEWS[view], lists[view]
    projection = shown.projection.clip_from_view(SIZE[0] / SIZE[1])
    view_from_world = np.linalg.inv(shown.world_from_view)
    margin = 1.0 + 2 * 36.0 / np.array(SIZE)
    hidden, reached = 0, reaches(scene, 0.001)
    for place, record in enumerate(found.order):
        reach = reached[record - 3]
        centre = view_from_world @ np.append(reach.position, 1.0)
        radius = reach.radius * 1.001 + 1e-3
        if projection[3, 3] == 0:  # perspective: the side planes go through the eye
            planes = [
                np.array([sign * projection[axis, axis], -margin[axis]])
                / np.hypot(projection[axis, axis], margin[axis])
                for axis in (0, 1)
                for sign in (1, -1)
            ]
            sides = [plane[0] * centre[i // 2] - plane[1] * centre[2] for i, plane in enumerate(planes)]
            outside = max(side for side in sides) > radius or centre[2] > radius
        else:
            away = np.abs(centre[:2]) - margin / np.abs(np.diag(projection)[:2])
            outside = away.max() > radius or centre[2] > radius
        if outside:
            hidden += 1
            assert not found.tiles[:, :, place].any(), f"light {record} covers nothing of the picture"
    assert hidden > 0 or view == "above"


@pytest.mark.feature("clustered/depth-bins")
def test_bins_without_a_light_are_flagged(chapter):
    """All lights are within half a metre of one depth: other bins are empty, and say so by 0 as their last place."""
    scene = lit_town(40)
    eye = np.array((0.0, 30.0, 0.0))
    scene.nodes.matrix[-40:, :3, 3] = (0.0, 0.0, 0.0)
    lights = [replace(light, kind="point", range=0.5) for light in scene.lights]
    view = View(pose_looking_at(eye, (0.0, 0.0, 0.0), (0, 0, 1)), Perspective(0.9, 0.05))
    (found,) = lists_of(chapter, replace(scene, lights=lights), view)
    full = found.bins[:, 1] > 0
    assert full[found.bin_of(np.array([29.6, 30.0, 30.4]))].all()
    assert not full[found.bin_of(np.array([0.2, 5.0, 20.0, 28.9]))].any()


def test_tiles_grow_until_the_device_holds_them():
    size, lights = (7680, 4320), 4096
    assert ListLayout.of(lights, size, 1 << 30).tile_log2 == 3
    assert ListLayout.of(lights, size, 1 << 27).tile_log2 == 4
    with pytest.raises(UnsupportedError, match="most_lights"):
        ListLayout.of(lights, size, 1 << 18)


@pytest.mark.feature("clustered/lighting-loop")
def test_few_lights_have_no_lists(chapter):
    """The pair of the skip: nothing is there for them, and the picture is that of brute force."""
    pictures = []
    for lists in ("clusters", "brute"):
        settings = replaced(LIT, light_lists=lists)
        with chapter.open(lit_town(LEAST_LIGHTS - 1), SIZE, settings, outputs=("color_linear",)) as renderer:
            frame = renderer.render(VIEWS["inside"])
            pictures.append(frame.image("color_linear").copy())
            assert "light_lists" not in frame.timings
            assert renderer._data.light_lists is None
            assert renderer.techniques["clusters"]._pass.pipelines == ()
    assert np.array_equal(*pictures) and pictures[0].max() > 0


@pytest.mark.feature("clustered/light-sort")
def test_views_without_light_sort_no_lights(chapter):
    """And show what they show of the scene with a single light; a view that counts lights does sort them."""
    view, pictures = VIEWS["inside"], []
    for count in (LEAST_LIGHTS, 1):
        with chapter.open(lit_town(count), SIZE, replaced(LIT, view="depth")) as renderer:
            frame = renderer.render(view)
            assert "light_lists" not in frame.timings and frame.work["lights"] == 0
            pictures.append(frame.image("color").copy())
    assert np.array_equal(*pictures) and pictures[0].any()
    with chapter.open(lit_town(LEAST_LIGHTS), SIZE, replaced(LIT, view="light-count")) as renderer:
        assert "light_lists" in renderer.render(view).timings


@pytest.mark.feature("clustered/light-sort")
@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_lights_are_sorted_from_the_edit_on_that_lights_a_surface(chapter, graph):
    lit, view, settings = lit_town(LEAST_LIGHTS), VIEWS["inside"], replaced(LIT, graph=graph)
    scene = replace(lit, materials=[replace(material, unlit=True) for material in lit.materials])
    scene.origin = lit.origin
    with chapter.open(scene, SIZE, settings) as renderer:
        before = renderer.render(view)
        assert before.image("color").any() and "light_lists" not in before.timings
        with scene.edit() as edit:
            for number, material in enumerate(lit.materials):
                edit.set_material(number, material)
        after = renderer.render(view)
        assert "light_lists" in after.timings
        with chapter.open(lit, SIZE, settings) as other:
            assert np.array_equal(after.image("color"), other.render(view).image("color"))
