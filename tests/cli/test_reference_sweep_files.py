"""Files of sweeps: what references follow from them, and what is wrong with them in one sentence."""

from __future__ import annotations

import pytest

import chapters
from tools.reference.sweep import file

pytestmark = pytest.mark.feature("path-tracer/accumulation")

FINE = 'chapter = 1\nscene = "cornell"\nformat = "npy"\n'


def read(tmp_path, text):
    (tmp_path / "s.toml").write_text(text)
    return file.read(tmp_path / "s.toml")


def test_there_is_a_reference_for_each_combination_and_tables_change_what_is_before_them(tmp_path):
    text = """
    chapter = 3
    scene = ["cornell", "spheres"]
    seed = [0, 1]
    size = "32x24"

    [[reference]]
    error = [0.1, 0.05]

    [[reference]]
    scene = "models/my scene.glb"
    chapter = "ch12"
    seed = 5
    ev = 3
    camera = ["", "top"]
    settings = {path_bounces = 2, fog = true}

    [[reference]]
    name = "one"
    scene = "quads"
    seed = 9
    """
    found = read(tmp_path, text)
    requests = [file.request_of(found, entry, tmp_path / "out") for entry in found.entries]
    asked = [(r.chapter, r.scene, r.seed, r.error, r.camera) for r in requests]
    assert asked == [
        *(
            (3, scene, seed, e, None)
            for scene in ("cornell", "spheres")
            for seed in (0, 1)
            for e in (0.1, 0.05)
        ),
        (12, "models/my scene.glb", 5, 0.01, None),
        (12, "models/my scene.glb", 5, 0.01, "top"),
        (3, "quads", 9, 0.01, None),
    ]
    assert {r.size for r in requests} == {(32, 24)} and requests[8].overrides == (
        "path_bounces=2",
        "fog=true",
    )
    assert (requests[8].ev100, requests[0].ev100) == (3.0, None)
    names = [r.out.relative_to(tmp_path / "out").as_posix() for r in requests]
    assert names[1] == "ch03-cornell-seed-0-error-0.05.exr" and names[10] == "one.exr"
    assert names[9] == "ch12-my-scene-camera-top-ev-3-seed-5-settings-path_bounces-2-fog-True.exr"
    assert found.counts() == ("2 chapters, 4 scenes, 3 cameras, 2 evs, 4 seeds, 2 settings, 3 errors")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("chapter = ", "s.toml is no TOML: Invalid value"),
        ('scene = "cornell"', "s.toml: chapter is missing"),
        ("chapter = 1", "s.toml: scene is missing"),
        (
            FINE + "[[reference]]\nscenes = 1",
            "s.toml: [[reference]] 1: there is no key 'scenes'; did you mean",
        ),
        (FINE + "sed = 1", "s.toml: there is no key 'sed'"),
        (FINE + "seed = []", "s.toml: seed is an empty list"),
        (FINE + "reference = []", "s.toml asks for no reference"),
        (FINE + "reference = 1", "s.toml: reference must be tables"),
        (FINE + "[reference]\nseed = 1", "s.toml: reference must be tables"),
        (FINE + 'seed = "1"', 's.toml: seed = "1" is wrong: write a whole number'),
        (FINE + "seed = true", "s.toml: seed = true is wrong: write a whole number"),
        (FINE + "seed = [0, [1]]", "s.toml: seed = [1] is wrong"),
        (FINE + "error = nan", "s.toml: error = NaN is wrong: write a number"),
        (FINE + "settings = 3", "s.toml: settings = 3 is wrong: write a table such as {path_bounces = 2}"),
        (FINE + "size = 320", 's.toml: size = 320 is wrong: write a size such as "640x360"'),
        (FINE + 'size = "big"', "s.toml: size 'big' is no size"),
        (FINE + "error = 2", "s.toml: ch01-cornell: error 2 is no relative error"),
        (FINE + "paths = 0", "s.toml: ch01-cornell: paths 0 is no number of paths"),
        (FINE + 'filter = "gauss"', "s.toml: ch01-cornell: There is no filter 'gauss'"),
        (FINE + 'camera = "nowhere"', "s.toml: ch01-cornell: scene 'cornell' has no camera 'nowhere'"),
        (FINE + "time = -1e300", "s.toml: ch01-cornell: time"),
        (FINE + "ev = 99", "s.toml: ch01-cornell: ev 99.0 is no exposure"),
        (FINE + "settings = {msaa = 4}", "Chapter 1 draws otherwise with setting msaa"),
        (FINE + "settings = {path_bounces = 1.5}", "setting path_bounces must be a whole number"),
        (FINE + "settings = {path_seed = 1}", "setting path_seed is given by seed"),
        ('chapter = 99\nscene = "cornell"', "s.toml: chapter = 99: There is no chapter 99"),
        ('chapter = "1/first-triangle"\nscene = "cornell"', "is a study"),
        ('chapter = 1\nscene = "cornel"\nformat = "npy"', "s.toml: ch01-cornel: There is no scene"),
        ('chapter = 1\nscene = "gone.glb"\nformat = "npy"', "There is no file gone.glb"),
        ('chapter = 1\nscene = "cornell"\nformat = "jpg"', 's.toml: format = "jpg" is none of exr, png, npy'),
        (FINE + "seed = [1, 1]", "s.toml: two references would be written to ch01-cornell"),
        (FINE + "[[reference]]\n[[reference]]", "[[reference]] 1: chapter = 1, scene = "),
        (
            FINE + '[[reference]]\nname = "A"\n[[reference]]\nname = "a"\nseed = 2',
            "would be written to a: [[reference]] 1: chapter",
        ),
        (FINE + '[[reference]]\nname = "../a"', 'name = "../a" is no name of files'),
        (FINE + 'name = "a"\n[[reference]]', "s.toml: name before the first [[reference]]"),
        (FINE + f"seed = {[*range(200)]}\nerror = {[0.1] * 100}", "there would be 20000 references"),
        ("#" * (1 << 20 | 1), "s.toml is no sweep: it has more than"),
        ("a = " + "[" * 5000 + "]" * 5000, "s.toml is no TOML"),
    ],
)
def test_a_wrong_file_is_one_sentence_and_nothing_is_opened(strata, tmp_path, monkeypatch, text, says):
    def opened(*words, **options):
        raise AssertionError("a renderer is opened")

    monkeypatch.setattr(chapters, "open", opened)
    (tmp_path / "s.toml").write_text(text)
    code, out, err = strata("reference", "--sweep", "s.toml", "--workers", 0, "--out", "a")
    assert (code, out) == (2, "")
    assert says in err and err.startswith("strata: ") and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["s.toml"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--sweep", "gone.toml"), "gone.toml cannot be read: No such file or directory"),
        (("--sweep", "."), ". cannot be read"),
        (("1", "--sweep", "s.toml"), "--sweep s.toml says itself what is traced: leave out 1"),
        (("--sweep", "s.toml", "--scene", "cornell"), "leave out --scene"),
        (("--sweep", "s.toml", "--set", "path_bounces=1", "--filter", "box"), "leave out --filter and --set"),
        (("--sweep", "s.toml", "--workers", "-1"), "--workers -1 is no number of workers"),
        (("--sweep", "s.toml", "--workers", "1000"), "--workers 1000 is no number of workers"),
        (("--sweep", "s.toml", "--workers", "1", "--cluster", "tcp://a:1"), "leave out --workers"),
        (("--sweep", "s.toml", "--cluster", "10.0.0.1"), "--cluster '10.0.0.1' is no address"),
        (("--sweep", "s.toml", "--cluster", "tcp://a:99999"), "--cluster 'tcp://a:99999' is no address"),
        (("--sweep", "s.toml", "--out", "x/y"), "--out x/y is no folder"),
        (("--sweep", "s.toml", "--out", "s.toml"), "--out s.toml is no folder"),
        (("--sweep", "s.toml", "--backend", "metal"), "metal"),
        (("1", "--workers", "2"), "Workers trace sweeps alone, of --sweep FILE: leave out --workers"),
        (
            (),
            "Name the chapter whose scene is traced, as `strata reference 1`, or a file of many: --sweep FILE",
        ),
    ],
)
def test_wrong_options_are_one_sentence(strata, tmp_path, words, says):
    (tmp_path / "s.toml").write_text(FINE)
    code, out, err = strata("reference", *words)
    assert (code, out) == (2, "")
    assert says in err and err.startswith("strata: ") and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["s.toml"]
