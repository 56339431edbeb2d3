"""Block compression: sizes are the formats' own, quality stays above what was measured, and every edge is encoded."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from common.errors import UnsupportedError
from common.images import blocks
from common.images.blocks import (
    BLOCK_BYTES,
    FEATURE,
    PLAIN,
    encode,
    encode_chain,
    storage_of,
    stored_bytes,
    stored_shape,
)
from common.images.mips import mip_chain
from tests.support.block_pictures import decoded, exact_bc4, pictures, random_blocks

CHANNELS = {"bc4": [0], "bc5": [0, 1], "bc7": [0, 1, 2, 3], "etc2": [0, 1, 2]}

# Of 64x64 texels, in dB: half a decibel below what etcpak 0.9.15 was measured at.
BOUNDS = {
    "bc4": {"smooth": 41.5, "noise": 26.6, "normal": 47.9, "alpha": 41.5},
    "bc5": {"smooth": 42.9, "noise": 26.6, "normal": 44.8, "alpha": 42.9},
    "bc7": {"smooth": 41.2, "noise": 14.3, "normal": 42.7, "alpha": 39.9},
    "etc2": {"smooth": 35.7, "noise": 11.9, "normal": 36.8, "alpha": 35.7},
}


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((one.astype(np.float64) - other) ** 2)))


@pytest.mark.feature("textures/block-compression")
@pytest.mark.parametrize("format", BOUNDS)
@pytest.mark.needs("etcpak", "texture2ddecoder")
def test_the_error_stays_above_the_recorded_bound(format):
    for name, picture in pictures(64, 64).items():
        rows = encode(picture, format)
        found = psnr(decoded(rows, format, 64, 64)[..., CHANNELS[format]], picture[..., CHANNELS[format]])
        assert found > BOUNDS[format][name], (name, found)


@pytest.mark.feature("textures/block-compression")
@pytest.mark.needs("etcpak")
def test_the_size_is_that_of_the_format():
    """A half, a quarter or an eighth of what the same texels take uncompressed, and whole blocks at the edges."""
    for format, (texel, ratio) in {"bc4": (1, 2), "bc5": (2, 2), "bc7": (4, 4), "etc2": (4, 8)}.items():
        assert 64 * 32 * texel == ratio * encode(np.zeros((32, 64, 4), np.uint8), format).size
        for width, height in ((1, 1), (4, 4), (5, 4), (61, 37), (3, 130)):
            across, down = -(-width // 4), -(-height // 4)
            size = BLOCK_BYTES[format] * across * down
            rows = encode(np.zeros((height, width, 4), np.uint8), format)
            assert rows.shape == stored_shape(format, width, height) == (down, size // down)
            assert rows.nbytes == stored_bytes(format, width, height) == size
    assert stored_shape("rgba8", 5, 3, texel=4) == (3, 20)


@pytest.mark.parametrize("format", ["bc4", "bc7", "etc2"])
@pytest.mark.needs("etcpak")
def test_edges_are_continued_and_tiles_leave_no_seam(format):
    """Blocks know nothing of each other: those of a part of a picture are those of the whole."""
    picture = pictures(150, 70)["smooth"]
    whole = encode(picture[:70, :149], format)
    continued = np.pad(picture[:70, :149], ((0, 2), (0, 3), (0, 0)), mode="edge")
    assert np.array_equal(encode(continued, format), whole)
    size = BLOCK_BYTES[format]
    part = encode(picture[60:70, 60:149], format)
    assert np.array_equal(part, whole[15:, 15 * size :])


@pytest.mark.needs("etcpak")
def test_a_chain_is_encoded_level_by_level():
    levels = mip_chain(pictures(20, 12)["smooth"], True)
    chain = encode_chain(levels, "bc7_srgb")
    assert [rows.shape for rows in chain] == [(3, 80), (2, 48), (1, 32), (1, 16), (1, 16)]
    for level, rows in zip(levels, chain, strict=True):
        assert np.array_equal(rows, encode(level, "bc7"))


@pytest.mark.needs("etcpak", "texture2ddecoder")
def test_more_effort_is_no_worse():
    picture = pictures(64, 64)["normal"]
    found = [
        psnr(decoded(encode(picture, "bc7", effort), "bc7", 64, 64), picture)
        for effort in ("fast", "medium", "best")
    ]
    assert found == sorted(found) and found[1] > found[0] + 2


@pytest.mark.feature("textures/block-compression")
def test_what_a_device_lacks_is_stored_uncompressed():
    assert storage_of("bc7_srgb", {"block-compression"}) == "bc7_srgb"
    assert storage_of("bc7_srgb", {"etc2"}) == "rgba8_srgb"
    assert storage_of("bc7", ()) == "rgba8"
    assert storage_of("etc2", {"block-compression"}) == "rgba8"
    assert (storage_of("bc4", ()), storage_of("bc5", ())) == ("r8", "rg8")
    assert storage_of("rgba16f", ()) == "rgba16f"
    assert PLAIN.keys() == FEATURE.keys() == BLOCK_BYTES.keys()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "is not installed"),
        (
            "raise OSError('an instruction\\nis missing')",
            "cannot be imported (OSError: an instruction is missing)",
        ),
        ("import no_such_library", "cannot be imported (No module named 'no_such_library')"),
    ],
)
def test_without_the_package_a_sentence_says_so(monkeypatch, tmp_path, text, says):
    monkeypatch.delitem(sys.modules, "etcpak", raising=False)
    if text is None:
        monkeypatch.setitem(sys.modules, "etcpak", None)
    else:
        (tmp_path / "etcpak.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
    blocks._encoder.cache_clear()
    assert blocks.lack() == says
    with pytest.raises(UnsupportedError, match=re.escape(f"needs the package etcpak, which {says}: run")):
        encode(np.zeros((4, 4, 4), np.uint8), "bc7")


def test_what_cannot_be_encoded_is_refused():
    with pytest.raises(ValueError, match="no block format 'bc8'"):
        encode(np.zeros((4, 4, 4), np.uint8), "bc8")
    for wrong in (
        np.zeros((4, 4, 3), np.uint8),
        np.zeros((4, 4, 4), np.float32),
        np.zeros((0, 4, 4), np.uint8),
    ):
        with pytest.raises(ValueError, match=r"Blocks are made of \(H, W, 4\) uint8"):
            encode(wrong, "bc7")


@pytest.mark.needs("texture2ddecoder")
def test_the_truth_about_bc4_is_that_of_other_authors():
    """They drop the fraction; blocks of random bits use both orders of the ends."""
    rows = random_blocks("bc4", 64, 64, 5)
    assert np.array_equal(np.floor(exact_bc4(rows, 64, 64) + 1e-9), decoded(rows, "bc4", 64, 64)[..., 0])
