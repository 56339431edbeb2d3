"""`strata run --path`: each frame is that of one renderer along the path, in films and in numbered pictures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image, ImageSequence

import chapters
from chapters import scenes
from common.images import read_image, read_layers
from common.settings import preset
from common.view.paths import Stage, path

SIZE = (64, 48)
SMALL = ("--scene", "cornell", "--size", "64x48")


def film(file) -> list[np.ndarray]:
    with Image.open(file) as found:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(found)]


def drawn(name: str, frames: int, fps: float, camera=None, time=0.0, which=1, backend="vulkan"):
    """The frames of a path without the command: one renderer, one frame for each view."""
    scene = scenes.load("cornell")
    settings = preset(chapters.settings_class(which), "medium")
    found = []
    with chapters.open(which, backend, scene=scene, size=SIZE, settings=settings) as renderer:
        start = chapters.view_of(renderer, camera, time)
        for index, view in enumerate(path(name, Stage.of(scene, start, SIZE), frames, fps)):
            found.append(renderer.render(view, time + index / fps).image("color")[..., :3].copy())
    return found


def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return len(one) == len(other) and all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_a_film_has_the_frames_of_one_renderer_along_the_path(strata, tmp_path, monkeypatch):
    opened = []
    whole = chapters.open
    monkeypatch.setattr(
        chapters, "open", lambda *words, **more: opened.append(words) or whole(*words, **more)
    )
    words = ("--path", "orbit:degrees=60", "--frames", 5, "--fps", 12, "--time", 0.5, "--camera", "overview")
    code, out, err = strata("run", 1, *SMALL, *words, "--out", "a.webp", "--json", "a.json")
    assert (
        (code, out) == (0, "") and err.endswith("wrote a.webp, 12 frames a second\n") and err.count("\n") == 1
    )
    assert len(opened) == 1
    expected = drawn("orbit:degrees=60", 5, 12.0, "overview", 0.5)
    assert same(film(tmp_path / "a.webp"), expected)
    assert all((one != other).any() for one, other in zip(expected[1:], expected[:-1], strict=True))
    record = json.loads((tmp_path / "a.json").read_text())
    assert (record["path"], record["fps"], record["pictures"]) == ("orbit:degrees=60", 12.0, ["a.webp"])
    assert [frame["index"] for frame in record["frames"]] == [0, 1, 2, 3, 4]
    assert [frame["reset"] for frame in record["frames"]] == ["first frame", "", "", "", ""]


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_the_newest_chapter_records_a_walk(strata, tmp_path, gl_context, backend):
    words = ("--path", "walk:speed=0.5", "--frames", 3, "--fps", 20, "--backend", backend, "--out", "a.png")
    code, _, err = strata("run", chapters.available()[-1], *SMALL, *words)
    assert code == 0, err
    found = film(tmp_path / "a.png")
    assert len(found) == 3 and (found[0] != found[1]).any() and (found[1] != found[2]).any()


@pytest.mark.needs("glcontext")
def test_numbered_pictures_and_a_folder_have_the_same_frames(strata, tmp_path):
    (tmp_path / "all").mkdir()
    words = ("run", 1, *SMALL, "--path", "pan", "--frames", 3, "--backend", "gl")
    for out, names in (
        ("pan-%03d.png", [f"pan-{n:03d}.png" for n in range(3)]),
        ("all", [f"all/{n:04d}.png" for n in range(3)]),
        ("%d.png", ["0.png", "1.png", "2.png"]),
    ):
        code, _, err = strata(*words, "--out", out)
        assert code == 0 and f"wrote 3 pictures, {names[0]} to {names[2]}\n" in err.replace("\\", "/"), err
        found = [read_image(tmp_path / name) for name in names]
        if out == "pan-%03d.png":
            expected = found
            assert (found[0] != found[2]).any()
        assert same(found, expected)
    assert same(expected, drawn("pan", 3, 60.0, backend="gl"))


@pytest.mark.needs("OpenEXR")
def test_numbered_pictures_of_light_have_depth_too(strata, tmp_path):
    assert strata("run", 1, *SMALL, "--path", "dolly", "--frames", 2, "--out", "a%d.exr")[0] == 0
    near, far = (read_layers(tmp_path / f"a{n}.exr")["depth"].max() for n in (1, 0))
    assert near > far  # reversed depth grows as the camera comes nearer


def test_a_file_of_key_poses_says_how_many_frames_there_are(strata, tmp_path):
    keys = [
        {"time": 0, "eye": [0, 1.4, 4], "target": [0, 1, 0]},
        {"time": 0.5, "eye": [1, 1, 4], "target": [0, 1, 0]},
    ]
    (tmp_path / "keys.json").write_text(json.dumps({"keys": keys}))
    lens = ("--camera", "9,9,9:0,0,0")  # a path has the lens of its start
    code, _, err = strata("run", 1, *SMALL, *lens, "--path", "keys.json", "--fps", 8)
    assert code == 0, err
    assert err.replace("\\", "/").endswith("wrote out/ch01-cornell-keys.webp, 8 frames a second\n")
    found = film(tmp_path / "out" / "ch01-cornell-keys.webp")
    assert len(found) == 5
    for place, frame in (("0,1.4,4:0,1,0", 0), ("1,1,4:0,1,0", 4)):
        assert strata("run", 1, *SMALL, "--camera", place, "--frames", 1, "--out", "one.png")[0] == 0
        assert np.array_equal(found[frame], read_image(tmp_path / "one.png"))


def test_a_path_that_stands_still_is_the_picture_without_one(strata, tmp_path):
    words = ("run", 1, *SMALL, "--frames", 2, "--out")
    assert strata(*words, "one.png")[0] == strata(*words, "still%d.png", "--path", "still")[0] == 0
    assert np.array_equal(read_image(tmp_path / "one.png"), read_image(tmp_path / "still1.png"))


def test_a_gif_has_fifty_frames_a_second_where_no_rate_is_given(strata, tmp_path):
    """The hundredths of a second of its format hold no more; all others have sixty."""
    for name, rate, shown_ms in (("a.gif", 50, [20, 20, 20]), ("a.webp", 60, [17, 16, 17])):
        code, _, err = strata("run", 1, *SMALL, "--path", "walk:speed=5", "--frames", 3, "--out", name)
        assert code == 0 and err.endswith(f"wrote {name}, {rate} frames a second\n"), err
        with Image.open(tmp_path / name) as found:
            assert [
                frame.load() and frame.info["duration"] for frame in ImageSequence.Iterator(found)
            ] == shown_ms
        if name == "a.webp":
            assert same(film(tmp_path / name), drawn("walk:speed=5", 3, 60.0))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--path", "wlak"), "There is no path 'wlak'; did you mean 'walk'?"),
        (("--path", "walk:speed=1e9"), "speed is a number from -100 to 100"),
        (("--path", "walk.json"), "There is no file walk.json with the key poses of a path."),
        (("--path", "bad.json"), "bad.json: keys[1].time is 0, but the key before is at 1"),
        (("--path", "walk", "--frames", 0), "--frames 0 draws nothing: it must be at least 1."),
        (("--path", "walk", "--fps", 0), "--fps 0.0 is no rate"),
        (("--path", "walk", "--frames", 9, "--fps", "1e-9"), "With --frames and --fps the last --time"),
        (
            ("--path", "walk", "--out", "a.jpg"),
            "--out a.jpg is no animation: name .webp, .gif, .png, a folder",
        ),
        (
            ("--path", "walk", "--out", "a.jpg"),
            "a folder, or numbered pictures (.png or .exr), such as a-%04d.png.",
        ),
        (("--path", "walk", "--out", "a.exr"), "--out a.exr is no animation"),
        (("--path", "walk", "--out", "a.exr"), "numbered pictures (.png or .exr), such as a-%04d.exr."),
        (("--path", "walk", "--out", "a"), "--out a: there is no such folder for numbered pictures"),
        (("--path", "walk", "--out", "a/b/"), ".webp, .gif, .png: create the folder, or name such a file."),
        (
            ("--path", "pan:"),
            "--path pan: has no value behind the colon: name a value of the path, such as pan:pixels=2",
        ),
        (("--path", "still: ,"), "the path has none: leave the colon out."),
        (("--path", "walk", "--out", "x/a.webp"), "there is no folder x"),
        (("--path", "walk", "--out", "x/%d.png"), "there is no folder x"),
        (("--path", "walk", "--out", "%d-%d.png"), "--out %d-%d.png has more than one number"),
        (("--path", "walk", "--out", "%d.jpg"), ".png or .exr"),
        (("--path", "walk", "--out", "a.gif", "--fps", 60), "a.gif cannot show 60 frames a second"),
        (("--path", "walk", "--frames", 10**8), "walk.webp would be too large with 100000000 frames"),
        (("--path", "walk", "--frames", 10**8, "--out", "%d.png"), "100000000 frames are too many pictures"),
        (("--path", "walk", "--size", "16384x16"), "a side has at most 16383 pixels"),
        (("--path", "walk", "--watch"), "--watch writes one picture, and --path many"),
        (("--path", "walk", "--out", "a.webp", "--json", "a.webp"), "--out and --json both name a.webp"),
        (("--path", "walk", "--camera", "nose"), "no camera 'nose'"),
        (("--out", "a.webp"), "--out a.webp is an animation: say what moves, such as --path walk."),
    ],
)
def test_a_wrong_word_is_one_sentence_and_leaves_no_file(strata, tmp_path, words, says):
    pose = {"eye": [1, 2, 3], "target": [0, 0, 0]}
    (tmp_path / "bad.json").write_text(json.dumps({"keys": [{"time": 1, **pose}, {"time": 0, **pose}]}))
    code, out, err = strata("run", 1, "--scene", "cornell", *words)
    assert code == 2 and out == ""
    assert err.startswith("strata: ") and says in err and err.count("\n") == 1, err
    assert [one.name for one in tmp_path.iterdir()] == ["bad.json"]
