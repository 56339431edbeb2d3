"""Rays that are switched off cost nothing, and what rays refuse is refused in a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from chapters import settings_class
from chapters.ch12.rays import model, tiles
from chapters.ch12.rays.bvh import memory
from chapters.ch12.scene import pages
from chapters.ch12.settings import Settings
from common.errors import SceneError, UserError
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material
from common.view.camera import Perspective, View
from tests.support.frame_costs import chapter_before
from tests.support.ray_scenes import placements, soup, soup_scene, world_triangles
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.shadows import PLAIN, point, yard
from tests.support.traced_pictures import SIZE, light, off_edges, opened, picture, primary_rays, ways_of
from tests.twins.brute_rays import nearest

pytestmark = pytest.mark.variants("vulkan", "gl")

VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
MATTE = Material(roughness=1.0, metallic=0.0, double_sided=True)


def court():
    return yard(point((-1.2, 3.0, 0.8)), material=MATTE)


# --- without rays ---


@pytest.mark.parametrize("graph", ["forward", "deferred", "compute"])
def test_without_rays_the_frame_is_that_of_the_chapter_before(chapter, graph):
    """Its picture to the bit, its passes, its counters, and no structure."""
    knobs = {**PLAIN, "shadows": "off", "graph": graph}
    before = chapter_before(chapter)
    with before.open(
        court(), SIZE, settings_class(before.which)(**knobs), outputs={"color_linear"}
    ) as renderer:
        frame = renderer.render(VIEW)
        wanted, work, passes = frame.image("color_linear"), frame.work, set(frame.timings)
    with chapter.open(court(), SIZE, Settings(**knobs), outputs={"color_linear"}) as renderer:
        frame = renderer.render(VIEW)
        assert np.array_equal(frame.image("color_linear"), wanted) and set(frame.timings) == passes
        assert not any(name.startswith("ray_") for name in frame.work)
        assert frame.work | {"passes_skipped": 0} == work | {"passes_skipped": 0}
        assert not {"ray_structures", "rays"} & {it.name for it in renderer.passes}
        assert not any(name.startswith("ray_") for name in renderer.graph.resources)


def test_a_view_of_a_quantity_is_rasterised(chapter):
    with opened(chapter, court(), view="roughness") as renderer:
        assert "ray_tiles" not in renderer.render(VIEW).work


# --- what is refused, and what is not there ---


@pytest.mark.feature("ray-tracing/capability-gate")
def test_a_way_that_the_device_lacks_is_refused_in_a_sentence(chapter):
    """On OpenGL as on Vulkan without the feature; `auto` takes what is left."""
    for way, feature in (("pipeline", "ray-tracing"), ("query", "ray-query")):
        with pytest.raises(
            UserError, match=rf"ray_way={way} needs {feature}, which .*: set ray_way=bvh, or auto"
        ):
            opened_without(chapter, {"ray-tracing", "ray-query"}, ray_way=way)
    with opened_without(chapter, {"ray-tracing", "ray-query"}) as renderer:
        work = renderer.render(VIEW).work
        assert "ray_triangles_left_out" in work and "ray_structures" not in work
    if chapter.backend == "vulkan" and chapter.device.has("ray-query"):
        with opened_without(chapter, {"ray-tracing"}) as renderer:
            assert renderer.render(VIEW).work["ray_structures"] == 1


def opened_without(chapter, without, **turned):
    settings = Settings(**PLAIN, shadows="off", rays="whole", **turned)
    return chapter.open(court(), SIZE, settings, without=without)


def test_several_pages_of_geometry_are_refused(chapter, monkeypatch):
    monkeypatch.setattr(pages, "PAGE_BYTES", 2048)
    scene = soup_scene([soup(20, 1), soup(20, 2)], [(0, np.eye(4)), (1, np.eye(4))])
    with pytest.raises(
        UserError,
        match=r"takes 1 MiB in 2 pages of 128 MiB at most, and rays, .*: set rays=off, or draw fewer",
    ):
        picture(chapter, scene, VIEW)
    with opened(chapter, scene, rays="off") as renderer:
        assert len(renderer._data.pages) == 2


def many_sizes(count):
    """Return squares in a row, each with an image of another size."""
    images = [Image(f"{n}", np.full((1, n + 1, 4), 200, np.uint8)) for n in range(count)]
    materials = [Material(base_color_texture=texture(n), unlit=True) for n in range(count)]
    small = np.diag((1 / count, 1.0, 1.0, 1.0))
    places = [translated((2 * n + 1) / count - 1.0) @ small for n in range(count)]
    return quad_scene(
        materials=tuple(materials),
        images=tuple(images),
        matrices=tuple(places),
        instance_materials=tuple(range(count)),
    )


def test_textures_in_several_sets_are_refused(chapter):
    """Where they have more sizes than a shader has samplers for. With bindless textures all of them are one set."""
    settings = Settings(**PLAIN, shadows="off", rays="whole", ray_way="bvh")
    scene, said = (
        many_sizes(14),
        r"need 2 sets of 13 arrays at most, .*: set rays=off, give images fewer sizes",
    )
    with pytest.raises(UserError, match=said):
        chapter.open(scene, (40, 40), settings, without={"bindless"})
    if chapter.backend == "vulkan" and chapter.device.has("bindless"):
        with chapter.open(scene, (40, 40), settings, outputs={"color_linear"}) as renderer:
            assert (light(renderer, facing())[20].max(axis=-1) > 0.3).all()


@pytest.mark.feature("acceleration/tlas")
def test_more_instances_than_rays_tell_apart_are_refused(chapter, monkeypatch):
    """The limit is lowered instead of the scene being raised: 2^24 instances take 2 GiB."""
    assert model.MOST_INSTANCES == 1 << 24
    monkeypatch.setattr(model, "MOST_INSTANCES", 6)
    for way in ways_of(chapter):
        with pytest.raises(
            SceneError, match="scene has 7 instances, and rays of this device tell 6 apart: merge"
        ):
            picture(chapter, court(), VIEW, ray_way=way)
    assert memory.check_count is model.check_count


def test_a_scene_of_nothing_is_its_background(chapter):
    for way in ways_of(chapter):
        for scene in (soup_scene([soup(3, 1)], []), soup_scene([], [])):
            assert (picture(chapter, scene, facing(), ray_way=way, background=0.25) == 0.25).all(), way


def test_triangles_without_area_or_with_nan_change_nothing(chapter):
    corners, indices = soup(40, 5)
    corners[indices[3]] = corners[indices[3, 0]]
    corners[indices[9, 2]] = corners[indices[9, 1]]
    corners[indices[17, 1], 1] = np.nan
    corners[indices[30]] = np.inf
    scene = soup_scene([(corners, indices)], [(0, matrix) for matrix in placements()], [MATTE])
    view = View(pose_looking_at((0.5, 1.5, 6.0), (0.0, 0.3, 0.0)), Perspective(0.9, 0.05))
    origins, directions = primary_rays(view, SIZE)
    truth = nearest(origins - scene.origin, directions, 0.0, 1e4, *world_triangles(scene))
    sure = truth.margin > 1e-4
    for way in ways_of(chapter):
        seen = picture(chapter, scene, view, ray_way=way, ray_view="barycentrics").reshape(-1, 3)
        assert np.isfinite(seen).all()
        wanted = np.where(
            (truth.instance >= 0)[:, None], np.column_stack([1 - truth.at.sum(axis=1), truth.at]), 0.0
        )
        assert np.abs(seen - wanted)[sure].max() < 5e-4, way


# --- sizes, histories ---


REACH, COSINE, LAMP_HEIGHT = 11.0, 0.22, 1.5
"""Of `court` in VIEW: metres to the farthest surface, the cosine there, and metres from the lamp to the nearest one."""

ROUNDED = 2 * 16 * 2.0**-24 * REACH / COSINE * 3.0 / LAMP_HEIGHT
"""What two structures of one scene may change of a lit pixel, as a share of its light: 1.9e-4, a twentieth of an 8-bit
step.

A driver may build the same structure in another order, with the corners of a triangle in another order. Then the hit
comes from other roundings, each of 2^-24: a corner's difference to the origin (1), the shear (2), an edge function (3),
the sum of three (2) and the quotient (1) make 9, and 16 with those of the instance's matrix (7). So each of two places
is off by 16 * 2^-24 of the distance, divided by the cosine of incidence. Light falls with the square of the distance r
to the lamp and once with its cosine, so a step s along the surface changes it by 3 s / r at most.
"""


def test_a_renderer_of_another_size_shows_another_picture(chapter):
    """The picture of a renderer opened with that size: to ROUNDED, off edges, where a rounding decides what is hit."""
    way = ways_of(chapter)[0]
    for size in ((1, 1), (7, 3), (33, 17)):
        seen = picture(chapter, court(), VIEW, size, ray_way=way)
        assert seen.shape == (size[1], size[0], 3) and np.isfinite(seen).all()
    with opened(chapter, court(), ray_way=way) as renderer:
        light(renderer, VIEW)
        renderer.resize((24, 18))
        seen, wanted = light(renderer, VIEW), picture(chapter, court(), VIEW, (24, 18), ray_way=way)
    assert seen.shape == wanted.shape == (18, 24, 3) and wanted.max() > 0
    differs = np.abs(seen - wanted).max(axis=-1) > ROUNDED * wanted.max()
    assert not differs[off_edges(wanted, 0.05 * wanted.max())].any() and differs.sum() <= 4


def test_a_history_takes_the_traced_picture(chapter):
    """The mean over a period of offsets is nearer to the mean over many rays of a pixel than one picture is."""
    way = ways_of(chapter)[0]
    fine = picture(chapter, court(), VIEW, (8 * SIZE[0], 8 * SIZE[1]), ray_way=way)
    fine = fine.reshape(SIZE[1], 8, SIZE[0], 8, 3).mean(axis=(1, 3))
    with opened(chapter, court(), ray_way=way, taa="full", jitter_period=8) as renderer:
        frames = [light(renderer, VIEW) for _ in range(16)]
    one = picture(chapter, court(), VIEW, ray_way=way)
    errors = [float(np.sqrt(np.mean((it - fine) ** 2))) for it in (frames[-1], one)]
    assert errors[0] < 0.5 * errors[1], errors


# --- tiles ---


def test_tiles_cover_the_picture_once():
    for size in ((1, 1), (8, 8), (40, 30), (1920, 1080), (33, 700), (0, 5), (5, 0)):
        for count in (1, 2, 3, 16, 1024):
            seen = np.zeros(size[::-1], int)
            parts = tiles.tiles(size, count)
            for x, y, width, height in parts:
                assert width > 0 and height > 0 and x % 8 == 0 and y % 8 == 0
                seen[y : y + height, x : x + width] += 1
            assert (seen == 1).all() and len(parts) <= 2 * count
            largest = max((width * height for *_, width, height in parts), default=0)
            assert largest <= max(64, 4 * size[0] * size[1] / count)


def test_the_number_of_tiles_follows_the_time():
    """A tile takes 100 ms at most in the mean, and a time that varies by less than two changes nothing."""
    assert [tiles.next_count(1, ms) for ms in (0.1, 100.0, 101.0, 400.0, 1e9)] == [1, 1, 4, 8, tiles.MOST]
    assert [tiles.next_count(8, ms) for ms in (800.0, 801.0, 400.0, 201.0, 200.0, 1.0)] == [8, 32, 8, 8, 4, 1]
    for ms in (3.0, 77.0, 1234.5, 50_000.0):
        count = tiles.next_count(1, ms)
        assert ms / count <= tiles.AIM_MS and tiles.next_count(count, ms) == count
        assert tiles.next_count(count, ms * 1.01) in (count, 2 * count)
    assert tiles.first_count(100, True) == 1 and tiles.first_count(2e6, True) > tiles.first_count(2e6, False)


def test_a_frame_takes_as_many_tiles_as_the_time_of_an_earlier_one_asks_for(chapter, monkeypatch):
    took = {"rays": 1000.0}
    way = ways_of(chapter)[0]
    wanted = picture(chapter, court(), VIEW, ray_way=way)
    with opened(chapter, court(), ray_way=way) as renderer:
        monkeypatch.setattr(renderer._api, "timings", lambda slot: dict(took))
        monkeypatch.setattr(
            tiles, "perf_counter", iter(range(1, 10**6)).__next__
        )  # frames are a second apart
        counts, dispatches = [], []
        for _ in range(8):
            frame = renderer.render(VIEW)
            assert np.array_equal(frame.image("color_linear"), wanted)
            counts.append(frame.work["ray_tiles"])
            dispatches.append(frame.work["dispatches"])
        assert counts[:3] == counts[:1] * 3 and set(counts[3:]) == {32}
        assert dispatches[-1] - dispatches[2] >= 20 - counts[0]  # 5 x 4 groups of 8 x 8 pixels
        took["rays"] = 60.0
        assert [renderer.render(VIEW).work["ray_tiles"] for _ in range(2)] == [2, 2]
        took["rays"] = 0.0  # nothing was measured
        assert renderer.render(VIEW).work["ray_tiles"] == 2


def test_the_time_is_read_seldom_while_frames_are_quick(monkeypatch):
    now = iter(np.arange(0.0, 10.0, 0.01))
    monkeypatch.setattr(tiles, "perf_counter", lambda: float(next(now)))
    count = tiles.TileCount()
    due = [count.is_due() for _ in range(64)]
    assert sum(due) == 64 // tiles.EVERY
    monkeypatch.setattr(tiles, "perf_counter", iter(range(100, 200)).__next__)
    assert [count.is_due() for _ in range(5)] == [True] * 5


def test_the_time_of_the_pass_has_the_work_in_it(chapter):
    """On software drivers, too, which write what stands before a dispatch when they come to it."""
    for way in ways_of(chapter):
        with opened(chapter, court(), (160, 120), ray_way=way) as renderer:
            for _ in range(3):
                renderer.render(VIEW).image("color_linear")
            took = []
            for _ in range(4):
                frame = renderer.render(VIEW)
                took.append(frame.timings["rays"])
            assert min(took) > 1.0 or not renderer.capabilities.is_software, (way, took)
