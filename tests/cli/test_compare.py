"""`strata compare A B`: equal sides, each kind of difference, numpy truths of the figures, and every bad input."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from chapters import scenes
from common.errors import UserError
from common.images import read_image, write_image
from common.reports import metrics
from common.settings import knob, preset, replaced
from tools.bench.points import Point
from tools.compare import measure, report
from tools.compare import sheet as compare_sheet
from tools.compare.compare import Request, load_scene
from tools.compare.measure import Measured
from tools.compare.sides import Drawn, Picture, read_side

SIZE = (48, 32)
SMALL = ("--scene", "cornell", "--size", "48x32")

KEYS = {
    *("format", "strata", "differs", "scene", "environment", "camera", "size", "time", "frames", "fps"),
    *("A", "B", "error", "work_that_differs", "picture"),
}
"""Of the record of `--json`; scripts read it by these names."""
ERROR_KEYS = {"of", "relative_mse", "max_abs", "flip", "pixels_changed", "not_finite", "same"}
SIDE_KEYS = {
    *("text", "kind", "chapter", "backend", "device", "quality", "without", "plan", "settings"),
    *("gpu_ms", "wall_ms", "cpu_ms", "noise_ms", "wall_noise_ms", "cpu_noise_ms"),
    *("least_ms", "wall_least_ms", "cpu_least_ms", "passes_ms", "work"),
}
"""Of a side that is a chapter; a picture has fewer."""

pytestmark = pytest.mark.feature("tools/compare")


@pytest.fixture
def strata(strata, monkeypatch):
    """Run a command as everywhere, with few frames to time."""
    for name, count in (("ROUNDS", 2), ("FRAMES", 1), ("WARM_UP", 1)):
        monkeypatch.setattr(measure, name, count)
    return strata


def panel(sheet: np.ndarray, index: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return picture `index` (H, W, 3) of a sheet; every pixel of it must be magnified evenly."""
    times, (x, y) = compare_sheet.magnification(size), compare_sheet.origin(index, size)
    width, height = size
    area = sheet[y : y + height * times, x : x + width * times]
    picture = area[::times, ::times]
    assert np.array_equal(area, picture.repeat(times, axis=0).repeat(times, axis=1))
    return picture


@pytest.fixture
def pair(tmp_path) -> tuple[np.ndarray, np.ndarray]:
    """Pictures a.png and b.png of noise: one patch is 40 codes brighter in one channel, three pixels are 1 code off."""
    a = np.random.default_rng(4).integers(20, 200, (20, 24, 3)).astype(np.uint8)
    b = a.copy()
    b[5:9, 10:13, 1] += 40
    b[0, 0:3, 2] += 1
    write_image(tmp_path / "a.png", a)
    write_image(tmp_path / "b.png", b)
    return a, b


# --- what is drawn ----------------------------------------------------------------------------------------------------


def test_equal_sides_differ_in_nothing_and_the_clock_has_60_steps_a_second(
    strata, vulkan_instance, tmp_path, monkeypatch
):
    times: list[float] = []
    view_of = chapters.view_of
    monkeypatch.setattr(chapters, "view_of", lambda *words: times.append(words[2]) or view_of(*words))
    code, out, err = strata("compare", "1", "1", *SMALL, "--json", "r.json", "--time", "2", "--frames", "3")
    assert code == 0, err
    assert times[:3] == [2.0, 2.0 + 1 / 60, 2.0 + 2 / 60]
    assert out.startswith("Nothing differs between A and B: both are chapter 1 on Vulkan, medium.\n")
    assert "Both pictures are the same to the bit." in out
    assert err.strip().replace("\\", "/") == "Wrote out/compare-1-1.png"
    record = json.loads((tmp_path / "r.json").read_text())
    error = record["error"]
    assert error["same"] is True
    assert error["relative_mse"] == error["max_abs"] == error["pixels_changed"] == 0
    assert error["flip"] in (0, None)
    assert record.keys() == KEYS
    assert error.keys() == ERROR_KEYS
    assert record["A"].keys() == record["B"].keys() == SIDE_KEYS
    assert record["work_that_differs"] == {}
    assert record["A"]["passes_ms"].keys() == {"forward", "tonemap"}
    assert record["A"]["gpu_ms"] > 0 and record["B"]["cpu_ms"] > 0
    sheet = read_image(tmp_path / "out" / "compare-1-1.png")
    assert np.array_equal(panel(sheet, 0), panel(sheet, 1))
    assert len(np.unique(panel(sheet, 0))) > 10
    assert (panel(sheet, 2) == compare_sheet.heat(np.zeros((1, 1), np.float32), 1.0)).all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "r.json"]


def test_the_backends_agree(strata, vulkan_instance, gl_context, tmp_path):
    code, out, err = strata("compare", "1", "1@gl", *SMALL, "--json", "r.json", "--out", "s.png")
    assert code == 0, err
    assert out.startswith("The backend differs: Vulkan, OpenGL.\n")
    record = json.loads((tmp_path / "r.json").read_text())
    assert [record[side]["backend"] for side in "AB"] == ["vulkan", "gl"]
    assert record["error"]["max_abs"] <= 1.001 / 255
    assert record["error"]["relative_mse"] < 1e-6
    assert record["error"]["pixels_changed"] == 0


@pytest.mark.needs("OpenEXR")
def test_samples_show_in_picture_error_and_work_and_files_give_the_same_figures(
    strata, vulkan_instance, tmp_path
):
    for name in ("first", "second"):
        words = ("--json", f"{name}.json", "--out", f"{name}.png", "--map", "difference")
        code, out, err = strata("compare", "1", "1:msaa=4", *SMALL, *words)
        assert code == 0, err
    assert out.startswith("msaa: 1, 4.\n")
    assert "work: samples" in out and "resolve, GPU ms" in out
    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "second.png").read_bytes()
    records = [json.loads((tmp_path / f"{name}.json").read_text()) for name in ("first", "second")]
    error = records[0]["error"]
    assert error == records[1]["error"]
    assert error["relative_mse"] > 0 and 0 < error["pixels_changed"] < 0.5 and error["same"] is False
    assert records[0]["work_that_differs"]["samples"] == [1, 4]

    # The same two pictures without the command, and as files.
    scene, shown, light = scenes.load("cornell"), [], []
    for name, samples in (("a", 1), ("b", 4)):
        settings = replaced(preset(chapters.settings_class(1), "medium"), msaa=samples)
        outputs = {"color", "color_linear"}
        with chapters.open(
            1, "vulkan", scene=scene, size=SIZE, settings=settings, outputs=outputs
        ) as renderer:
            frame = renderer.render(chapters.view_of(renderer))
            shown.append(frame.image("color"))
            light.append(frame.image("color_linear").astype(np.float64))
        write_image(tmp_path / f"{name}.png", shown[-1])
        write_image(tmp_path / f"{name}.exr", light[-1].astype(np.float32))
    sheet = read_image(tmp_path / "first.png")
    assert all(np.array_equal(panel(sheet, index), shown[index]) for index in (0, 1))
    difference = np.abs(shown[1].astype(int) - shown[0])
    assert error["max_abs"] == pytest.approx(difference.max() / 255, abs=1e-6)
    assert error["pixels_changed"] == pytest.approx((difference > 1).any(axis=-1).mean(), abs=1e-12)
    floor = 0.01 * np.abs(light[0]).mean() ** 2
    truth = ((light[1] - light[0]) ** 2 / (light[0] ** 2 + floor)).mean()
    assert error["relative_mse"] == pytest.approx(truth, rel=1e-9)
    for a, b, exact in (("a.png", "1", True), ("a.exr", "1:msaa=4", False)):
        assert strata("compare", a, b, "--scene", "cornell", "--json", "files.json")[0] == 0
        found = json.loads((tmp_path / "files.json").read_text())
        assert found["size"] == list(SIZE)
        assert found["error"]["same"] is exact
        assert exact or found["error"]["relative_mse"] == pytest.approx(truth, rel=1e-9)


def test_studies_are_compared_on_what_they_draw_themselves(strata, vulkan_instance, gl_context, tmp_path):
    """The atrium, which chapters draw, would be another object in another place."""
    for a, b in (("1/one-light", "1/one-light@gl"), ("1/first-triangle", "1/one-light")):
        code, out, err = strata("compare", a, b, "--size", "48x32", "--json", "r.json", "--out", "c.png")
        assert code == 0, err
        assert "\nspheres, 48x32" in out
        assert json.loads((tmp_path / "r.json").read_text())["scene"] == "spheres"
        if a == "1/one-light":
            assert strata("run", a, "--size", "48x32", "--out", "own.png")[0] == 0
            assert np.array_equal(panel(read_image(tmp_path / "c.png"), 0), read_image(tmp_path / "own.png"))
    code, _, err = strata("compare", "1/first-triangle", "1/first-triangle@gl", "--scene", "cornell")
    assert code == 2 and "brings what it draws: leave --scene out." in err
    sides = read_side("1/one-light", "medium"), read_side("1", "medium")
    both = load_scene(sides, Request("1/one-light", "1"))
    assert both is not None and both.name == "atrium", "beside a chapter both draw the chapter's"


@pytest.mark.needs("moderngl")
def test_a_fork_is_compared_with_its_chapter(strata, tmp_path):
    copy = tmp_path / "dark@home" / "a room"
    shutil.copytree(chapters.FOLDER / "ch01", copy, ignore=shutil.ignore_patterns("__pycache__", "studies"))
    settings = copy / "shading" / "settings.py"
    text = settings.read_text("utf-8")
    assert '0.02, "linear grey' in text
    settings.write_text(text.replace('0.02, "linear grey', '0.5, "linear grey'), "utf-8")
    code, out, err = strata("compare", "1", "dark@home/a room", *SMALL, "--json", "r.json")
    assert code == 0, err
    assert out.startswith("The code differs: chapter 1, the fork dark@home/a room; background: 0.02, 0.5.\n")
    record = json.loads((tmp_path / "r.json").read_text())
    assert record["error"]["pixels_changed"] > 0.01
    assert {name: record["B"][name] for name in ("kind", "chapter", "fork")} == {
        "kind": "fork",
        "chapter": 1,
        "fork": str(copy.resolve()),
    }
    side = read_side("dark@home/a room@gl:msaa=4", "low")
    assert (str(side.which), side.backend, side.settings.shading.msaa) == ("dark@home/a room", "gl", 4)
    code, _, err = strata("compare", "1", "dark@home/a rom:low", *SMALL)
    assert (code, err) == (2, "strata: There is no folder dark@home/a rom; did you mean 'a room'?\n")
    (copy / "gl_renderer.py").unlink()
    assert strata("compare", "1", "dark@home/a room@gl", *SMALL)[2].endswith(
        "Fork dark@home/a room has no OpenGL version: use --backend vulkan.\n"
    )


def measured(which, settings, paths, **record) -> Measured:
    side = Drawn(f"{which}", which, "vulkan", settings, "medium", ())
    choices = [SimpleNamespace(feature=feature, path=path) for feature, path in paths.items()]
    return Measured(side, None, None, record=record, plan=SimpleNamespace(choices=choices))


def test_chapters_plans_and_wishes_that_differ_are_said():
    kind = chapters.settings_class(1)

    @dataclass(init=False)
    class Later(kind):
        bloom: bool = knob(True, "whether bright light spreads")

    a = measured(1, replaced(kind(), msaa=8), {"anisotropy": "x", "msaa": "4 samples a pixel"})
    b = measured(2, Later(tone_curve="none"), {"anisotropy": "y", "bindless": "z"})
    assert report.differences(a, b) == (
        "The chapter differs: 1, 2; msaa: 8, 1; tone_curve: neutral, none; B alone has the settings bloom; "
        "anisotropy is x, y; msaa of A is 4 samples a pixel here."
    )


def test_times_stand_in_the_order_of_the_frame_and_without_timestamps_there_are_none():
    a = measured(
        1, None, {}, passes_ms={"f": 1.0, "t": 2.0}, gpu_ms=3.0, noise_ms=0.1, cpu_ms=4.0, wall_ms=5.0
    )
    b = measured(1, None, {}, passes_ms={"s": 6.0, "f": 7.0, "r": 8.0, "t": 9.0})
    rows = report.times(a, b)
    assert [row[:3] for row in rows[:4]] == [
        ("s, GPU ms", None, 6.0),
        ("f, GPU ms", 1.0, 7.0),
        ("r, GPU ms", None, 8.0),
        ("t, GPU ms", 2.0, 9.0),
    ]
    assert rows[4] == ("all passes, GPU ms", 3.0, None, (0.1, None))
    c = measured(
        1, None, {}, passes_ms={}, gpu_ms=5.0, cpu_ms=4.0, wall_ms=5.0
    )  # gpu_ms is the wall clock here
    assert report.times(c, c)[0] == ("all passes, GPU ms", None, None, (None, None))


def test_times_are_taken_in_turns():
    order = []

    class Timed:
        def __init__(self, name: str, seconds: float) -> None:
            self.name, self.seconds = name, seconds
            self.side = SimpleNamespace(text=name)
            self.point = Point(name, "side", None)

        def timed_frame(self) -> dict[str, float]:
            order.append(self.name)
            return {"wall": self.seconds * 1e3}

    fast, slow = Timed("A", 0.01), Timed("B", 0.2)
    measure._time([fast, slow], lambda what, part: None)
    assert "".join(order) == "AAABBB" + "AAAABB" * 5  # the slow one is given fewer frames in each turn
    assert [len(one) for one in slow.point.rounds] == [2] * 5


# --- figures of files, against numpy ----------------------------------------------------------------------------------


def test_figures_and_map_of_a_known_change(strata, tmp_path, pair):
    a, b = pair
    code, out, err = strata("compare", "a.png", "b.png", "--json", "r.json", "--map", "difference")
    assert code == 0, err
    assert out.startswith("A is the picture a.png; B is the picture b.png.\n")
    error = json.loads((tmp_path / "r.json").read_text())["error"]
    assert error["max_abs"] == pytest.approx(40 / 255, abs=1e-6)
    assert error["pixels_changed"] == pytest.approx(12 / 480)  # one code is no change
    assert error["relative_mse"] is None  # no light is known
    sheet = read_image(tmp_path / "out" / "compare-a-b.png")
    size = (24, 20)
    assert np.array_equal(panel(sheet, 0, size), a) and np.array_equal(panel(sheet, 1, size), b)
    brightness = panel(sheet, 2, size).astype(int).sum(axis=-1)
    black = compare_sheet.heat(np.zeros((1, 1), np.float32), 1.0).astype(int).sum()
    patch = np.zeros((20, 24), bool)
    patch[5:9, 10:13] = True
    touched = patch.copy()
    touched[0, 0:3] = True
    assert (brightness[~touched] == black).all()
    assert (brightness[touched] > black).all()
    assert brightness[patch].min() > 4 * brightness[touched & ~patch].max()


@pytest.mark.needs("flip_evaluator")
def test_flip_is_that_of_its_authors_package(strata, tmp_path, pair):
    import flip_evaluator as flip

    a, b = (picture.astype(np.float32) / 255 for picture in pair)
    _, mean, _ = flip.evaluate(a, b, "LDR")
    assert strata("compare", "a.png", "b.png", "--json", "r.json")[0] == 0
    found = json.loads((tmp_path / "r.json").read_text())["error"]["flip"]
    assert found == pytest.approx(mean, rel=1e-3)
    sheet = read_image(tmp_path / "out" / "compare-a-b.png")
    brightness = panel(sheet, 2, (24, 20)).astype(int).sum(axis=-1)
    assert np.unravel_index(brightness.argmax(), brightness.shape)[0] in range(5, 9)


def test_without_the_package_of_flip_the_map_shows_differences(strata, tmp_path, pair, monkeypatch):
    def missing():
        raise UserError("FLIP needs the package flip-evaluator.")

    monkeypatch.setattr(metrics, "_flip", missing)
    assert strata("compare", "a.png", "b.png", "--json", "r.json", "--out", "s.png")[0] == 0
    assert json.loads((tmp_path / "r.json").read_text())["error"]["flip"] is None
    assert strata("compare", "a.png", "b.png", "--map", "difference", "--out", "t.png")[0] == 0
    assert (tmp_path / "s.png").read_bytes() == (tmp_path / "t.png").read_bytes()
    code, _, err = strata("compare", "a.png", "b.png", "--map", "flip", "--out", "u.png")
    assert (code, err) == (2, "strata: FLIP needs the package flip-evaluator.\n")
    assert not (tmp_path / "u.png").exists()


@pytest.mark.needs("OpenEXR")
def test_light_is_compared_as_light_and_a_nan_is_green(strata, tmp_path):
    a = np.random.default_rng(1).random((16, 16, 3), np.float32) * 900 + 1
    b = a * np.float32(1.5)
    write_image(tmp_path / "a.exr", a)
    write_image(tmp_path / "b.exr", b)
    assert strata("compare", "a.exr", "b.exr", "--json", "r.json")[0] == 0
    error = json.loads((tmp_path / "r.json").read_text())["error"]
    x, y = a.astype(np.float64), b.astype(np.float64)
    truth = ((y - x) ** 2 / (x * x + 0.01 * x.mean() ** 2)).mean()
    assert error["relative_mse"] == pytest.approx(truth, rel=1e-9)
    assert error["max_abs"] == pytest.approx(np.abs(y - x).max(), rel=1e-6)
    b[3, 4, 1] = np.nan
    b[7, 8, 0] = np.inf
    write_image(tmp_path / "b.exr", b)
    code, out, _ = strata("compare", "a.exr", "b.exr", "--json", "r.json")
    assert code == 0
    assert "2 pixels of B are not finite" in out
    error = json.loads((tmp_path / "r.json").read_text())["error"]
    assert error["relative_mse"] is None and error["not_finite"] == [0, 2]
    shown = panel(read_image(tmp_path / "out" / "compare-a-b.png"), 2, (16, 16))
    green = (shown == (0, 255, 0)).all(axis=-1)
    assert np.argwhere(green).tolist() == [[3, 4], [7, 8]]


@pytest.mark.needs("OpenEXR")
def test_light_of_two_channels_is_refused(strata, tmp_path):
    """In a PNG the second channel is alpha. In an EXR it is data, and without it the rest would be taken for grey."""
    write_image(tmp_path / "two.exr", np.ones((8, 8, 2), np.float32))
    write_image(tmp_path / "one.exr", np.ones((8, 8, 1), np.float32))
    code, _, err = strata("compare", "two.exr", "one.exr")
    assert code == 2
    assert err == "strata: two.exr has 2 channels: a picture to compare has grey, or red, green and blue.\n"
    assert strata("compare", "one.exr", "one.exr")[0] == 0


def test_pictures_of_other_kinds_are_read_as_what_they_show(tmp_path):
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    write_image(tmp_path / "grey.png", grey)
    write_image(tmp_path / "deep.png", np.repeat(grey.astype(np.uint16) * 257, 3, axis=2))
    alpha = np.concatenate([np.repeat(grey, 3, axis=2), 255 - grey], axis=2)
    write_image(tmp_path / "alpha.png", alpha)
    sides = [read_side(str(tmp_path / f"{name}.png"), "medium") for name in ("grey", "deep", "alpha")]
    for side in sides:
        assert isinstance(side, Picture) and side.shown is not None and side.linear is None
        assert np.abs(side.shown * 255 - grey).max() < 1e-4
    assert sides[2].note == "The alpha of alpha.png is left out."


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("1", "99"), "There is no chapter 99: "),
        (("1", "1-bindless"), "There is no chapter '1-bindless'"),
        (("1", "./1-bindless"), "There is no folder ./1-bindless."),
        (("1", "1/no-such-study"), "no-such-study"),
        (("1", "1@vulcan"), "There is no backend 'vulcan'; did you mean 'vulkan'?"),
        (("1", "1@"), "1@: no backend stands after the @"),
        (("1", "1:"), "1:: a setting is missing after the colon"),
        (("1", "1:msaa=4@gl"), "the backend stands before the settings, as in 1@gl:msaa=4."),
        (("1", "1:mssa=4"), "1:mssa=4: there is no setting 'mssa'; did you mean 'msaa'?"),
        (("1", "1:msaa=3"), "1:msaa=3: setting msaa must be one of 1, 2, 4, 8, not '3'"),
        (("1", "1:msaa"), "1:msaa: setting 'msaa' has no value"),
        (("1", "1:hihg"), "1:hihg: there is no preset or setting 'hihg'; did you mean 'high'?"),
        (("1", "1:low,high"), "low and high are two presets"),
        (("1", "1:without=meshshader"), "did you mean 'mesh-shader'?"),
        (("1", "1", "--without", "meshshader"), "did you mean 'mesh-shader'?"),
        (("1", "aa.png"), "There is no file aa.png; did you mean 'a.png'?"),
        (("1", "nowhere/a.png"), "There is no file nowhere/a.png."),
        (("notes.txt", "1"), "notes.txt is not of a kind that can be read: .png"),
        (("liar.png", "1"), "liar.png cannot be read"),
        (
            ("a.png", "small.png"),
            "a.png is 24x20 and small.png is 8x8: pictures to compare must have one size.",
        ),
        (("a.png", "1", "--size", "64x64"), "--size 64x64 differs from a.png, which is 24x20"),
        pytest.param(
            ("a.png", "light.exr"),
            "light.exr is linear light and a.png is what is shown",
            marks=pytest.mark.needs("OpenEXR"),
        ),
        (("a.png", "b.png", "--out", "c.jpg"), "c.jpg"),
        (("a.png", "b.png", "--out", "c.exr"), "--out c.exr: the pictures and the map go to a .png."),
        (("a.png", "b.png", "--out", "b.png"), "must not name a picture that is compared"),
        (("a.png", "b.png", "--out", "x/c.png"), "there is no folder x"),
        (("a.png", "b.png", "--out", "c.png", "--json", "c.png"), "--out and --json both name c.png"),
        (("a.png", "b.png", "--json", "x/c.json"), "--json x/c.json cannot be written"),
        (("a.png", "b.png", "--map", "flop"), "There is no map 'flop'; did you mean 'flip'?"),
        (("1", "1", "--quality", "hihg"), "There is no quality 'hihg'; did you mean 'high'?"),
        (("1", "1", "--frames", "0"), "--frames 0 draws nothing"),
        (("1", "1", "--time", "nan"), "--time nan is no time"),
        (("1", "1", "--frames", "9", "--fps", "1e-30"), "With --frames and --fps the last --time"),
        (("1", "1", "--fps", "0"), "--fps 0.0 is no rate"),
        (("1", "1", "--ev", "99"), "--ev 99.0 is no exposure"),
        (("1", "1", "--scene", "cornel"), "cornell"),
        (("1", "1", "--size", "big"), "--size 'big' is no size"),
        (("1",), "Missing argument 'B'"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(strata, tmp_path, pair, words, says):
    write_image(tmp_path / "small.png", np.zeros((8, 8, 3), np.uint8))
    if "light.exr" in words:
        write_image(tmp_path / "light.exr", np.zeros((20, 24, 3), np.float32))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "liar.png").write_text("no picture")
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    code, out, err = strata("compare", *words)
    assert code == 2
    assert out == ""
    assert says in err and err.startswith("strata: ") and err.count("\n") == 1
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_a_file_in_the_way_of_the_folder_is_said_before_the_work(strata, tmp_path, pair):
    (tmp_path / "out").write_text("in the way")
    code, _, err = strata("compare", "a.png", "b.png")
    assert code == 2 and "say --out FILE.png" in err
    assert (tmp_path / "out").read_text() == "in the way"


def test_labels_fit_whatever_the_names_are(tmp_path):
    pixels = np.zeros((1, 300, 3), np.uint8)
    panels = [compare_sheet.Panel("B   " + "длинное-имя" * 30, "x" * 500, pixels)] * 3
    made = compare_sheet.sheet(panels, 0.5, True, ["word " * 60, "y" * 900])
    assert made.dtype == np.uint8 and made.shape[2] == 3
    right = made[:, -compare_sheet.MARGIN :]
    assert (right == compare_sheet.PAPER).all()  # nothing runs over the edge


def test_one_bright_pixel_does_not_darken_the_map():
    values = np.full((100, 100), 0.1, np.float32)
    values[0, 0] = 0.9
    assert measure._limit("flip", values) == (0.1, True)
    assert measure._limit("flip", np.zeros((4, 4), np.float32)) == (0.01, False)
    assert measure._limit("difference", np.full((4, 4), np.nan, np.float32))[1] is False


def test_the_bar_of_a_sheet_shows_the_colours_of_the_map():
    panels = [compare_sheet.Panel("t", "n", np.zeros((10, 10, 3), np.uint8))] * 3
    made = compare_sheet.sheet(panels, 0.2, False, [])
    x, y = compare_sheet.origin(2, (10, 10))
    row = made[
        y + 10 * compare_sheet.magnification((10, 10)) + 8 + 5, x + 1 : x + compare_sheet.SMALLEST_PANEL - 1
    ]
    ends = compare_sheet.heat(np.array([[0.0, 0.2]], np.float32), 0.2)[0].astype(int)
    assert np.abs(row[0] - ends[0]).max() <= 3 and np.abs(row[-1] - ends[1]).max() <= 3


def test_the_record_alone_goes_to_stdout(strata, tmp_path, pair):
    code, out, err = strata("compare", "a.png", "b.png", "--json", "-")
    assert code == 0
    assert json.loads(out)["error"]["pixels_changed"] == pytest.approx(12 / 480)
    assert "2.500% of the pixels changed by more than 1/255." in err
    assert not (tmp_path / "-").exists()


def test_files_are_compared_without_graphics(strata, pair, monkeypatch):
    def none(*_):
        raise AssertionError("a backend was asked for")

    monkeypatch.setattr(chapters, "choose_backend", none)
    assert strata("compare", "a.png", "b.png", "--out", "s.png")[0] == 0
