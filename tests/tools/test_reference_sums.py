"""What `strata reference` does without a device: sums of paths, their files, hashes of scenes, and settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters import scenes
from common.environment import constant
from common.environment.medium import Medium
from common.errors import SettingError, UserError
from common.scene import Image, Material
from common.settings import flat, knobs, preset, replaced
from tests.support.scenes import quad_scene
from tools.reference import contents, settings, tracing
from tools.reference.sums import (
    MOST_OF_BLOCK,
    MOST_OF_PIXEL,
    Sums,
    block_after,
    is_judged,
    read_sums,
    write_sums,
)

SIZE = (3, 2)
FACTS = {"scene": "a", "size": "3x2", "setting": "{}"}


def sums(paths=4, seed=0):
    """Return sums whose pixels have lost one path."""
    random = np.random.default_rng(seed)
    light = random.uniform(1, 9, (2, 3, 4)).astype(np.float32)
    light[..., 3] = paths - 1
    squares = random.uniform(100, 900, (2, 3, 4)).astype(np.float32)
    squares[..., 1] = 1
    return Sums.none_of(SIZE).plus(light, squares, paths, "a device")


# --- sums ---


@pytest.mark.parametrize("pixels", [1, 192, 640 * 360, 1920 * 1080, 1 << 26])
def test_blocks_are_small_at_first_and_meet_each_number_at_which_errors_are_judged(pixels):
    """Walks to 2^16 paths: each block has a power of two, at most a sixteenth of what was, and fits."""
    paths, judged = 0, []
    while paths < 1 << 16:
        count = block_after(paths, pixels)
        assert count & (count - 1) == 0
        assert count == 1 or (count <= paths / 16 and count <= MOST_OF_PIXEL)
        assert count == 1 or count * pixels <= MOST_OF_BLOCK
        assert count >= min(paths // 32, MOST_OF_PIXEL, MOST_OF_BLOCK // pixels // 2)
        paths += count
        judged += [paths] * is_judged(paths)
    assert judged == [n << k for k in range(1, 12) for n in range(16, 32)] + [1 << 16]


def test_sums_do_not_stall_where_floats_of_32_bits_would():
    """Path 2^24 + 1 is counted and adds its light."""
    one, none = np.ones((1, 1, 4), np.float32), np.zeros((1, 1, 4), np.float32)
    many = Sums.none_of((1, 1))
    for _ in range(1 << 12):
        many = many.plus(one * MOST_OF_PIXEL, one * MOST_OF_PIXEL - one * (0, 4096, 0, 0), MOST_OF_PIXEL, "")
    assert many.paths == 1 << 24 and np.float32(many.light[0, 0, 0]) + np.float32(1) == many.light[0, 0, 0]
    more = many.plus(one, none, 1, "")
    assert more.light[0, 0].tolist() == [(1 << 24) + 1] * 4 and more.paths == (1 << 24) + 1
    assert many.light[0, 0, 0] == 1 << 24  # sums are never written to


def test_the_error_is_that_of_the_mean_of_samples():
    """Samples by lot: mean and standard error by numpy, relative to the light or, where it is dark, to 1 % of white."""
    random = np.random.default_rng(5)
    samples = random.gamma(2.0, [[[[3.0]], [[0.001]]]], (50, 1, 2, 1, 1))[..., 0] * np.ones(3)
    light = np.concatenate([samples.sum(axis=0), np.full((1, 2, 1), 50.0)], axis=-1)
    squares = np.concatenate([(samples**2).sum(axis=0)[..., :1], np.zeros((1, 2, 1))], axis=-1)
    found = Sums(light, squares, 50)
    mean, error = samples.mean(axis=0)[..., 0], samples.std(axis=0, ddof=1)[..., 0] / np.sqrt(50)
    relative = error / np.hypot(mean, [[0.02, 0.02]])
    assert np.allclose(np.sqrt(found.squared_errors(0.5)), relative, rtol=1e-6)
    assert found.error(0.5) == pytest.approx(np.sqrt((relative**2).mean()), rel=1e-6)
    assert np.allclose(found.picture[..., 0], mean, rtol=1e-6) and found.picture.dtype == np.float32
    assert Sums.none_of(SIZE).error(0.5) == 1.0 and not Sums.none_of(SIZE).picture.any()


def test_devices_are_named_once_each():
    zero = np.zeros((2, 3, 4), np.float32)
    found = sums().plus(zero, zero, 0, "another").plus(zero, zero, 0, "a device")
    assert found.devices == ("a device", "another") and found.left_out == 6


# --- files ---


def test_sums_come_back_from_their_file_bit_for_bit(tmp_path):
    path, written = tmp_path / "a.npz", sums()
    write_sums(path, written, FACTS)
    found = read_sums(path, FACTS, SIZE)
    assert found.light.tobytes() == written.light.tobytes()
    assert found.squares.tobytes() == written.squares.tobytes()
    assert (found.paths, found.devices) == (4, ("a device",))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"scene": "b"}, "(of another scene)"),
        ({"size": "8x8", "setting": "{1}"}, "(of another size and another setting)"),
    ],
)
def test_sums_of_another_picture_are_refused_with_what_differs(tmp_path, changed, says):
    write_sums(tmp_path / "a.npz", sums(), FACTS | changed)
    with pytest.raises(UserError, match="holds the sums of another picture") as error:
        read_sums(tmp_path / "a.npz", FACTS, SIZE)
    assert says in str(error.value)


def damaged(name, data, path):
    """Return what is wrong in the way of that name with the file that `data` was written to."""
    broken = sums()
    light = broken.light.copy()
    if name == "cut":
        return data[: len(data) // 2]
    if name == "flipped":  # a byte of the sums: the checksum of the archive is another one
        return data[:300] + bytes([data[300] ^ 1]) + data[301:]
    if name in ("empty", "text", "npy"):
        return {"empty": b"", "text": b"no sums", "npy": b"\x93NUMPY\1\0"}[name]
    if name == "nan":
        light[0, 0, 0] = np.nan
    if name == "count":
        light[0, 0, 3] += 1
    if name == "small":
        light = light[:1]
    if name == "float32":
        light = light.astype(np.float32)
    if name == "large":
        light = np.zeros((200, 300, 4))
    write_sums(path, replace(broken, light=light, paths=0 if name == "none" else 4), FACTS)
    return path.read_bytes()


DAMAGED = ("cut", "flipped", "empty", "text", "npy", "nan", "count", "small", "float32", "large", "none")


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_file_is_refused_where_it_is_named_and_ignored_in_the_cache(tmp_path, name):
    path = tmp_path / "a.npz"
    write_sums(path, sums(), FACTS)
    path.write_bytes(damaged(name, path.read_bytes(), path))
    with pytest.raises(UserError, match="holds no sums of paths: it is damaged, or of another kind"):
        read_sums(path, FACTS, SIZE)
    with pytest.raises(UserError):
        tracing.Keeper(path, FACTS, SIZE, named=True)
    keeper = tracing.Keeper(path, FACTS, SIZE)
    assert keeper.sums.paths == 0
    keeper.sums = sums(8)
    assert keeper.keep() and keeper.is_kept and read_sums(path, FACTS, SIZE).paths == 8


def test_an_array_of_objects_is_not_unpacked(tmp_path):
    """Pickles run code; a file of sums has none."""
    np.savez(tmp_path / "a.npz", light=np.array([{}]), squares=np.zeros(1), told=np.array([{}]))
    with pytest.raises(UserError, match="damaged"):
        read_sums(tmp_path / "a.npz", FACTS, SIZE)


# --- contents ---


def changed_scenes():
    """Return scenes that differ from the first one in one thing each."""
    pixels = np.full((2, 2, 4), 7, np.uint8)
    scene = replace(quad_scene(Material()), images=[Image("a", pixels)], environment=constant(1.0))
    yield scene
    yield replace(scene, materials=[replace(scene.materials[0], roughness=0.5)])
    yield replace(scene, positions=scene.positions * np.float32(1.5))
    yield replace(scene, images=[Image("a", pixels + np.uint8(1))])
    yield replace(scene, images=[Image("a", pixels.reshape(1, 4, 4))])
    yield replace(scene, environment=constant(2.0))
    yield replace(scene, medium=Medium(0.5))
    yield replace(scene, instances=replace(scene.instances, visible=~scene.instances.visible))
    yield replace(scene, nodes=replace(scene.nodes, matrix=scene.nodes.matrix * 2))


def test_a_scene_that_looks_different_has_another_hash():
    hashes = [contents.scene_hash(scene) for scene in changed_scenes()]
    assert len({*hashes}) == len(hashes) == 9


def test_names_exposure_and_cameras_change_no_hash():
    scene = next(changed_scenes())
    same = replace(
        scene,
        name="other",
        ev100=3.0,
        cameras=[],
        materials=[replace(scene.materials[0], name="b")],
        images=[Image("b", scene.images[0].pixels)],
    )
    assert contents.scene_hash(same) == contents.scene_hash(scene)
    assert contents.scene_hash(scenes.load("cornell")) == contents.scene_hash(scenes.load("cornell"))


def test_facts_follow_all_that_a_path_depends_on(monkeypatch):
    scene = next(changed_scenes())
    chosen = settings.tracer_settings(preset(chapters.settings_class(1), "reference"), "box", 0)
    task = tracing.task_of(chosen, scene, None, SIZE, 0.0, "vulkan")
    plain = task.facts()
    view = replace(task.view, ev100=task.view.ev100 + 1)
    for name, other in {
        "scene": replace(task, scene=[*changed_scenes()][1]),
        "camera": replace(task, view=view),
        "time": replace(task, time=1.0),
        "size": replace(task, size=(4, 2)),
        "setting": replace(task, settings=replaced(chosen, path_bounces=3)),
        "backend": replace(task, backend="gl"),
    }.items():
        assert [key for key, value in other.facts().items() if value != plain[key]] == [name]
    assert replace(task, settings=replaced(chosen, path_samples=9, taa="full")).facts() == plain
    text = contents.included
    monkeypatch.setattr(contents, "included", lambda *words: {*list(text(*words))[1:]})
    assert task.facts()["version of the path tracer"] != plain["version of the path tracer"]


def test_the_shaders_of_the_tracer_are_found_with_what_they_include(tmp_path):
    for name, text in {
        "a/main.comp": '#include "beside.glsl"\n  #include "far.glsl"\n// #include "no.glsl"\n#include "made.glsl"\n',
        "a/beside.glsl": '#include "main.comp"\n',
        "b/far.glsl": "",
        "b/beside.glsl": "",
        "b/no.glsl": "",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = contents.included([tmp_path / "a/main.comp"], (tmp_path / "b",))
    assert sorted(path.relative_to(tmp_path).as_posix() for path in found) == [
        "a/beside.glsl",
        "a/main.comp",
        "b/far.glsl",
    ]
    chapter = chapters.folder_of(settings.TRACER)
    real = contents.included([chapter / "paths/paths.comp"], (chapter, chapters.FOLDER.parent / "shaders"))
    assert {"lights.glsl", "bsdf.glsl", "pcg.glsl", "trace.glsl"} <= {path.name for path in real}


# --- settings ---


def test_each_knob_of_the_command_is_one_of_the_tracer():
    known = knobs(chapters.settings_class(settings.TRACER))
    named = (*settings.OF_LIGHT, *settings.OF_TABLES, *settings.OF_PATHS, *settings.OPTIONS)
    assert not {*named, *settings.BY_ITSELF} - known.keys()
    of_paths = {name for name in known if name.startswith("path_")}
    assert of_paths <= {*settings.OF_PATHS, *settings.OPTIONS, *settings.BY_ITSELF}


def test_light_is_as_the_chapter_has_it_and_paths_are_as_the_user_has_them():
    own, of_paths = settings.chapter_settings(1, ["background=0.5", "ambient=3", "path-bounces=2"])
    chosen = flat(settings.tracer_settings(own, "centre", 7, of_paths))
    assert (chosen["background"], chosen["ambient"], chosen["path_bounces"]) == (0.5, 3.0, 2)
    assert (chosen["path_filter"], chosen["path_seed"], chosen["path_tracer"]) == ("centre", 7, True)
    assert not chosen["path_average"] and chosen["path_error"] == 0.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("path_error=0.1", "setting path_error is given by --error"),
        ("path-seed=1", "setting path_seed is given by --seed"),
        ("path_samples=2", "setting path_samples is the command's own"),
        ("msaa=4", "Chapter 1 draws otherwise with setting msaa"),
        ("amibent=1", "did you mean 'ambient'?"),
        ("ambient", "has no value"),
    ],
)
def test_a_setting_that_changes_nothing_is_refused(text, says):
    with pytest.raises(SettingError) as error:
        settings.chapter_settings(1, [text])
    assert says in str(error.value)


def test_a_value_that_a_knob_of_paths_does_not_take_is_refused():
    own, of_paths = settings.chapter_settings(1, ["path_bounces=many"])
    with pytest.raises(SettingError, match="must be a whole number"):
        settings.tracer_settings(own, "box", 0, of_paths)


def test_scenes_of_nothing_are_refused():
    scene = quad_scene(Material())
    chosen = settings.tracer_settings(preset(chapters.settings_class(1), "reference"), "box", 0)
    nothing = replace(scene, indices=scene.indices[:0])
    with pytest.raises(UserError, match="has no triangles"):
        tracing.task_of(chosen, nothing, None, SIZE, 0.0, "vulkan")
