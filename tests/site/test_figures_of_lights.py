"""The figures and the loops of chapter 7 are true: normals, bins, tiles, rays, exposure, layers and the walk."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from chapters.ch07.clusters.model import BINS, STEPS_LOG2
from chapters.ch07.clusters.model import OCTAVES as CHAPTER_OCTAVES
from tests.support.gpu_functions import evaluate
from tests.twins.ambient_occlusion import visibility
from tools.site.figures.canvas import Canvas
from tools.site.figures.ch07 import exposure, fill, layers, lights, normals, occlusion, walk


def words_of(canvas: Canvas) -> str:
    return "\n".join(text for text, _ in canvas.texts)


# --- octahedral normals -----------------------------------------------------------------------------------------------


def test_cells_of_the_sphere_fill_the_square_without_gap_or_overlap():
    """The areas of all cells add up to that of the square, and all turn the same way round."""
    areas = []
    for n, code, color in normals.cells():
        x, y = code.T
        areas.append(0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        inner = np.abs(code).sum(axis=1) <= 1 + 1e-6
        assert inner.all() == (color in "abcd") == bool((n[:, 2] >= -1e-12).all())
    assert min(areas) >= 0 and sum(areas) == pytest.approx(4.0, abs=1e-6)


def test_a_code_gives_its_direction_back():
    n = np.random.default_rng(1).normal(size=(1000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    code = normals.octahedral(n)
    assert np.abs(code).max() <= 1
    np.testing.assert_allclose(normals.direction(code), n, atol=1e-12)


def test_the_errors_of_normals_are_near_the_bounds_of_their_steps():
    """Ten bits: half a step, 1/1022, in all components. Halves: half of their last bit, 2^-11 of a component.

    Octahedral: half a step, 1/65534, in both numbers; where the octahedron is nearest to the centre, in the middle of
    its faces, a length on the sphere is 3 times one of the square across the face, and sqrt(3) times it along an edge.
    """
    ten, half, short = (
        normals.errors()[name] for name in ("3 x 10 bits", "3 halves", "2 x 16 bits, octahedral")
    )
    bounds = [math.degrees(one) for one in (math.sqrt(3) / 1022, 2.0**-11, 3 * math.sqrt(2) / 65534)]
    for (largest, mean, _), bound in zip((ten, half, short), bounds, strict=True):
        assert 0.6 * bound < largest <= bound and 0.1 * bound < mean < 0.6 * bound
    assert ten[2] == short[2] == half[2] / 2 and 25 * short[0] < ten[0] and 6 * short[0] < half[0]


# --- bins and tiles ---------------------------------------------------------------------------------------------------


def test_each_octave_has_equal_bins_and_a_light_is_in_those_that_it_overlaps():
    count = lights.OCTAVES << lights.FEWER_LOG2
    edges = [lights.bin_edge(number) for number in range(count + 1)]
    for octave in range(lights.OCTAVES):
        four = edges[octave << lights.FEWER_LOG2 : ((octave + 1) << lights.FEWER_LOG2) + 1]
        assert four[-1] == 2 * four[0]
        assert [b - a for a, b in pairwise(four)] == [four[0] / (1 << lights.FEWER_LOG2)] * 4
    for number, (begin, end) in enumerate(pairwise(edges)):
        assert lights.bin_of(begin) == lights.bin_of(math.nextafter(end, 0) - 1e-6) == number
        expected = [
            place
            for place, light in enumerate(lights.SIDE_LIGHTS)
            if light.ahead + light.radius >= begin and light.ahead - light.radius < end
        ]
        first = [0] if number == 0 else []  # what is nearer than the first bin is in it
        assert {*lights.lights_of_bin(number)} == {*expected, *first}
    assert [one.ahead for one in lights.SIDE_LIGHTS] == sorted(one.ahead for one in lights.SIDE_LIGHTS)


def test_the_marked_bin_has_fewer_lights_than_the_range_of_its_two_places():
    inside = lights.lights_of_bin(lights.MARKED)
    assert len(inside) < inside[-1] - inside[0] + 1
    said = words_of(lights.bins())
    assert f"first {inside[0]}, last {inside[-1]}: {inside[-1] - inside[0] + 1} lights" in said
    assert f"{len(inside)} of them" in said and f"takes {9 + STEPS_LOG2}" in said
    assert BINS == CHAPTER_OCTAVES * 64, "as the figure says"


def test_every_tile_that_shows_a_point_of_a_light_meets_its_cone():
    random = np.random.default_rng(2)
    for light in lights.SPHERES:
        away = random.normal(size=(4000, 3))
        away *= light.radius / np.linalg.norm(away, axis=1, keepdims=True)
        points = np.array([light.x, light.y, light.ahead]) + away
        seen = {(math.floor(x), math.floor(y)) for x, y in map(lights.seen_at, points)}
        inside = {(x, y) for x, y in seen if 0 <= x < lights.ACROSS and 0 <= y < lights.DOWN}
        assert inside and all(lights.meets(light, *tile) for tile in inside)
        x0, y0, x1, y1 = lights.rectangle_of(light)
        assert all(x0 <= x < x1 and y0 <= y < y1 for x, y in inside)


def test_the_cone_of_the_chosen_light_meets_fewer_tiles_than_its_rectangle_has():
    x0, y0, x1, y1 = lights.rectangle_of(lights.SPHERES[lights.CHOSEN])
    meeting = [
        (x, y)
        for x in range(lights.ACROSS)
        for y in range(lights.DOWN)
        if lights.meets(lights.SPHERES[lights.CHOSEN], x, y)
    ]
    assert all(x0 <= x < x1 and y0 <= y < y1 for x, y in meeting)
    assert lights.PIXEL in meeting and len(meeting) < (x1 - x0) * (y1 - y0)
    assert f"reaches {len(meeting)} tiles" in words_of(lights.tiles())


def test_both_sets_of_bits_keep_the_lights_that_reach_the_pixel_and_drop_others():
    in_bin, in_tile = lights.bits_of_pixel()
    direction = lights.through(lights.PIXEL[0] + 0.5, lights.PIXEL[1] + 0.5)
    place = direction * lights.PIXEL_AHEAD / direction[2]
    reaching = [np.linalg.norm(place - (one.x, one.y, one.ahead)) <= one.radius for one in lights.SPHERES]
    both = in_bin & in_tile
    assert not (np.array(reaching) & ~both).any()
    assert 0 < both.sum() < min(in_bin.sum(), in_tile.sum())


# --- occlusion --------------------------------------------------------------------------------------------------------


def test_a_ray_is_hidden_if_one_of_its_points_is_inside_of_a_wall():
    (left, low), (right, high) = occlusion.LEFT_WALL, occlusion.RIGHT_WALL
    count = 0
    for points, hidden in occlusion.rays():
        inside = [(x < left and 0 < y < low) or (x > right and 0 < y < high) for x, y in points]
        assert inside == [False] * (len(points) - 1) + [hidden] and len(points) <= occlusion.STEPS
        assert hidden or len(points) == occlusion.STEPS
        # In steps of length^(2/3) they are evenly spaced, so they are closer together near the pixel.
        even = np.hypot(*np.array(points).T) ** (2 / 3) * occlusion.STEPS
        np.testing.assert_allclose(np.diff(even), 1.0, atol=1e-9)
        assert 0 < even[0] < 1
        count += hidden
    assert 0 < count < occlusion.RAYS and f"visible is 1 - {count}/8" in words_of(occlusion.rays_over_depth())
    assert not occlusion.hides(1.5, (0.3, 2.0)), "what is farther in front than the radius stands apart"


def test_the_curve_of_the_estimate_is_that_of_the_twin():
    values = [occlusion.estimate(k) for k in range(9)]
    expected = [float(visibility(np.r_[np.ones(k), np.zeros(8 - k)])) for k in range(9)]
    assert values == pytest.approx(expected, abs=1e-12)
    assert values[2] == 1 > values[3] and values[8] == pytest.approx(0.45, abs=1e-4)


# --- exposure ---------------------------------------------------------------------------------------------------------


def test_the_average_is_of_the_pixels_between_the_percentiles():
    """1,296 pixels: the first 648 are left out, and of number 1,231 a fifth counts."""
    nits = exposure.picture()
    values = np.sort(np.log2(nits.ravel()))
    assert np.isfinite(values).all() and values.size == 1296
    expected = (values[648:1231].sum() + 0.2 * values[1231]) / 583.2
    mean = exposure.log_average(nits, exposure.LOW, exposure.HIGH)
    assert mean == pytest.approx(expected, abs=1e-9)
    factor = exposure.KEY / 2**mean
    assert np.exp2(np.mean(np.log2(np.full(3, 2**mean) * factor))) == pytest.approx(exposure.KEY)
    said = words_of(exposure.histogram())
    assert f"average {mean:.2f}" in said and f"as EV100: {-math.log2(1.2 * factor):.2f}" in said


def test_the_lamp_of_the_picture_does_not_change_its_exposure():
    nits = exposure.picture()
    brighter = np.where(nits == nits.max(), 1e7, nits)
    assert nits.max() > np.quantile(nits, exposure.HIGH)
    assert (nits != brighter).sum() < 0.05 * nits.size
    limits = exposure.LOW, exposure.HIGH
    assert exposure.log_average(brighter, *limits) == exposure.log_average(nits, *limits)
    assert exposure.log_average(brighter, 0, 1) > exposure.log_average(nits, 0, 1)


# --- layers -----------------------------------------------------------------------------------------------------------


def test_each_layer_has_a_place_in_the_list_of_its_pixel():
    counts, begins, ends, places = layers.lists()
    assert sorted(places) == list(range(len(layers.ARRIVED))) and sum(counts) == len(places)
    assert begins == [0, *np.cumsum(counts)[:-1].tolist()]
    assert ends == np.cumsum(counts).tolist(), "after the fill a word is the beginning of the next pixel"
    for pixel in range(layers.PIXELS):
        own = places[begins[pixel] : ends[pixel]]
        assert [number for number, one in enumerate(layers.ARRIVED) if one[0] == pixel] == own


def test_the_pixel_is_composited_farthest_first_and_its_order_of_arrival_would_be_wrong():
    def over(order):
        color = np.array(layers.UNDER)
        for number in order:
            *_, layer, opacity = layers.ARRIVED[number]
            color = opacity * np.array(layer) + (1 - opacity) * color
        return color

    shown = [number for number, _ in layers.composited()]
    depths = [layers.ARRIVED[number][2] for number in shown]
    assert depths == sorted(depths) and len(shown) >= 3
    np.testing.assert_allclose(layers.composited()[-1][1], over(shown))
    assert np.abs(over(sorted(shown)) - over(shown)).max() > 0.05


def test_the_film_of_the_lists_ends_with_the_lists_of_the_figure():
    film = fill.moments()
    counts, begins, ends, places = layers.lists()
    assert film[-1].words == tuple(ends) and film[-1].pool == tuple(places)
    assert tuple(counts) in {moment.words for moment in film if moment.step.startswith("1.")}
    assert tuple(begins) in {moment.words for moment in film if moment.step.startswith("2.")}
    assert list(film[-1].done) == [number for number, _ in layers.composited()]
    for before, after in pairwise(film):
        assert sum(a != b for a, b in zip(before.pool, after.pool, strict=True)) <= 1
        assert all(a in (fill.FREE, b) for a, b in zip(before.pool, after.pool, strict=True))


# --- the walk ---------------------------------------------------------------------------------------------------------


def test_the_walk_finds_the_lights_of_both_in_order_and_reads_no_other_words():
    in_bin, in_tile = walk.walk_bits()
    expected = [light for light in range(walk.STREET_LIGHTS) if in_bin[light] and in_tile[light]]
    film = walk.steps()
    assert list(film[-1].found) == expected and len({light // walk.WORD for light in expected}) >= 2
    places = np.flatnonzero(in_bin)
    read = {step.word for step in film}
    assert read == {*range(places[0] // walk.WORD, places[-1] // walk.WORD + 1)}
    assert len(read) < walk.STREET_LIGHTS // walk.WORD, "a word that the bin leaves out is seen"
    for before, after in pairwise(film):
        assert after.found[: len(before.found)] == before.found and after.word >= before.word
        assert len(after.found) - len(before.found) <= 1
    for step in film:
        assert step.bit is None or step.word * walk.WORD + step.bit == step.found[-1]


def test_the_walk_drops_no_light_that_reaches_its_pixel():
    direction = lights.through(walk.WALK_TILE[0] + 0.5, walk.WALK_TILE[1] + 0.5)
    place = direction * walk.WALK_AHEAD / direction[2]
    reaching = [
        number
        for number, one in enumerate(walk.street())
        if np.linalg.norm(place - (one.x, one.y, one.ahead)) <= one.radius
    ]
    assert reaching and {*reaching} <= {*walk.steps()[-1].found}


# --- the same as the shaders ------------------------------------------------------------------------------------------


def test_the_code_of_the_figure_is_that_of_the_shader(vulkan_device):
    n = np.random.default_rng(3).normal(size=(4096, 3))
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    got = evaluate(
        vulkan_device,
        ["octahedral.glsl"],
        "code = octahedral_from_unit(n); back = unit_from_octahedral(code);",
        {"n": n},
        {"code": "vec2", "back": "vec3"},
    )
    code = normals.octahedral(n.astype(np.float64))
    np.testing.assert_allclose(got["code"], code, atol=1e-6)
    np.testing.assert_allclose(got["back"], normals.direction(code), atol=1e-6)


def test_the_rays_and_the_curve_of_the_figure_are_those_of_the_shader(vulkan_device):
    random = np.random.default_rng(4)
    behind, x, above = random.uniform(-1.5, 1.5, (3, 4096)).astype(np.float32)
    above[::3] *= 0.1  # near the plane of the ray's origin
    shader = ["ambient_occlusion.glsl"]
    body = "found = hides(behind, vec3(x, 0.0, above), vec3(0.0, 0.0, 1.0)) ? 1u : 0u;"
    inputs = {"behind": behind, "x": x, "above": above}
    got = evaluate(vulkan_device, shader, body, inputs, {"found": "uint"})["found"]
    cases = zip(behind.tolist(), x.tolist(), above.tolist(), strict=True)
    expected = [occlusion.hides(one, (across, up)) for one, across, up in cases]
    assert got.astype(bool).tolist() == expected and 0 < sum(expected) < len(expected)
    body = "found = visibility_of_sum(8.0 - k + k * sample_visibility(1.0));"
    k = np.arange(9, dtype=np.float32)
    curve = evaluate(vulkan_device, shader, body, {"k": k}, {"found": "float"})["found"]
    np.testing.assert_allclose(curve, [occlusion.estimate(one) for one in range(9)], atol=1e-6)
