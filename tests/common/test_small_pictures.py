"""Pictures for the repository: without loss where they fit, else with a palette, and never above the limit."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from common.errors import UserError
from common.images import read_image
from common.images.small_pictures import encode_small, write_small

NOISE = np.random.default_rng(1).integers(0, 256, (64, 96, 3), dtype=np.uint8)
"""Nothing compresses it: three bytes a pixel."""


def decoded(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def test_what_fits_keeps_every_bit() -> None:
    data = encode_small(NOISE, most=20_000)
    assert data is not None
    np.testing.assert_array_equal(decoded(data), NOISE)


@pytest.mark.parametrize("most", [9_000, 6_500, 5_500])
def test_what_does_not_fit_gets_a_palette(most: int) -> None:
    data = encode_small(NOISE, most)
    assert data is not None and len(data) <= most
    assert len(np.unique(decoded(data).reshape(-1, 3), axis=0)) <= 256


def test_a_small_thing_of_a_colour_of_its_own_keeps_it() -> None:
    picture = NOISE // 4
    picture[20:26, 30:36] = (250, 140, 0)
    data = encode_small(picture, most=10_000)
    assert data is not None
    seen = decoded(data)[20:26, 30:36].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(seen, (250, 140, 0), atol=25)


def test_a_gradient_keeps_its_mean_and_has_no_steps() -> None:
    ramp = np.linspace(0, 255, 256)[None, :, None].repeat(128, 0).repeat(3, 2)
    picture = np.clip(ramp + np.random.default_rng(2).normal(0, 6, ramp.shape), 0, 255).astype(np.uint8)
    data = encode_small(picture, most=40_000)
    assert data is not None
    columns = decoded(data).astype(float).mean(axis=(0, 2))
    assert np.abs(columns - picture.astype(float).mean(axis=(0, 2))).max() < 4


def test_what_is_too_large_is_refused_with_its_size(tmp_path) -> None:
    with pytest.raises(UserError, match="96x64"):
        write_small(tmp_path / "a.png", NOISE, most=100)
    assert not (tmp_path / "a.png").exists()
    write_small(tmp_path / "a.png", NOISE)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), NOISE)
