"""The figures and the loop of chapter 8 are true: faces, bias, cascades, pages, texels by need, casters and movers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tools.site.figures.canvas import Canvas
from tools.site.figures.ch08 import bias, cascades, casters, faces, movers, need, pages, snapping


def words_of(canvas: Canvas) -> str:
    return "\n".join(text for text, _ in canvas.texts)


def test_each_direction_is_seen_by_a_face_and_names_are_those_of_its_axes():
    lamp = faces.lamp_faces()
    directions = np.random.default_rng(1).normal(size=(500, 3))
    found = np.array([~np.isnan(faces.seen(face, directions)[:, 0]) for face in lamp])
    assert found.any(axis=0).all() and found.sum(axis=0).max() <= 3  # guards overlap
    for name, face in zip(faces.NAMES, lamp, strict=True):
        assert faces.direction_of(face["ahead"]) == name
        np.testing.assert_allclose(np.cross(face["right"], face["down"]), face["ahead"], atol=1e-6)


def test_half_of_a_slope_shades_itself_and_the_plane_needs_no_offset():
    assert bias.shaded(0.0) == pytest.approx(0.5, abs=1e-3)
    assert bias.shaded(0.0, radius=1, plane=True) == 0.0
    assert bias.shaded(bias.slope_bias(1), radius=1) == 0.0 < bias.shaded(0.9 * bias.deepest(1), radius=1)
    assert bias.slope_bias(1) > bias.deepest(1)
    across = bias.plane_bias() * math.cos(bias.TILT)
    assert across < math.hypot(bias.CONSTANT, bias.SLOPE) < bias.slope_bias(1) * math.cos(bias.TILT)


def test_squares_hold_their_slices_and_the_fit_touches_the_scene():
    made, ends, up = cascades.faces(), cascades.cuts(), math.tan(cascades.YFOV / 2)
    for number in range(cascades.CASCADES - 1):
        corners = np.array(
            [
                (x * up * cascades.ASPECT * end, cascades.EYE[1] + y * up * end, cascades.EYE[2] - end)
                for end in ends[number : number + 2]
                for x in (-1, 1)
                for y in (-1, 1)
            ]
        )
        at = np.abs((corners - made[number]["origin"]) @ cascades.axes().T)
        texel = 1 / float(made[number]["scale_x"])
        assert (at <= np.array(cascades.half_sizes(made[number])) + texel).all()
    at = (cascades.corners(cascades.BOX) - made[-1]["origin"]) @ cascades.axes().T
    np.testing.assert_allclose(np.abs(at).max(axis=0), cascades.half_sizes(made[-1]), rtol=1e-5)
    assert len(cascades.hull(at)) == 6
    assert cascades.texel_at(1.0) < cascades.texel_at(20.0) < 1 / float(made[-1]["scale_x"])


def test_only_whole_texels_keep_a_shadow_as_it_is():
    frames = range(snapping.FRAMES)
    assert {snapping.changed(number, True) for number in frames} == {0.0}
    assert min(snapping.changed(number, False) for number in frames) > 5


def test_tiles_of_the_figure_have_one_owner_and_lie_apart():
    found = [word for face in range(pages.CHOSEN + 1) for word in pages.words_of(face).values()]
    found.append(pages.coarse_word())
    assert len(found) == len({*found}) == pages.pool().used
    word = pages.words_of(pages.CHOSEN)
    assert (*word,) == pages.NEEDED and {*pages.tiles_of_kernel()} <= {*word}, "a kernel has all of its tiles"
    assert pages.tiles_of_kernel() == [5, 6, 9, 10]
    assert word[10] - word[6] not in (1, 1 << 8)
    written = words_of(pages.table_of_pages())
    for tile in range(pages.STRIDE):
        named = f"{word[tile] & 0xFF}, {word[tile] >> 8}" if tile in word else "none"
        assert f"{tile}: {named}" in written


def test_movers_over_what_is_kept_are_all_casters_together():
    frames = [movers.shown(place) for place in movers.PLACES]
    for place, found in zip(movers.PLACES, frames, strict=True):
        at = np.arange(movers.TEXELS) + 0.5
        crate = (at > 4) & (at < 11)
        wanted = np.where(crate, movers.CRATE, movers.GROUND)
        covered = np.abs(at - place) < movers.RADIUS
        assert (found[~covered] == wanted[~covered]).all() and (found[covered] < wanted[covered]).all()
    assert not np.array_equal(*frames)


def test_the_texels_of_a_cluster_are_those_of_the_formula():
    assert [round(need.asked(one)) for one in (2.0, 5.0)] == [101, 260]
    assert need.asked(0.5) == need.LARGEST
    distances = np.linspace(1.1, 19.0, 50)
    given = np.array(need.sizes(distances))
    wanted = np.array([need.asked(one) for one in distances])
    assert (given >= wanted).all() and (given[given > 128] < 2 * wanted[given > 128]).all()


def test_no_face_misses_a_caster_and_bits_are_those_of_samples():
    centre, extent = casters.boxes()
    random = np.random.default_rng(2)
    for number, word in enumerate(casters.bits()):
        points = centre[number] + extent[number] * random.uniform(-1, 1, (4000, 3))
        if not word:
            assert np.linalg.norm(points, axis=1).min() > casters.REACH
            continue
        seen = [bool((~np.isnan(faces.seen(face, points)[:, 0])).any()) for face in faces.lamp_faces()]
        assert word == "".join("1" if one else "0" for one in seen)
