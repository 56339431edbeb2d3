"""`strata compare --path`: errors over time against numpy, equal sides, the worst frame, and every bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from PIL import Image

import chapters
from chapters import scenes
from common.errors import UserError
from common.images import read_image, write_image
from common.reports import metrics
from common.settings import preset, replaced
from common.view.paths import Stage, path

SIZE = (48, 32)
SMALL = ("--scene", "cornell", "--size", "48x32")
KEYS = ("max_abs", "psnr", "relative_mse", "flip", "flicker")

pytestmark = pytest.mark.feature("tools/compare")


def drawn(name: str, frames: int, **changes) -> list[np.ndarray]:
    """The frames of chapter 1 along a path, as codes."""
    scene = scenes.load("cornell")
    settings = replaced(preset(chapters.settings_class(1), "medium"), **changes)
    found = []
    with chapters.open(1, "vulkan", scene=scene, size=SIZE, settings=settings) as renderer:
        start = chapters.view_of(renderer)
        for index, view in enumerate(path(name, Stage.of(scene, start, SIZE), frames)):
            found.append(renderer.render(view, index / 60).image("color")[..., :3].astype(np.float64))
    return found


def test_equal_sides_have_no_error_and_no_flicker(strata, tmp_path):
    words = ("--path", "walk", "--frames", 4, "--json", "r.json")
    code, out, err = strata("compare", 1, 1, *SMALL, *words)
    assert code == 0, err
    assert out.startswith("Nothing differs between A and B: both are chapter 1 on Vulkan, medium.\n")
    assert "cornell, 48x32, walk: B against A" in out
    assert err.replace("\\", "/") == "Wrote out/compare-1-1-walk.png, the worst frame\n"
    record = json.loads((tmp_path / "r.json").read_text())
    assert (record["path"], record["frames"], record["worst_frame"]) == ("walk", 4, 0)
    over = record["over_time"]
    assert tuple(over) == KEYS
    assert over["max_abs"] == over["relative_mse"] == [0.0] * 4
    assert over["psnr"] == [None] * 4 and over["flicker"] == [None, 0.0, 0.0, 0.0]
    assert record["mean"]["psnr"] is None and record["mean"]["flicker"] == 0.0
    assert record["A"]["passes_ms"].keys() == {"forward", "tonemap"}
    assert sorted(one.name for one in tmp_path.iterdir()) == ["out", "r.json"]


@pytest.mark.parametrize("package", [True, False])
def test_errors_over_time_are_those_of_numpy(strata, tmp_path, monkeypatch, package):
    if not package:

        def missing():
            raise UserError("no package")

        monkeypatch.setattr(metrics, "_flip", missing)
    words = ("--path", "pan:pixels=1.25", "--frames", 4, "--json", "r.json", "--out", "s.png")
    code, out, err = strata("compare", 1, "1:msaa=4", *SMALL, *words)
    assert code == 0, err
    record = json.loads((tmp_path / "r.json").read_text())
    over, mean = record["over_time"], record["mean"]
    a, b = (drawn("pan:pixels=1.25", 4, msaa=samples) for samples in (1, 4))
    squares = [((one - other) ** 2).mean() for one, other in zip(b, a, strict=True)]
    assert over["max_abs"] == pytest.approx(
        [np.abs(x - y).max() for x, y in zip(b, a, strict=True)], rel=1e-6
    )
    assert over["psnr"] == pytest.approx([10 * math.log10(255**2 / one) for one in squares], rel=1e-6)
    blinks = [np.abs((b[t] - b[t - 1]) - (a[t] - a[t - 1])).mean() for t in (1, 2, 3)]
    assert over["flicker"][0] is None and over["flicker"][1:] == pytest.approx(blinks, rel=1e-5)
    assert mean["flicker"] == pytest.approx(np.mean(blinks), rel=1e-5) and np.mean(blinks) > 0.1
    assert mean["psnr"] == pytest.approx(10 * math.log10(255**2 / np.mean(squares)), rel=1e-6)
    assert all(value > 0 for value in over["relative_mse"])
    if not package:
        assert over["flip"] == [None] * 4 and record["worst_frame"] == int(np.argmax(squares))
    elif over["flip"][0] is not None:
        assert record["worst_frame"] == int(np.argmax(over["flip"]))
    table = " ".join(out.split())
    assert f"worst ({record['worst_frame']})" in table and "last (3)" in table
    assert f"flicker, codes - {blinks[-1]:.3f}" in table or f"{blinks[-1]:.3f}" in table
    assert "Medians of all frames after the first" in table
    assert read_image(tmp_path / "s.png").shape[1] > 1000


def test_the_frames_of_a_film_are_sheets(strata, tmp_path):
    words = ("--path", "orbit", "--frames", 3, "--out", "s.webp", "--map", "difference")
    code, _, err = strata("compare", 1, "1@gl:msaa=4", *SMALL, *words)
    assert code == 0 and err == "Wrote s.webp\n", err
    with Image.open(tmp_path / "s.webp") as film:
        assert film.n_frames == 3 and film.size[0] > 1000


def test_a_map_of_flip_without_its_package_is_refused_before_the_work(strata, tmp_path, monkeypatch):
    def missing():
        raise UserError("no package")

    monkeypatch.setattr(metrics, "_flip", missing)
    code, _, err = strata("compare", 1, 1, *SMALL, "--path", "walk", "--map", "flip")
    assert (code, err) == (2, "strata: no package\n") and not list(tmp_path.iterdir())


def test_a_picture_has_no_path(strata, tmp_path):
    write_image(tmp_path / "a.png", np.zeros((32, 48, 3), np.uint8))
    code, _, err = strata("compare", 1, "a.png", "--path", "walk")
    assert code == 2
    assert err == "strata: a.png is a picture: with --path both sides are what a renderer draws.\n"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--path", "wlak"), "There is no path 'wlak'; did you mean 'walk'?"),
        (("--path", "walk", "--frames", 0), "--frames 0 draws nothing"),
        (("--path", "walk.json"), "There is no file walk.json"),
        (("--path", "walk", "--frames", 9, "--fps", "1e-9"), "With --frames and --fps the last --time"),
        (("--path", "walk", "--out", "a.jpg"), "--out a.jpg: the worst frame goes to a .png"),
        (("--path", "walk", "--out", "x/a.webp"), "there is no folder x"),
        (("--path", "walk", "--out", "a.gif", "--fps", 60), "a.gif cannot show 60 frames a second"),
        (("--path", "walk", "--out", "a.webp", "--frames", 10**7), "a.webp would be too large"),
        (("--out", "a.webp"), ".png"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(strata, tmp_path, words, says):
    code, out, err = strata("compare", 1, 1, *SMALL, *words)
    assert code == 2 and out == ""
    assert err.startswith("strata: ") and says in err and err.count("\n") == 1, err
    assert not list(tmp_path.iterdir())
