"""Pictures of what passes write, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from common.images import palette
from common.images.color import encode_srgb
from common.images.frame_pictures import distance, picture_of
from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View

POSE = pose_looking_at((0, 0, 0), (0, 0, -1))
FAR_SEEING = View(POSE, Perspective(1.0, 0.25))
FLAT = View(POSE, Orthographic(1.0, 0.5, 10.5))


def test_reversed_depth_becomes_distance_and_distance_grey():
    """Depth is near / z with near 0.25 m: 1, 1/2, 1/8 are 0.25, 0.5 and 2 m, of which 0.5 is a third of the way."""
    depth = np.float32([[1.0, 0.5, 0.125, 0.0]])
    assert np.allclose(distance(depth, FAR_SEEING)[0, :3], (0.25, 0.5, 2.0))
    shown, mapping = picture_of(depth, "depth", "d32f", FAR_SEEING)
    assert np.abs(shown[0, :, 0] - 255 * np.array([1.0, 0.7, 0.1, 0.0])).max() <= 0.51
    assert mapping == "distance from white at 0.25 m to dark at 2 m"
    assert np.allclose(distance(np.float32([[1.0, 0.5, 0.0]]), FLAT), (0.5, 5.5, 10.5))


def test_nothing_drawn_is_black():
    shown, mapping = picture_of(np.zeros((2, 3), np.float32), "depth_msaa", "d32f", FAR_SEEING)
    assert not shown.any() and "nothing drawn" in mapping


def test_ids_keep_their_hue_whatever_else_is_there():
    one, _ = picture_of(np.uint32([[0, 7, 9]]), "instance_id", "r32ui", FLAT)
    other, mapping = picture_of(np.uint32([[9, 1, 7]]), "instance_id", "r32ui", FLAT)
    assert not one[0, 0].any()
    assert np.array_equal(one[0, 1], other[0, 2]) and np.array_equal(one[0, 2], other[0, 0])
    assert np.abs(one[0, 1] - 255 * palette.id_color(7)).max() <= 0.5
    assert mapping.startswith("a hue for each id; 3 of them")


def test_ids_of_two_words_are_told_apart_by_both():
    words = np.uint32([[(0, 5), (1, 5), (1, 6), (2, 5), (1, 5)]])
    shown, mapping = picture_of(words, "visibility", "rg32ui", FLAT)
    assert not shown[0, 0].any() and (shown[0, 1] == shown[0, 4]).all()
    assert len({tuple(color) for color in shown[0].tolist()}) == 4 and "3 of them" in mapping


def test_octahedral_normals_are_directions():
    """A code of two 16-bit numbers: straight up (0, 0), along +x (32767, 0), straight down (32767, 32767)."""
    words = np.uint32([[0, 0x00007FFF, 0x7FFF7FFF]])
    shown, _ = picture_of(words, "gbuffer_normal", "r32ui", FLAT)
    wanted, _ = picture_of(np.float32([[(0, 0, 1), (1, 0, 0), (0, 0, -1)]]), "normal", "rgba16f", FLAT)
    assert np.abs(shown.astype(int) - wanted).max() <= 1


def test_light_is_cut_at_white_and_said_to_be():
    light = np.float16([[(0.0, 0.25, 1.0, 1.0), (3.0, 0.5, 0.0, 1.0)]])
    shown, mapping = picture_of(light, "color_hdr", "rgba16f", FLAT)
    assert np.abs(shown - 255 * encode_srgb([(0.0, 0.25, 1.0), (1.0, 0.5, 0.0)])).max() <= 0.5
    assert "50.0% is brighter, at most 3" in mapping


def test_directions_and_motion_lie_around_grey():
    shown, _ = picture_of(np.float32([[(0, 0, 1), (-1, 1, 0)]]), "normal", "rgba16f", FLAT)
    assert shown[0].tolist() == [[128, 128, 255], [0, 255, 128]]
    shown, mapping = picture_of(np.float32([[(0.0, 0.02), (-0.01, 0.0)]]), "motion", "rg16f", FLAT)
    assert shown[0].tolist() == [[128, 255, 128], [64, 128, 128]] and "at most 0.02" in mapping


def test_codes_stay_and_numbers_span_their_range():
    codes = np.uint8([[(1, 2, 3, 255)]])
    assert picture_of(codes, "color", "rgba8", FLAT)[0].tolist() == [[[1, 2, 3]]]
    shown, mapping = picture_of(np.float32([[-1.0, 0.0, 3.0]]), "occlusion", "r32f", FLAT)
    assert shown[0, :, 0].tolist() == [0, 64, 255] and mapping == "black -1, white 3"


def test_what_a_view_stored_is_shown_as_the_view_means_it():
    counts = np.float32([[(0, 0, 0, 1), (2, 2, 2, 1), (4, 4, 4, 1)]])
    assert picture_of(counts, "color_hdr", "rgba16f", FLAT, "count")[0][0].tolist() == [
        [0, 0, 0],
        [0, 255, 0],
        [255, 255, 255],
    ]
    assert picture_of(counts / 8, "color_hdr", "rgba16f", FLAT, "value")[0][0, :, 0].tolist() == [0, 64, 128]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("name", "format", "shape"),
    [
        ("color_hdr", "rgba16f", (2, 2, 4)),
        ("normal", "rgba16f", (2, 2, 4)),
        ("motion", "rg16f", (2, 2, 2)),
        ("depth", "d32f", (2, 2)),
        ("occlusion", "r32f", (2, 2)),
    ],
)
def test_what_is_no_number_is_magenta(name, format, shape, bad):
    values = np.full(shape, 0.5, np.float32)
    values[0, 1] = bad
    shown, mapping = picture_of(values, name, format, FAR_SEEING)
    assert shown[0, 1].tolist() == [255, 0, 255]
    assert "1 pixels are NaN or infinite" in mapping
    assert (shown[1] != (255, 0, 255)).any(axis=-1).all()


def test_a_volume_is_a_sheet_of_its_slices():
    volume = np.zeros((5, 2, 3, 4), np.float32)
    volume[..., 0] = np.arange(5)[:, None, None] * 2.0
    shown, mapping = picture_of(volume, "fog_light", "rgba16f", FLAT)
    assert shown.shape == (4, 9, 3) and "5 slices in rows of 3, divided by 8" in mapping
    tiles = [shown[2 * (i // 3), 3 * (i % 3), 0] for i in range(6)]
    assert tiles[0] == tiles[5] == 0 and list(tiles[:5]) == sorted(tiles[:5]) and tiles[4] == 255
