"""`strata reference`: means of the path tracer's frames, sums that go on bit for bit, and every bad input."""

from __future__ import annotations

import errno
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import chapters
from chapters import scenes
from common.errors import StaleFrameError, UserError
from common.images import read_layers
from common.packages import load
from common.paths import ROOT
from common.settings import preset, replaced
from tests.support.path_scenes import ABOVE, floor_under
from tests.support.scenes import quad_scene
from tools.reference import settings, tracing
from tools.reference.sums import Sums, read_sums, write_sums

pytestmark = pytest.mark.feature("path-tracer/accumulation")

SIZE = (16, 12)
SMALL = ("--scene", "cornell", "--size", "16x12")


@pytest.fixture
def kept(tmp_path_factory, monkeypatch):
    """Keep sums in a folder of the test: return it."""
    folder = tmp_path_factory.mktemp("references")
    monkeypatch.setattr(tracing, "cache_dir", lambda name: folder)
    return folder


@pytest.fixture
def unopened(monkeypatch):
    """Fail where a renderer is opened."""

    def opened(*words, **options):
        raise AssertionError("a renderer is opened")

    monkeypatch.setattr(chapters, "open", opened)


def interrupted(monkeypatch, after):
    """Have Ctrl-C come once so many blocks are merged."""
    told, left = tracing._Speed.told, [after]

    def stopped(*words):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return told(*words)

    monkeypatch.setattr(tracing._Speed, "told", stopped)


def one_by_one(monkeypatch, count):
    """Have the opened path tracer first sum single paths on the GPU; return a list for the last frame's figures."""
    trace, figures = tracing._trace, []

    def traced(renderer, task, *rest):
        knobs = renderer.settings.paths
        knobs.path_average, knobs.path_samples, knobs.path_first = True, 1, 0
        for _ in range(count):
            frame = renderer.render(task.view, task.time)
        figures.extend((frame.image("path_sums"), frame.work["path_error_ppm"] / 1e6))
        knobs.path_average = False
        trace(renderer, task, *rest)

    monkeypatch.setattr(tracing, "_trace", traced)
    return figures


@pytest.mark.needs("OpenEXR")
@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.long)])
def test_the_picture_is_the_mean_of_all_paths(strata, kept, tmp_path, monkeypatch, backend):
    """The renderer sums one path after the other on the GPU, and judges its error there."""
    figures = one_by_one(monkeypatch, 40)
    words = ("--paths", 40, "--error", 0, "--backend", backend, "--out", "r.exr")
    code, out, err = strata("reference", 1, *SMALL, *words)
    assert code == 0, err
    assert out == "" and "40 paths a pixel, estimated error" in err and "wrote r.exr" in err
    assert "Chapter 1 draws by design no shadows" in err and "--paths 40 allows no more" in err
    summed, error = figures
    layers = read_layers(tmp_path / "r.exr")
    assert layers[""].dtype == np.float32 and (layers["paths"] == 40).all() and (summed[..., 3] == 40).all()
    assert np.abs(layers[""] - summed[..., :3] / 40).max() <= 3e-6 * layers[""].max()
    notes = load("OpenEXR").File(str(tmp_path / "r.exr"), header_only=True).header()
    assert float(notes["estimatedError"]) == pytest.approx(error, rel=1e-4)
    assert np.sqrt((layers["error"].astype(float) ** 2).mean()) == pytest.approx(error, rel=1e-4)
    names = ("chapter", "scene", "paths", "pathsLeftOut", "filter", "seed", "backend")
    assert [notes[name] for name in names] == ["1", "cornell", "40", "0", "box", "0", backend]
    assert json.loads(notes["settings"])["path_bounces"] == 1024 and len(notes["sceneHash"]) == 32


def test_light_is_in_the_nits_of_a_frame(kept):
    """A renderer of the path tracer's chapter shows the same, and its output is divided by the exposure."""
    scene = scenes.load("cornell")
    found, _ = tracing.reference(1, scene, "1,0.5,3:0,0.8,0", SIZE, 0.0, paths=8, filter="centre")
    chosen = preset(chapters.settings_class(settings.TRACER), "reference")
    chosen = replaced(chosen, path_tracer=True, path_samples=8, path_filter="centre", path_bounces=1024)
    outputs = {"color_linear"}
    with chapters.open(settings.TRACER, scene=scene, size=SIZE, settings=chosen, outputs=outputs) as renderer:
        view = chapters.view_of(renderer, "1,0.5,3:0,0.8,0")
        seen = renderer.render(view).image("color_linear")
    assert seen.std() > 0.1 * seen.mean() > 0.0
    assert np.abs(found - seen).max() <= 3e-6 * seen.max()


def test_sums_go_on_bit_for_bit_and_what_is_kept_is_not_traced_again(strata, kept, tmp_path, monkeypatch):
    """Ctrl-C, a run with few paths, and one with more, against one run that keeps nothing."""
    words = ("reference", 1, *SMALL, "--error", 0)
    assert strata(*words, "--paths", 100, "--out", "whole.npy", "--no-cache")[0] == 0
    assert not [*kept.iterdir()]
    with monkeypatch.context() as patched:
        interrupted(patched, 20)
        code, out, err = strata(*words, "--paths", 100, "--out", "a.npy")
    assert (code, out) == (130, "")
    assert err.splitlines()[-2:] == [
        "strata: 20 paths a pixel traced and kept: the same command goes on with them.",
        "strata: stopped.",
    ]
    assert not (tmp_path / "a.npy").exists()
    code, out, err = strata(*words, "--paths", 41, "--out", "a.npy")
    assert code == 0 and "40 paths a pixel, 20 of them traced before" in err  # a block has two paths here
    code, out, err = strata(*words, "--paths", 100, "--out", "a.npy")
    assert code == 0 and "100 paths a pixel, 40 of them traced before" in err
    whole = np.load(tmp_path / "whole.npy")
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "whole.npy").read_bytes()
    assert whole.shape == (12, 16, 3) and whole.dtype == np.float32
    [path] = kept.iterdir()
    before = path.read_bytes()

    def opened(*words, **options):
        raise AssertionError("a renderer is opened")

    monkeypatch.setattr(chapters, "open", opened)
    code, out, err = strata(*words, "--paths", 100, "--out", "b.png")
    assert code == 0 and "100 paths a pixel, all traced before" in err
    assert "not kept" not in err
    assert path.read_bytes() == before
    with Image.open(tmp_path / "b.png") as picture:
        shown, notes = np.asarray(picture), dict(picture.info)
    assert shown.shape == (12, 16, 3) and (notes["paths"], notes["seed"]) == ("100", "0")
    linear = np.clip(whole * (1.0 / (1.2 * 2.0 ** float(notes["ev100"]))), 0.0, 1.0)
    codes = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.abs(shown - 255 * codes).max() <= 0.51


def test_the_error_is_the_one_asked_for(kept):
    """Another seed with many paths is the truth of the picture; a smaller error goes on."""
    scene = scenes.load("cornell")
    truth, _ = tracing.reference(1, scene, None, SIZE, 0.0, paths=768, seed=1, cached=False)
    first, estimated = tracing.reference(1, scene, None, SIZE, 0.12)
    better, smaller = tracing.reference(1, scene, None, SIZE, 0.06)
    assert 0.1 < estimated <= 0.12 and 0.05 < smaller <= 0.06
    luminance = np.array((0.2126, 0.7152, 0.0722))
    dark = 0.01 * 1.2 * 2.0**4.5
    for picture, error in ((first, estimated), (better, smaller)):
        assert picture.dtype == np.float32 and picture.shape == (12, 16, 3)
        away = (picture.astype(float) - truth) @ luminance / np.hypot(truth @ luminance, dark)
        assert 0.6 < np.sqrt((away**2).mean()) / error < 1.6


def test_no_limit_of_reflections_takes_light_from_a_reference():
    """A closed box of albedo 0.95 lost half of its light to the limit of 8 that frames have."""
    own, _ = settings.chapter_settings(1)
    assert settings.tracer_settings(own, "box", 0).paths.path_bounces == 1024
    assert settings.tracer_settings(own, "box", 0, ["path_bounces=2"]).paths.path_bounces == 2


def test_light_that_is_no_number_is_counted_and_never_written(kept, strata, monkeypatch):
    """A square of infinite light: the picture is finite, and a sentence says how many paths are left out."""
    lamp = replace(floor_under(quad_scene().materials[0]).materials[1], emissive=(3e38, 0.0, 0.0))
    monkeypatch.setattr(scenes, "load", lambda *words: floor_under(lamp))
    own, _ = settings.chapter_settings(1)
    chosen = settings.tracer_settings(own, "box", 0, ["path_bounces=1"])
    task = tracing.task_of(chosen, floor_under(lamp), ABOVE, SIZE, 0.0, "vulkan")
    keeper = tracing.Keeper(None, task.facts(), SIZE)
    tracing.trace(task, keeper, 0.0, 16)
    assert keeper.sums.left_out > 0 and np.isfinite(keeper.sums.picture).all()
    assert keeper.sums.light[..., 3].sum() == 16 * 16 * 12 - keeper.sums.left_out
    code, _, err = strata(
        "reference", 1, "--size", "16x12", "--paths", 4, "--out", "a.npy", "--set", "path_bounces=1"
    )
    assert code == 0 and "of 768 paths had light that is no number, and are left out" in err


# --- places that cannot be written ---


def full(monkeypatch, folder):
    """Have the disk of a folder full."""

    def write(path, sums, facts):
        if path.parent == folder:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_sums(path, sums, facts)

    monkeypatch.setattr(tracing, "write_sums", write)
    monkeypatch.setattr(tracing, "KEEP_EVERY_S", 0.0)


def test_a_full_disk_is_said_once_and_the_picture_is_written(strata, kept, tmp_path, monkeypatch):
    full(monkeypatch, kept)
    code, _, err = strata("reference", 1, *SMALL, "--error", 0, "--paths", 16, "--out", "a.npy")
    assert code == 0 and np.load(tmp_path / "a.npy").any()
    assert err.count("No space left on device") == 1 and "sums stay in memory" in err
    assert err.count("sums of paths are not kept") == 1


def test_sums_of_an_interrupted_run_go_beside_the_picture_where_the_cache_is_full(
    strata, kept, tmp_path, monkeypatch
):
    words = ("reference", 1, *SMALL, "--error", 0, "--paths", 24, "--out", "a.npy")
    with monkeypatch.context() as patched:
        full(patched, kept)
        interrupted(patched, 10)
        code, _, err = strata(*words)
    assert code == 130 and "10 paths a pixel traced and kept in a.npy.npz: --sums a.npy.npz goes on" in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy.npz"]
    code, _, err = strata(*words, "--sums", "a.npy.npz")
    assert code == 0 and "24 paths a pixel, 10 of them traced before" in err
    assert not [*kept.iterdir()]
    with np.load(tmp_path / "a.npy.npz") as file:
        assert json.loads(str(file["told"]))["paths"] == 24


def test_a_picture_that_cannot_be_written_leaves_its_sums(strata, kept, tmp_path, monkeypatch):
    def write_whole(path, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    from tools.reference import command

    monkeypatch.setattr(command, "write_whole", write_whole)
    code, _, err = strata("reference", 1, *SMALL, "--error", 0, "--paths", 2, "--out", "a.npy")
    [path] = kept.iterdir()
    assert code == 2
    assert err.splitlines()[-1] == (
        f"strata: a.npy cannot be written: No space left on device. Its sums are kept in {path}."
    )


# --- bad input ---


@pytest.mark.usefixtures("unopened")
@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "Name the chapter whose scene is traced"),
        (("99",), "There is no chapter 99"),
        (("1/first-triangle",), "1/first-triangle is a study"),
        (("1", "--error", "-1"), "--error -1 is no relative error"),
        (("1", "--error", "nan"), "--error nan is no relative error"),
        (("1", "--error", "2"), "--error 2 is no relative error"),
        (("1", "--error", "small"), "Invalid value for '--error'"),
        (("1", "--paths", "0"), "--paths 0 is no number of paths"),
        (("1", "--paths", "9999999999"), "--paths 9999999999 is no number of paths"),
        (("1", "--seed", "-1"), "--seed -1 is no seed"),
        (("1", "--filter", "gauss"), "There is no filter 'gauss': write box or centre."),
        (("1", "--size", "big"), "--size 'big' is no size"),
        (("1", "--time", "nan"), "--time nan is no time"),
        (("1", "--ev", "99"), "--ev 99.0 is no exposure"),
        (("1", "--scene", "cornel"), "cornell"),
        (("1", "--scene", "cornell", "--camera", "nowhere"), "nowhere"),
        (("1", "--backend", "metal"), "metal"),
        (("1", "--environment", "none.hdr"), "none.hdr"),
        (("1", "--set", "msaa=4"), "Chapter 1 draws otherwise with setting msaa"),
        (("1", "--set", "path_error=1"), "setting path_error is given by --error"),
        (("1", "--set", "path_bounces=x"), "setting path_bounces must be a whole number"),
        (("1", "--out", "a.jpg"), "a.jpg cannot be written as a picture: name .exr, .png or .npy"),
        (("1", "--out", "x/a.npy"), "there is no folder x"),
        (("1", "--sums", "a.txt"), "its name must end in .npz"),
        (("1", "--sums", "x/a.npz"), "--sums x/a.npz cannot be written"),
        (("1", "--sums", "a.npz", "--no-cache"), "--sums keeps what --no-cache forgets"),
        (("1", *SMALL, "--sums", "damaged.npz"), "damaged.npz holds no sums of paths"),
        (
            ("1", *SMALL, "--sums", "foreign.npz"),
            "foreign.npz holds the sums of another picture (of another scene",
        ),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(strata, tmp_path, words, says):
    (tmp_path / "damaged.npz").write_bytes(b"no sums")
    write_sums(tmp_path / "foreign.npz", Sums.none_of(SIZE), {"scene": "another"})
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    words = (*words, "--out", "a.png") if words and "--out" not in words else words
    code, out, err = strata("reference", *words)
    assert (code, out) == (2, "")
    assert says in err and err.startswith("strata: ") and err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_sums_of_another_scene_are_refused_from_python_too(kept, tmp_path):
    own, _ = settings.chapter_settings(1)
    chosen = settings.tracer_settings(own, "box", 0)
    tasks = [
        tracing.task_of(chosen, scenes.load(name), None, SIZE, 0.0, "vulkan")
        for name in ("cornell", "spheres")
    ]
    keeper = tracing.Keeper(tmp_path / "a.npz", tasks[0].facts(), SIZE, named=True)
    one = np.ones((12, 16, 4), np.float32)
    keeper.sums = keeper.sums.plus(one, one * (1, 0, 0, 0), 1, "")
    assert keeper.keep()
    assert read_sums(keeper.path, tasks[0].facts(), SIZE).paths == 1
    with pytest.raises(UserError, match="of another scene and another camera"):
        tracing.Keeper(keeper.path, tasks[1].facts(), SIZE, named=True)


def test_the_help_names_the_command_and_its_options(strata):
    code, out, _ = strata("reference", "--help")
    assert code == 0
    for word in ("--error", "--paths", "--filter", "--seed", "--sums", "--no-cache", "chapter 12"):
        assert word in out
    assert "strata reference 1" in (ROOT / "README.md").read_text("utf-8")


def test_sums_are_outputs_of_traced_pictures_alone():
    """Without paths nothing writes them, and the sentence says so."""
    more = {"size": SIZE, "outputs": {"path_sums", "color"}}
    with chapters.open(settings.TRACER, "vulkan", scene=scenes.load("cornell"), **more) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        assert frame.image("color").any()
        with pytest.raises(StaleFrameError, match="only paths are summed, with path_tracer=on"):
            frame.image("path_sums")
