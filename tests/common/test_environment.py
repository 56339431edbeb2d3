"""Environments from files: what is read, what is put right, and what is refused with a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from common.environment import Environment, clean, constant, environment, read_environment
from common.environment.directions import panorama_directions, panorama_solid_angles
from common.errors import UserError
from common.images import image_size, write_image
from common.paths import asset_dir
from common.view.camera import fitting_ev100

EXR = pytest.param(".exr", marks=pytest.mark.needs("OpenEXR"))


def panorama(height=4):
    """Return random radiance (height, 2 * height, 3)."""
    return np.random.default_rng(1).random((height, 2 * height, 3)).astype(np.float32)


@pytest.mark.parametrize("suffix", [".hdr", EXR])
def test_a_file_is_read_as_it_was_written(tmp_path, suffix):
    write_image(tmp_path / f"garden{suffix}", panorama())
    got = read_environment(tmp_path / f"garden{suffix}")
    assert got.name == "garden"
    assert got.warnings == ()
    assert np.allclose(got.radiance, panorama(), atol=0 if suffix == ".exr" else 2**-8)


def test_a_real_file():
    if asset_dir() is None:
        pytest.skip("the environments made elsewhere are not here (STRATA_ASSETS)")
    got = read_environment(asset_dir() / "environments" / "chinese_garden_1k.hdr")
    assert got.radiance.shape == (512, 1024, 3)
    # The mean over the sphere against one by many random directions: no solid angle is involved.
    d = np.random.default_rng(4).normal(size=(200_000, 3))
    v = np.arctan2(np.hypot(d[:, 0], d[:, 2]), d[:, 1]) / np.pi
    u = 0.5 + np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi)
    seen = got.radiance[(v * 512).astype(int), np.minimum((u * 1024).astype(int), 1023)]
    error = seen.std(axis=0) / np.sqrt(len(seen))
    assert (np.abs(seen.mean(axis=0) - got.mean) < 4 * error).all()


def test_the_mean_weighs_rows_by_solid_angle():
    up = np.repeat(np.maximum(panorama_directions(64)[..., 1:2], 0), 3, axis=2).astype(np.float32)
    assert np.allclose(
        Environment("cosine", up).mean, 0.25, rtol=1e-3
    )  # the mean of max(cos, 0) over the sphere
    assert np.allclose(constant((1, 2, 3)).mean, (1, 2, 3))
    assert np.isclose(panorama_solid_angles(5).sum() * 10, 4 * np.pi)


def test_content_is_that_of_the_pixels():
    one, other = Environment("a", panorama()), Environment("b", panorama())
    assert one.content == other.content
    changed = panorama()
    changed[0, 0, 0] += 1e-6
    assert Environment("a", changed).content != one.content
    assert constant(1.0, 2).content != constant(1.0, 4).content


@pytest.mark.needs("OpenEXR")
def test_texels_that_are_no_light_are_put_right_and_counted(tmp_path):
    pixels = panorama()
    pixels[0, 0, 1], pixels[1, 2, 0], pixels[1, 3], pixels[3, 7, 2] = np.nan, np.inf, -1.0, np.inf
    write_image(tmp_path / "bad.exr", pixels)
    got = read_environment(tmp_path / "bad.exr")
    largest = pixels[np.isfinite(pixels)].max()
    assert got.radiance[0, 0, 1] == 0
    assert (got.radiance[1, 3] == 0).all()
    assert got.radiance[1, 2, 0] == got.radiance[3, 7, 2] == largest
    untouched = np.isfinite(pixels) & (pixels >= 0)
    assert np.array_equal(got.radiance[untouched], pixels[untouched])
    assert [warning.split(": ")[1].split()[0] for warning in got.warnings] == ["2", "2"]


def test_doubles_beyond_float32_are_as_bright_as_the_brightest_other_one():
    with np.errstate(over="ignore"):
        values, warnings = clean(np.array([[[1.0, 2.0, 1e60]]]))
    assert values.tolist() == [[[1.0, 2.0, 2.0]]]
    assert len(warnings) == 1


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ((1, 1), "1 x 1 pixels"),
        ((4, 4), "twice as wide"),
        ((1, 2), "2 x 1 pixels, fewer than the 4 x 2"),
        ((2, 8194), "wider than the 8192"),
    ],
)
@pytest.mark.parametrize("suffix", [".hdr", EXR])
def test_what_is_no_panorama_is_refused(tmp_path, shape, says, suffix):
    write_image(tmp_path / f"p{suffix}", np.ones((*shape, 3), np.float32))
    with pytest.raises(UserError, match=says):
        read_environment(tmp_path / f"p{suffix}")


def test_a_size_beyond_all_is_said_in_full(tmp_path):
    (tmp_path / "huge.hdr").write_bytes(b"#?RADIANCE\n\n-Y 4294967296 +X 8589934592\n")
    with pytest.raises(UserError, match="8589934592 x 4294967296 pixels"):
        read_environment(tmp_path / "huge.hdr")
    (tmp_path / "digits.hdr").write_bytes(b"#?RADIANCE\n\n-Y 1 +X " + b"9" * 4000 + b"\n")
    with pytest.raises(UserError, match="resolution line"):
        read_environment(tmp_path / "digits.hdr")


def test_a_panorama_of_16k_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    (tmp_path / "large.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 16384\n")
    monkeypatch.setattr(environment, "read_image", None)
    with pytest.raises(UserError, match=r"16384 x 8192 pixels.*scale it down"):
        read_environment(tmp_path / "large.hdr")


@pytest.mark.parametrize("suffix", [".hdr", EXR])
def test_files_that_are_cut_off_or_empty_are_refused(tmp_path, suffix):
    path = tmp_path / f"cut{suffix}"
    write_image(path, panorama(16))
    whole = path.read_bytes()
    for length in (len(whole) - 30, 40, 3, 0):
        path.write_bytes(whole[:length])
        with pytest.raises(UserError, match="cannot be read"):
            read_environment(path)


@pytest.mark.needs("OpenEXR")
def test_files_without_light_or_of_other_kinds_are_refused(tmp_path):
    write_image(tmp_path / "nan.exr", np.full((2, 4, 3), np.nan, np.float32))
    for name, says in (("nan.exr", "no texel"), ("none.hdr", "no file"), ("sky.png", "name a panorama")):
        with pytest.raises(UserError, match=says):
            read_environment(tmp_path / name)


def test_a_black_picture_is_refused(tmp_path):
    write_image(tmp_path / "black.hdr", np.zeros((2, 4, 3), np.float32))
    with pytest.raises(UserError, match=r"black\.hdr sends no light"):
        read_environment(tmp_path / "black.hdr")


@pytest.mark.needs("OpenEXR")
def test_texels_beyond_every_exposure_are_made_as_bright_as_any_fits(tmp_path):
    pixels = panorama()
    pixels[1, 2] = pixels[3, 3] = 3e38
    write_image(tmp_path / "bright.exr", pixels)
    got = read_environment(tmp_path / "bright.exr")
    assert got.radiance[1, 2, 0] == got.radiance.max() == np.float32(environment.BRIGHTEST)
    assert np.array_equal(got.radiance[0], pixels[0])
    (warning,) = got.warnings
    assert "2 texels are brighter than 1e+17 nits" in warning
    assert fitting_ev100(environment.BRIGHTEST) < 60  # what --ev takes
    with pytest.raises(ValueError, match="above"):
        constant(3e38)


@pytest.mark.needs("OpenEXR")
def test_grey_pictures_are_read_as_white_light(tmp_path):
    write_image(tmp_path / "grey.exr", panorama()[..., :1])
    assert np.array_equal(
        read_environment(tmp_path / "grey.exr").radiance, panorama()[..., :1].repeat(3, axis=2)
    )


@pytest.mark.parametrize("orientation", ["-Y 3 +X 6", "+X 6 -Y 3"])
def test_sizes_from_headers(tmp_path, orientation):
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\n\n" + orientation.encode() + b"\n")
    assert image_size(path) == (6, 3)
    write_image(tmp_path / "b.png", np.zeros((3, 5, 3), np.uint8))
    assert image_size(tmp_path / "b.png") == (5, 3)


def test_arrays_that_are_no_panorama():
    bad = panorama()
    bad[0, 0, 0] = np.nan
    for pixels in (panorama()[..., :2], panorama()[:, :4], panorama().astype(np.float64), bad, -panorama()):
        with pytest.raises(ValueError):
            Environment("wrong", pixels)
