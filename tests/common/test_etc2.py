"""ETC2 blocks: the decoder against that of other authors in every mode, and what the encoder makes of pictures."""

from __future__ import annotations

import numpy as np
import pytest

from common.images.blocks import encode
from common.images.etc2 import DIFFERENTIAL, PLANAR, H, T, decode, modes
from tests.support.block_pictures import decoded, pictures, random_blocks


@pytest.mark.needs("texture2ddecoder")
def test_every_mode_is_decoded_as_by_other_authors():
    """Random bits are legal blocks, and hold every mode: 16384 of them."""
    rows = random_blocks("etc2", 512, 512, 1)
    assert np.bincount(modes(rows).ravel(), minlength=5).min() > 300
    assert np.array_equal(decode(rows, 512, 512), decoded(rows, "etc2", 512, 512))


def test_edges_are_cut_off():
    rows = random_blocks("etc2", 13, 6, 2)
    assert np.array_equal(decode(rows, 13, 6), decode(rows, 16, 8)[:6, :13])


@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.needs("etcpak")
def test_a_constant_picture_decodes_within_the_step_of_the_format():
    """The coarsest channels of a plane have 6 bits: half a step of 255/63 codes, and alpha is none of it."""
    colors = np.random.default_rng(3).integers(0, 256, (200, 3), np.uint8)
    colors = np.concatenate([colors, [[0, 0, 0], [255, 255, 255], [255, 0, 128]]]).astype(np.uint8)
    every = np.arange(256, dtype=np.uint8)
    ramps = np.stack([every, every, every], -1), np.stack([every, every[::-1], every], -1)
    for color in np.concatenate([colors, *ramps]):
        picture = np.full((8, 8, 4), 255, np.uint8)
        picture[..., :3] = color
        rows = encode(picture, "etc2")
        assert rows.size == 8 * 2 * 2
        found = decode(rows, 8, 8).astype(int)
        assert (modes(rows) == PLANAR).all() and (found == found[0, 0]).all(), "one colour"
        assert np.abs(found - picture).max() <= 2, color


@pytest.mark.needs("etcpak")
def test_the_encoder_uses_what_etc2_adds_to_etc1():
    smooth, noise = (pictures(64, 64)[name] for name in ("smooth", "noise"))
    assert (modes(encode(smooth, "etc2")) == PLANAR).mean() > 0.3
    assert {DIFFERENTIAL, T, H} & set(modes(encode(noise, "etc2")).ravel().tolist())


def test_other_bytes_are_refused():
    with pytest.raises(ValueError, match=r"5x4 texels are \(1, 16\) uint8, not \(1, 8\) uint8"):
        decode(np.zeros((1, 8), np.uint8), 5, 4)
