"""Radiance files against a reader that follows the format byte by byte, and against files written by hand."""

from __future__ import annotations

import numpy as np
import pytest

from common.images.radiance import decode_radiance, encode_radiance, float_to_rgbe, rgbe_to_float
from common.paths import asset_dir

RNG = np.random.default_rng(1)
HEADER = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"


def naive(data):
    """Pixels (H, W, 4) bytes of a file with runs per component, one byte after the other."""
    head, _, rest = data.partition(b"\n\n")
    line, _, body = rest.partition(b"\n")
    assert head.startswith(b"#?")
    height, width = int(line.split()[1]), int(line.split()[3])
    pixels, at = np.zeros((height, width, 4), np.uint8), 0
    for y in range(height):
        assert tuple(body[at : at + 4]) == (2, 2, width >> 8, width & 255)
        at += 4
        for c in range(4):
            x = 0
            while x < width:
                n = body[at]
                if n > 128:
                    pixels[y, x : x + n - 128, c] = body[at + 1]
                    x, at = x + n - 128, at + 2
                else:
                    pixels[y, x : x + n, c] = list(body[at + 1 : at + 1 + n])
                    x, at = x + n, at + 1 + n
    return pixels


def picture(height, width):
    image = RNG.random((height, width, 3)) * 10.0 ** RNG.uniform(-4, 4, (height, width, 1))
    image[::2, : width // 2] = image[0, 0]  # runs of equal pixels, some longer than 127
    return image


@pytest.mark.feature("images/io")
@pytest.mark.parametrize("size", [(5, 400), (3, 7), (1, 1), (2, 8), (40, 131)])
def test_round_trip_error_is_below_2_to_the_minus_8_of_the_largest_channel(size):
    image = picture(*size)
    image[0, 0, 1] = 1234.5
    back = decode_radiance(encode_radiance(image))
    assert back.shape == image.shape and back.dtype == np.float32
    assert (np.abs(back - image) <= 2**-8 * image.max(axis=-1, keepdims=True)).all()
    assert back[0, 0, 1] > 1


def test_every_largest_mantissa_keeps_the_bound():
    """Rounding carries to the next exponent near powers of two."""
    top = np.concatenate([np.linspace(0.5, 1.0, 5001), np.nextafter([0.5, 1.0, 2.0], 0)])
    image = np.stack([top, top * 0.37, top * 0.001], axis=-1)
    back = rgbe_to_float(float_to_rgbe(image))
    assert (np.abs(back - image).max(axis=-1) <= 2**-8 * top).all()


def test_values_out_of_range():
    image = np.array([[np.nan, -1, 0.5], [np.inf, 1, 1], [0, 0, 0], [1e-45, 0, 0], [1e300, 0, 0]])
    back = rgbe_to_float(float_to_rgbe(image))
    assert np.isfinite(back).all() and (back >= 0).all()
    assert np.allclose(back[0], (0, 0, 0.5)) and back[1, 0] == back[4, 0] == np.float32(255 * 2.0**119)
    assert (back[2] == 0).all() and (back[3] == 0).all()


def test_runs_per_component_equal_the_naive_reader():
    data = encode_radiance(picture(20, 600))
    assert len(data) < 20 * 600 * 4  # runs were used
    assert np.array_equal(decode_radiance(data), rgbe_to_float(naive(data)))


def test_the_panorama_of_the_assets():
    folder = asset_dir()
    if folder is None:
        pytest.skip("no folder of assets made elsewhere (STRATA_ASSETS)")
    data = (folder / "environments" / "chinese_garden_1k.hdr").read_bytes()
    image = decode_radiance(data)
    assert image.shape == (512, 1024, 3) and np.isfinite(image).all() and image.max() > 100
    assert np.array_equal(image, rgbe_to_float(naive(data)))
    assert np.array_equal(
        decode_radiance(encode_radiance(image)), image
    )  # its values are on the format's grid


def test_flat_and_old_runs_written_by_hand():
    pixel, other = bytes((128, 64, 32, 129)), bytes((200, 0, 0, 128))
    flat = HEADER + b"-Y 1 +X 3\n" + pixel + other + pixel
    assert np.allclose(decode_radiance(flat)[0], [(1, 0.5, 0.25), (200 / 256, 0, 0), (1, 0.5, 0.25)])
    runs = HEADER + b"-Y 2 +X 3\n" + pixel + bytes((1, 1, 1, 3)) + other + bytes((1, 1, 1, 1))
    assert np.allclose(decode_radiance(runs)[..., 0], [[1, 1, 1], [1, 200 / 256, 200 / 256]])
    long = HEADER + b"-Y 1 +X 300\n" + other + bytes((1, 1, 1, 42)) + bytes((1, 1, 1, 1)) + pixel
    row = decode_radiance(long)[0, :, 0]  # 42 + 1 * 256 repeats
    assert (row[:299] == 200 / 256).all() and row[299] == 1


def test_eight_orientations():
    image = picture(2, 3)
    pixels = float_to_rgbe(image)
    expected = rgbe_to_float(pixels)
    for vertical in b"-+":
        for horizontal in b"+-":
            turned = pixels[:: 1 if vertical == ord("-") else -1, :: 1 if horizontal == ord("+") else -1]
            by_rows = b"%cY 2 %cX 3\n" % (vertical, horizontal) + turned.tobytes()
            by_columns = b"%cX 3 %cY 2\n" % (horizontal, vertical) + turned.transpose(1, 0, 2).tobytes()
            for body in (by_rows, by_columns):
                assert np.array_equal(decode_radiance(HEADER + body), expected)


def test_exposure_is_divided_out():
    data = b"#?RGBE\r\nEXPOSURE=2\r\nEXPOSURE= 4.0\r\n\r\n-Y 1 +X 1\r\n" + bytes((128, 128, 128, 129))
    assert np.allclose(decode_radiance(data), 1 / 8)


def test_exposures_beyond_reason_are_refused_and_large_light_ends_at_the_largest_float():
    pixel = b"\n-Y 1 +X 1\n" + bytes((128, 128, 128, 200))
    for lines, product in ((b"1e-300", "1e-300"), (b"1e20\nEXPOSURE=1e20", r"1e\+40")):
        with pytest.raises(ValueError, match=f"its exposure of {product} is not between"):
            decode_radiance(b"#?RGBE\nEXPOSURE=" + lines + b"\n" + pixel)
    assert (decode_radiance(b"#?RGBE\nEXPOSURE=1e-29\n" + pixel) == np.finfo(np.float32).max).all()


GOOD = encode_radiance(np.ones((4, 10, 3)))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "does not begin"),
        (b"#?RADIANCE\n", "header has no end"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234", "32-bit_rle_xyze' is not"),
        (b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n1234", "exposure '0' is not"),
        (b"#?RADIANCE\nEXPOSURE=x\n\n-Y 1 +X 1\n1234", "exposure 'x' is not"),
        (HEADER + b"-Y 1 -Y 1\n1234", "resolution line"),
        (HEADER + b"large\n1234", "resolution line"),
        (HEADER + b"-Y 0 +X 1\n1234", "1 x 0 pixels"),
        (HEADER + b"-Y 99999999999 +X 99999999999\n1234", "pixels"),
        (HEADER + b"-Y 2 +X 2\n12341234", "ends in line 1 of 2"),
        (HEADER + b"-Y 1 +X 2\n" + bytes((1, 1, 1, 1)) * 2, "repeat of nothing"),
        (HEADER + b"-Y 1 +X 7\n1234" + bytes((1, 1, 1, 0)) * 5, "more than"),
        (GOOD[:-3], "ends in line 3 of 4"),
        (GOOD[: GOOD.index(bytes((2, 2, 0, 10))) + 5], "ends in line 0 of 4"),
        (GOOD.replace(bytes((2, 2, 0, 10, 138)), bytes((2, 2, 0, 10, 139))), "beyond its end"),
        (GOOD.replace(bytes((2, 2, 0, 10, 138)), bytes((2, 2, 0, 10, 0))), "run of no bytes"),
        (
            GOOD[: len(HEADER) + 10]
            + GOOD[len(HEADER) + 10 :].replace(bytes((2, 2, 0, 10)), bytes((2, 2, 0, 11))),
            "line 0",
        ),
    ],
)
def test_broken_files_say_what_is_wrong(data, reason):
    with pytest.raises(ValueError) as error:
        decode_radiance(data)
    assert reason in str(error.value)


def test_a_huge_run_is_cut_before_it_is_made():
    data = HEADER + b"-Y 1 +X 4\n1234" + bytes((1, 1, 1, 255)) * 4
    assert decode_radiance(data).shape == (1, 4, 3)


def test_random_damage_never_crashes():
    good, rng = encode_radiance(picture(6, 40)), np.random.default_rng(9)
    for _ in range(400):
        data = bytearray(good)
        for place in rng.integers(0, len(data), 3):
            data[place] = rng.integers(0, 256)
        try:
            decode_radiance(bytes(data[: rng.integers(1, len(data) + 1)]))
        except ValueError:
            continue
