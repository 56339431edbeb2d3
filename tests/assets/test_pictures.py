"""The pictures of the documentation: there is one of every scene, not too large, and averaging keeps light."""

from __future__ import annotations

import runpy

import numpy as np
import pytest

from assets import SCENES
from common.images import read_image
from common.images.color import decode_srgb
from common.paths import ROOT

SCRIPT = runpy.run_path(str(ROOT / "docs" / "pictures.py"))


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_has_its_picture(name):
    path = ROOT / "docs" / "pictures" / f"{name}.png"
    assert path.stat().st_size < 700_000
    picture = read_image(path)
    assert picture.shape[:2] == SCRIPT["SIZE"][::-1]
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 200


@pytest.mark.parametrize("name", SCRIPT["SHEETS"])
def test_every_sheet_is_there(name):
    path = ROOT / "docs" / "pictures" / f"{name}.png"
    assert path.stat().st_size < 250_000
    assert len(np.unique(read_image(path).reshape(-1, 3), axis=0)) > 200


def test_averaging_keeps_light():
    """Black and white in turn become the code of half the light (188), not half the code (128)."""
    board = np.zeros((4, 8, 4), np.uint8)
    board[::2, ::2, :3] = board[1::2, 1::2, :3] = 255
    assert np.array_equal(SCRIPT["halved"](board), np.full((2, 4, 3), 188, np.uint8))
    codes = np.random.default_rng(5).integers(0, 256, (6, 4, 3), dtype=np.uint8)
    light = decode_srgb(codes / 255)
    for row in range(3):
        for column in range(2):
            mean = light[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].mean(axis=(0, 1))
            found = SCRIPT["halved"](codes)[row, column].astype(float)
            assert (decode_srgb((found - 0.51) / 255) <= mean).all()
            assert (mean <= decode_srgb((found + 0.51) / 255)).all()


def test_a_wrong_name_is_told_before_anything_is_written(tmp_path, capsys):
    assert SCRIPT["main"](["atrum", "--out", str(tmp_path / "new")]) == 2
    assert "did you mean 'atrium'?" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
