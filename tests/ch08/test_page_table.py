"""Memory of shadow maps by need: the pool, sizes of lamps, tiles that follow reports, and kinds of pages in frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.page_table import lamps
from chapters.ch08.page_table.pool import FRAMES, TilePool, places_of
from chapters.ch08.page_table.residency import KEPT, Need, Residency, read_report
from chapters.ch08.settings import Settings
from chapters.ch08.shadows import model
from chapters.ch08.shadows.layout import NONE
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene
from tests.support.shadows import PLAIN, all_faces, faces_of, placed, point, spot, sun, yard

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (64, 64)
BASE = Settings(
    **PLAIN,
    shadow_sun_size=256,
    shadow_size=256,
    shadow_cascades=1,
)
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
ASIDE = View(pose_looking_at((3, 4, 5), (0, 0.3, 0)), Perspective())
SUN, SPOT, POINT = sun((0.5, -1.0, 0.3)), spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8))


def settled(renderer, view, name="color_linear", most=30):
    """Draw a view until nothing is missing any more; return the picture and the frames that it took."""
    for number in range(1, most):
        frame = renderer.render(view)
        picture = frame.image(name).astype(np.float64)
        if renderer.techniques["shadows"].resting(0.0):
            return picture, number
    raise AssertionError("shadows come to no rest")


# --- the pool ---


@pytest.mark.feature("sparse/page-pool")
def test_no_tile_has_two_owners_and_what_is_given_up_waits_for_two_frames():
    pool, random = TilePool(50, (8, 7), 200), np.random.default_rng(7)
    held, given_up = np.zeros(400, bool), np.full(50, -10)
    for frame in range(200):
        pool.begin()
        words = random.permutation(400)[: random.integers(1, 20)]
        tiles = pool.tile_of[words]
        given_up[tiles[tiles >= 0]] = frame
        pool.release(words)
        held[words] = False
        taken = words[: min(len(words), pool.free)]
        pool.assign(taken)
        held[taken] = True
        assert (frame - given_up[pool.tile_of[taken]] >= FRAMES).all()
        owned = pool.table[held]
        assert pool.used == held.sum() == len(np.unique(owned)) and (pool.table[~held] == NONE).all()
        assert pool.used + pool.free + pool.is_waiting.sum() == pool.tiles
        assert ((owned & 0xFF) < 8).all() and ((owned >> 8) * 8 + (owned & 0xFF) < 50).all()
    with pytest.raises(ValueError, match="tiles are more than"):
        pool.assign(np.flatnonzero(~held)[:60])
    assert model.TILE == 128 and model.TILE_BYTES == 64 << 10


def test_places_go_by_rows_and_layers():
    words = places_of(np.array([0, 7, 8, 55, 56]), 8, 7)
    assert words.tolist() == [0, 7, 1 << 8, 7 | 6 << 8, 1 << 16]


# --- sizes of lamps ---


def test_the_most_important_lamps_have_slots_and_keep_them():
    slots, faces = lamps.Lamps(3, 4), np.array([6, 6, 1, 6, 6])
    slots.choose(np.array([1.0, 5.0, 3.0, 0.0, 2.0]), faces, 1)
    assert slots.places.tolist() == [1, 2, 4] and slots.counts.tolist() == [6, 1, 6]
    slots.levels[:] = 2
    # Little more important than one that has a slot is not enough to take it; much more is.
    slots.choose(np.array([2.5, 5.0, 3.0, 0.0, 2.0]), faces, 2)
    assert slots.places.tolist() == [1, 2, 4] and slots.since.tolist() == [1, 1, 1]
    slots.choose(np.array([4.0, 5.0, 3.0, 0.0, 2.0]), faces, 3)
    assert slots.places.tolist() == [1, 2, 0] and slots.since.tolist() == [1, 1, 3]
    assert slots.levels.tolist() == [2, 2, 0]
    slots.choose(np.zeros(5), faces, 4)
    assert slots.places.tolist() == [-1, -1, -1] and not len(slots.active)


def test_too_many_texels_become_fewer_from_the_least_important_light_on():
    counts, importance = np.array([6, 6, 1, 6]), np.array([1.0, 4.0, 3.0, 2.0])
    costs, levels = lamps.whole_costs(counts, 4, False), np.array([3, 3, 4, 2])

    def sizes(most):
        return lamps.sizes_of(lamps.fitted(levels, counts, importance, costs, most), counts).tolist()

    assert sizes(24 + 24 + 16 + 6) == [256, 256, 512, 128]
    assert sizes(69) == [128, 256, 512, 128]
    assert sizes(34) == [128, 128, 512, 128]
    assert sizes(21) == [40, 128, 256, 128]
    assert sizes(4) == [40, 40, 128, 40]
    assert sizes(2) == [0, 40, 128, 0]


def test_lights_that_share_too_few_tiles_lose_the_same_factor():
    random = np.random.default_rng(8)
    resolution, counts = random.uniform(30, 3000, 60), np.where(random.uniform(size=60) < 0.7, 6, 1)
    wanted, importance = lamps.level_above(resolution, counts, 5), random.uniform(size=60)
    costs = lamps.whole_costs(counts, 5, False)

    def taken(levels):
        return int(np.take_along_axis(costs, levels[:, None], axis=1).sum())

    whole = taken(wanted)
    for most in (60, 100, 400, 1500, whole - 1, whole):
        levels = lamps.spread(resolution, wanted, counts, importance, costs, most)
        assert taken(levels) <= most and (levels <= wanted).all() and (levels >= 1).all()
        assert most in (60, whole) or taken(levels) > most - 96 * 4  # no more is left than one light may take
        # Of two lights alike, the one with the higher resolution has no smaller size, but for one step.
        cubes = np.flatnonzero(counts == 6)
        sizes = lamps.sizes_of(levels, counts)[cubes[np.argsort(resolution[cubes])]]
        assert not (sizes[:-1] > 4 * sizes[1:]).any()
    assert np.array_equal(lamps.spread(resolution, wanted, counts, importance, costs, whole), wanted)


# --- tiles that follow needs ---

PLACES = model.Places(suns=1, cascades=2, sun_side=2, lamps=3, lamp_side=4, coarse=True)


def residency(tiles=200, budget=1000, most=10**6):
    pool = TilePool(tiles, (16, 13), PLACES.words)
    slots = lamps.Lamps(3, lamps.level_of_side(4))
    slots.choose(np.array([3.0, 2.0, 1.0]), np.array([6, 1, 6]), 0)
    return pool, slots, Residency(pool, PLACES, slots, budget, lambda wanted: most)


STILL = np.zeros(5, bool)  # two cascades and three lamps


def need(*resolution, tiles=()):
    wanted = np.zeros(PLACES.coarse_word, bool)
    wanted[list(tiles)] = True
    return Need(np.array(resolution, np.float64), wanted)


def held_words(pool):
    return np.flatnonzero(pool.tile_of >= 0)


COARSE_WORDS = [PLACES.coarse_word + n for n in range(4)]


def test_what_a_picture_reads_has_memory_and_each_light_its_coarse_page():
    pool, slots, resident = residency()
    first = PLACES.lamp_word
    assert first == 8 and PLACES.coarse_word == 8 + 3 * 96 and PLACES.words == PLACES.coarse_word + 4
    # A tile of the finer cascade; one cell of a lamp at the highest level, which is half of a tile at the next.
    resident.follow(
        need(256, 40, 128, tiles=(1, first + 16 * 2 + 5, first + 192 + 15)), now=True, mixed=STILL
    )
    assert slots.levels.tolist() == [3, 1, 2]
    # At 256 the tile of cell (1, 1) is (0, 0) of face 2; at 128 a face has one tile.
    assert held_words(pool).tolist() == [1, first + 32, first + 192, *COARSE_WORDS]
    # What is needed no more goes after some frames, and new tiles come at once.
    for frame in range(KEPT + 2):
        pool.begin()
        changed = resident.follow(need(256, np.nan, 128, tiles=(2,)), now=False, mixed=STILL)
        assert changed == (frame in (0, KEPT)), frame
        assert resident.ages == (frame < KEPT) and not resident.waits
    assert held_words(pool).tolist() == [2, *COARSE_WORDS]
    assert slots.levels.tolist() == [3, 1, 2]  # nothing is known of the second: it stays


def test_a_budget_gives_tiles_to_the_most_important_lights_first():
    pool, slots, resident = residency(budget=7)
    first = PLACES.lamp_word
    resident.follow(need(1, 1, 1), now=True, mixed=STILL)
    assert held_words(pool).tolist() == COARSE_WORDS
    wish = need(512, 256, 128, tiles=(0, *range(first, first + 6), first + 96, first + 192, first + 208))
    seen = []
    for _ in range(4):
        pool.begin()
        resident.follow(wish, now=False, mixed=STILL)
        seen.append((slots.levels.tolist(), len(resident.assigned)))
        assert len(resident.assigned) <= 7
    # A light gets all tiles of its new size at once: 1 of the sun and 6 of the first lamp, then 1 and 2.
    assert seen == [([4, 1, 1], 7), ([4, 3, 2], 3), ([4, 3, 2], 0), ([4, 3, 2], 0)]
    assert not resident.waits


def test_a_full_pool_gives_a_light_its_new_size_two_frames_later():
    pool, slots, resident = residency(tiles=4 + 8)
    first = PLACES.lamp_word
    cells = [first + n for n in range(8)]
    resident.follow(need(512, 1, 1, tiles=cells), now=True, mixed=STILL)
    assert slots.levels.tolist() == [4, 1, 1] and pool.free == 0
    # Now the third one needs all, and the first is far away.
    wish = need(1, 1, 512, tiles=[first + 192 + n for n in range(8)])
    levels = []
    for _ in range(8):
        pool.begin()
        resident.follow(wish, now=False, mixed=STILL)
        levels.append(slots.levels.tolist())
        assert pool.tile_of[COARSE_WORDS].min() >= 0
    assert levels[-1] == [1, 1, 4] and [1, 1, 1] in levels


def test_refused_memory_lowers_sizes():
    pool, slots, resident = residency(tiles=100, most=20)
    first = PLACES.lamp_word
    resident.follow(
        need(512, 512, 512, tiles=[*range(first, first + 96), first + 100]), now=True, mixed=STILL
    )
    assert pool.tiles == 20 and pool.used <= 20 and slots.lowered >= 1
    assert (slots.levels >= 1).all() and slots.levels[0] < 4


def test_lights_that_movers_meet_keep_what_they_show_without_them():
    pool, _slots, resident = residency()
    first = PLACES.lamp_word
    wish, mixed = need(256, 1, 1, tiles=(1, 5, first + 5)), np.array([False, True, True, False, False])
    resident.follow(wish, now=True, mixed=mixed)
    shown = [1, 5, first, *COARSE_WORDS]
    kept = [5, first, PLACES.coarse_word + 1]  # the second cascade, the first lamp, and its coarse page
    assert held_words(pool).tolist() == [*shown, *(PLACES.words + word for word in kept)]
    for _ in range(KEPT + 2):
        pool.begin()
        resident.follow(wish, now=False, mixed=STILL)
    assert held_words(pool).tolist() == shown


def test_a_report_says_which_tiles_and_how_fine():
    words = np.zeros(PLACES.report_words, np.uint32)
    words[:3] = np.array([100.0, 0.0, 8192.0], np.float32).view(np.uint32)
    words[3 + 0], words[3 + 9] = 1 << 3 | 1 << 31, 1 << 1
    found = read_report(words, PLACES, 0.5)
    assert found.resolution[[0, 2]].tolist() == [50.0, 4096.0] and np.isnan(found.resolution[1])
    assert np.flatnonzero(found.tiles).tolist() == [3, 31, 9 * 32 + 1]


# --- frames ---


def tapped(face, points, radius) -> set[tuple[int, int]]:
    """Return the tiles (column, row) of a face that filters read at points (N, 3), in float64."""
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    p = (points - face["origin"].astype(np.float64)) @ axes.T
    scale = np.array([face["scale_x"], face["scale_y"]], np.float64)
    ahead = p[:, 2:] if face["perspective"] else 1.0
    texel = np.floor(p[:, :2] / ahead * scale + 0.5 * int(face["size"]))
    texel = texel[(p[:, 2] > face["near"]) & (np.abs(texel - int(face["size"]) / 2) < 1e6).all(axis=1)]
    tiles = set()
    for shift in np.ndindex(2, 2):
        at = texel + radius * (2 * np.array(shift) - 1)
        at = np.clip(at, 0, int(face["size"]) - 1).astype(int) // 128
        tiles |= set(map(tuple, at.tolist()))
    return tiles


@pytest.mark.feature("shadows/per-light-resolution")
@pytest.mark.parametrize("graph", [pytest.param("forward", marks=pytest.mark.long), "deferred"])
def test_reports_name_the_tiles_that_filters_read(chapter, graph):
    scene = yard(SUN, SPOT, POINT)
    size = (40, 30)
    turned = replaced(BASE, graph=graph, shadow_detail=16.0, shadow_sun_size=512)
    with chapter.open(scene, size, turned, outputs=("color", "depth")) as renderer:
        depth = renderer.render(ASIDE).image("depth").astype(np.float64)
        technique = renderer.techniques["shadows"]
        lights, held = technique.lights, technique.lights.held
        report = technique._report.read(0)
        assert report is not None
        found = read_report(report, held, 1.0)
        faces = faces_of(renderer)
        y, x = np.nonzero(depth > 0)
        up = np.tan(ASIDE.projection.yfov / 2)
        ahead = ASIDE.projection.near / depth[y, x]
        ndc = np.stack([(x + 0.5) / size[0] * 2 - 1, 1 - (y + 0.5) / size[1] * 2], axis=1)
        in_view = np.stack([ndc[:, 0] * up * size[0] / size[1] * ahead, ndc[:, 1] * up * ahead, -ahead], 1)
        pose = ASIDE.world_from_view
        points = in_view @ pose[:3, :3].T + pose[:3, 3] - scene.origin
        for number, face in enumerate(faces):
            of_sun = number < held.first_lamp
            slot, part = divmod(max(number - held.first_lamp, 0), 12)
            if face["light"] == 0xFFFFFFFF or part >= 6 or number == 1:
                continue  # no face, or a coarse one
            mine = np.ones(len(points), bool)
            if not of_sun:
                away = points - face["origin"]
                own = np.abs(away @ face["ahead"]) >= np.abs(away).max(axis=1) - 1e-9
                mine = ((away @ face["ahead"]) > 0) & (own if lights.lamps.counts[slot] == 6 else True)
                if lights.lamps.counts[slot] == 1:
                    cosine = (away @ face["ahead"]) / np.linalg.norm(away, axis=1)
                    mine &= cosine > np.cos(np.radians(39.9))
            side = held.sun_side if of_sun else held.lamp_side
            first = 0 if of_sun else held.lamp_word + slot * held.lamp_words + part * side * side
            bits = found.tiles[first : first + side * side].reshape(side, side)
            told = {(column, row) for row, column in np.argwhere(bits).tolist()}
            kernel = int(face["guard"]) - 1
            assert tapped(face, points[mine], kernel) <= told <= tapped(face, points[mine], kernel + 6), (
                number
            )
        # A pixel sees a lamp's sphere under as many texels as pixels: between those of points at either end.
        wide = 2 * up / size[1] * ahead
        for slot, place in enumerate(lights.lamps.places):
            away = np.linalg.norm(points - lights._records["position"][place], axis=1)
            of_points = np.sqrt(4 * np.pi / 6) * away / wide
            assert 0.3 * of_points.min() < found.resolution[slot] < 1.05 * of_points.max()


@pytest.mark.core
@pytest.mark.feature("sparse/residency-image", "sparse/page-pool", "shadows/reduced-resolution")
@pytest.mark.parametrize(
    "graph", ["deferred", *(pytest.param(graph, marks=pytest.mark.long) for graph in ("compute", "forward"))]
)
def test_all_kinds_of_memory_give_the_same_picture(chapter, graph):
    scene = yard(SUN, SPOT, POINT, extra=(placed((2.0, 1.0, -2.0), (1.5, 1.0), (1.0, 0.4, 0.2)),))
    turned = replaced(BASE, graph=graph, shadow_detail=16.0, shadow_sun_size=512, shadow_cascades=2)
    pictures, bytes_ = [], []
    for memory, without in (("full", ()), ("pages", ("sparse",)), ("pages", ())):
        with chapter.open(
            scene,
            (48, 32),
            replaced(turned, shadow_memory=memory),
            without=without,
            outputs=("color_linear",),
        ) as renderer:
            picture, _ = settled(renderer, ASIDE)
            work = renderer.render(ASIDE).work
            steps = {step.name for step in renderer.graph.steps}
            # Nothing is blended, and full memory asks for nothing.
            asks = {"shadow_need"} if memory == "pages" else set()
            assert steps & {"shadow_need", "shadow_need_boxes"} == asks
            pictures.append(picture)
            bytes_.append(work["shadow_bytes"])
            assert work["shadow_lights_lowered"] == 0
            if renderer.techniques["shadows"].pages.virtual is not None:
                assert work["shadow_bytes"] == work["shadow_pages"] << 16 < bytes_[0]
    assert np.array_equal(pictures[1], pictures[0]) and np.array_equal(pictures[2], pictures[0])
    assert pictures[0].max() > 0


def test_samples_and_glass_get_the_tiles_that_they_read(chapter):
    glass = Material(
        roughness=1.0, metallic=0.0, double_sided=True, alpha_mode="blend", base_color=(1, 1, 1, 0.6)
    )
    solid = Material(roughness=1.0, metallic=0.0, double_sided=True)
    light, pose = spot((0.0, 5.0, 0.1), (0.0, 0.0, 0.0))
    squares = (placed((0, 0, 0), (3, 3), (0, 1, 0)), placed((0, 3.0, 0), (0.6, 0.6), (0, 1, 0)))
    scene = quad_scene(materials=(glass, solid), matrices=(*squares, pose), instance_materials=(0, 1))
    scene = replace(scene, lights=[replace(light, node=2)])
    below = View(pose_looking_at((0, 2.5, 0), (0, 0, 0), (0, 0, -1)), Orthographic(1.6, 0.1, 20.0))
    for turned in ({"graph": "compute"}, {"graph": "forward", "msaa": 4}):
        wanted, found = (
            _picture(chapter, scene, below, shadow_memory=memory, shadow_detail=16.0, **turned)
            for memory in ("full", "pages")
        )
        assert np.array_equal(wanted, found), turned
        assert found[28:36, 28:36].max() < 0.1 * found.max()


def _picture(chapter, scene, view, **turned):
    with chapter.open(scene, SIZE, replaced(BASE, **turned), outputs=("color_linear",)) as renderer:
        picture, _ = settled(renderer, view)
        return picture


@pytest.mark.feature("sparse/residency-image")
def test_a_walk_leaves_no_stale_texel(chapter):
    scene = yard(SUN, SPOT, POINT)
    turned = replaced(BASE, shadow_sun_size=512, shadow_cascades=2, shadow_detail=4.0, page_budget=16)
    walk = [
        View(pose_looking_at((3 - 0.8 * k, 2.5, 4 - 0.3 * k), (0.5 * k - 1, 0, 0)), Perspective())
        for k in range(4)
    ]
    kinds = []
    for without in (("sparse",), ()):
        with chapter.open(scene, SIZE, turned, without=without, outputs=("color_linear",)) as renderer:
            pictures = [renderer.render(view).image("color_linear").copy() for view in walk]
            last, _ = settled(renderer, walk[-1])
            kinds.append([*pictures, last])
        if without:
            continue
        with chapter.open(scene, SIZE, turned, without=without, outputs=("color_linear",)) as renderer:
            again = [renderer.render(view).image("color_linear").copy() for view in walk]
            assert all(map(np.array_equal, again, pictures))  # equal calls, equal pixels
    assert all(map(np.array_equal, *kinds))
    assert all((before != after).any() for before, after in zip(kinds[0][:-2], kinds[0][1:-1], strict=True))


def test_no_light_is_without_shadow_while_tiles_wait(chapter):
    scene = yard(POINT)
    turned = replaced(BASE, shadow_detail=16.0, page_budget=1, shadow_kernel=1, view="shadow-factor")
    turned = replaced(turned, graph="forward")
    away = View(pose_looking_at((0, 6, 0.1), (0, 12, 0)), Perspective(0.5))
    with chapter.open(scene, SIZE, turned, outputs=("color",)) as renderer:
        settled(renderer, away, "color")
        assert renderer.render(away).work["shadow_pages"] == 1  # the coarse page
        first = renderer.render(ABOVE)
        dark = (first.image("color")[..., 0] == 0).mean()
        assert first.work["shadow_pages"] == 1 and dark > 0.02
        fine, frames = settled(renderer, ABOVE, "color")
        assert frames > 3 and abs((fine[..., 0] == 0).mean() - dark) < 0.02


@pytest.mark.feature("shadows/caching")
def test_a_settled_view_reports_draws_and_binds_nothing(chapter):
    scene = yard(SUN, SPOT, POINT)
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        settled(renderer, ASIDE)
        for _ in range(3):
            frame = renderer.render(ASIDE)
        technique = renderer.techniques["shadows"]
        assert frame.work["shadow_pages_drawn"] == frame.work["shadow_faces_drawn"] == 0
        assert technique._report.read(0) is technique._report.read(1) is None and frame.work["recorded"] == 0
        before = technique.lights.pool.revision
        node = scene.lights[2].node
        with scene.edit() as edit:
            edit.set_transform(node, translation=(-1.0, 3.0, 0.9))
        moved = renderer.render(ASIDE)
        slot = int(np.flatnonzero(technique.lights.lamps.places == 2)[0])
        first = technique.lights.held.first_lamp + 12 * slot
        assert set(technique.passes["shadows"].schedule.faces) <= set(range(first, first + 12))
        assert moved.work["shadow_faces_drawn"] > 0 and technique.lights.pool.revision == before


def test_a_renderer_follows_its_size_and_a_cut(chapter):
    scene = yard(SUN, SPOT, POINT)
    turned = replaced(BASE, shadow_sun_size=512, shadow_detail=2.0)
    with chapter.open(scene, SIZE, turned, outputs=("color_linear",)) as renderer:
        settled(renderer, ABOVE)
        renderer.resize((48, 32))
        there = replace(ASIDE, cut=True)
        cut = renderer.render(there).image("color_linear").copy()
        maps = all_faces(renderer)
    with chapter.open(scene, (48, 32), turned, outputs=("color_linear",)) as renderer:
        assert np.array_equal(renderer.render(ASIDE).image("color_linear"), cut)
        assert np.array_equal(all_faces(renderer), maps)


AWAY = View(pose_looking_at((0, 6, 0.1), (0, 12, 0)), Perspective(0.5))


@pytest.mark.parametrize("budget", [1, pytest.param(256, marks=pytest.mark.long)])
def test_what_comes_into_view_has_coarse_shadows_at_once(chapter, budget):
    """Light is never without its shadow: each light of a view that comes has its coarse page in its first frame."""
    lights = [sun((0.5, -1.0, 0.3)), sun((-0.4, -1.0, 0.1)), POINT, SPOT, point((1.2, 3.0, -0.8))]
    scene = yard(*lights)
    turned = replaced(BASE, page_budget=budget, shadow_kernel=1, view="shadow-factor", graph="forward")
    with chapter.open(scene, SIZE, turned, outputs=("color",)) as renderer:
        settled(renderer, AWAY, "color")
        lights = renderer.render(ABOVE)
        first = lights.image("color")[..., 0].astype(np.float64) / 255
        assert lights.work["shadow_lights"] == 5
        fine, _ = settled(renderer, ABOVE, "color")
    dark = fine[..., 0] / 255 < 0.9
    assert (
        dark.mean() > 0.05
        and first[dark].mean() < 0.9
        and np.abs(first[dark] - fine[dark, 0] / 255).mean() < 0.15
    )


def test_edits_of_what_is_shown_and_of_kinds_of_lights_equal_a_new_renderer(chapter):
    def scene_of(far_shown=True, as_point=False):
        far = [placed((12.0 + k, 1.0, 0.0), (1.0, 1.0), (0.0, 0.0, 1.0)) for k in range(2)]
        made = yard(SUN, SPOT, POINT, extra=tuple(far))
        made.instances.visible[7:] = far_shown
        if as_point:
            made.lights[1] = replace(made.lights[1], kind="point")
        return made

    scene = scene_of(far_shown=False)
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        settled(renderer, ASIDE)
        with scene.edit() as edit:
            for number in (7, 8):
                edit.set_visible(number, True)
        shown, _ = settled(renderer, ASIDE)
        with scene.edit() as edit:
            edit.set_light(1, replace(scene.lights[1], kind="point"))
        settled(renderer, ASIDE)
        with scene.edit() as edit:
            edit.set_material(0, replace(scene.materials[0], alpha_mode="mask"))
        pointed, _ = settled(renderer, ASIDE)
    with chapter.open(scene_of(), SIZE, BASE, outputs=("color_linear",)) as renderer:
        assert np.array_equal(settled(renderer, ASIDE)[0], shown)
    with chapter.open(scene_of(as_point=True), SIZE, BASE, outputs=("color_linear",)) as renderer:
        assert np.array_equal(settled(renderer, ASIDE)[0], pointed)


@pytest.mark.parametrize("pool", [0.5, pytest.param(1.5, marks=pytest.mark.long)])
def test_a_small_pool_comes_to_rest_after_something_has_moved(chapter, pool):
    lamps_ = [point((x, 3.0, z), reach=9.0) for x in (-2.0, 0.0, 2.0) for z in (-2.0, 2.0)]
    scene = yard(SUN, *lamps_)
    turned = replaced(BASE, shadow_pool=pool, shadow_sun_size=256, shadow_detail=2.0)
    with chapter.open(scene, SIZE, turned, outputs=("color_linear",)) as renderer:
        before, _ = settled(renderer, ASIDE)
        levels = renderer.techniques["shadows"].lights.lamps.levels.copy()
        for step in range(3):
            matrix = scene.nodes.matrix[1].copy()
            matrix[0, 3] += (0.1, 0.1, -0.2)[step]
            with scene.edit() as edit:
                edit.set_transform(1, matrix=matrix)
            renderer.render(ASIDE)
        after, _ = settled(renderer, ASIDE)
        assert np.array_equal(renderer.techniques["shadows"].lights.lamps.levels, levels)
        assert np.allclose(after, before, atol=1e-5)
        renderer.reset_history("a test")
        views = [renderer.render(view).image("color_linear").copy() for view in (ASIDE, ABOVE, ABOVE)]
    with chapter.open(scene, SIZE, turned, outputs=("color_linear",)) as renderer:
        fresh = [renderer.render(view).image("color_linear").copy() for view in (ASIDE, ABOVE, ABOVE)]
    assert all(map(np.array_equal, views, fresh))


def test_a_camera_that_was_nowhere_leaves_no_trace(chapter):
    scene = yard(SUN, SPOT, POINT)
    nowhere = replace(ASIDE, world_from_view=np.full((4, 4), np.nan))
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        renderer.render(nowhere)
        after, _ = settled(renderer, ASIDE)
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        assert np.array_equal(settled(renderer, ASIDE)[0], after)
