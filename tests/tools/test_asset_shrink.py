"""`strata assets shrink`: pictures, folders and .mtl files become small PNGs and records that name them."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from common.materials.records import read_material_file

pytestmark = pytest.mark.feature("textures/offline-conversion")


def picture(path, shape, seed=0) -> np.ndarray:
    pixels = np.random.default_rng(seed).integers(0, 256, shape, np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)
    return pixels


def stamps(folder):
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


def test_a_folder_becomes_small_pictures_and_a_second_run_writes_none(strata, tmp_path):
    for name in ("a.png", "deep/a.png", "deep/[b].JPG"):
        picture(tmp_path / "in" / name, (20, 30, 3))
    (tmp_path / "in" / "text.txt").write_text("")
    words = ("assets", "shrink", "in", "--out", "in/small", "--most", "16")
    code, out, err = strata(*words)
    assert (code, err) == (0, "") and out.count("16 x 16") == 3 and "3 of 3 textures were written." in out
    before = stamps(tmp_path / "in" / "small")
    assert len(before) == 3
    code, out, _ = strata(*words)
    assert code == 0 and "0 of 3 textures were written." in out and "as it was" in out
    assert stamps(tmp_path / "in" / "small") == before


@pytest.mark.feature("materials/merge-lists")
def test_libraries_of_two_folders_become_one_list(strata, tmp_path):
    """Equal names in different folders are different files; a name in other letters is found, an absent one is said."""
    leaf = {name: picture(tmp_path / name / "Leaf.png", (4, 4, 3), seed) for seed, name in enumerate("ab")}
    mask = picture(tmp_path / "a" / "mask.png", (4, 4), 7)
    text = "newmtl {0}\nd 0.5\nmap_Kd leaf.png\n"
    (tmp_path / "a" / "x.mtl").write_text(text.format("one") + "map_d mask.png\nmap_Ks gone.png\n")
    (tmp_path / "b" / "x.mtl").write_text(
        text.format("two") + "norm ../a/leaf.png\nnewmtl three\nnorm C:\\n.png\n"
    )
    words = ("assets", "shrink", "a/x.mtl", "b/x.mtl", "--out", "out")
    code, out, err = strata(*words)
    assert code == 0 and "scene.materials has 3 materials." in out
    assert (
        err == "Textures of x.mtl (map_Ks) were left out.\nC:/n.png lies outside the folder of the sources.\n"
    )
    materials = read_material_file(tmp_path / "out" / "scene.materials")
    assert materials.records["opacity"].tolist() == [0.5, 0.5, 1]
    one, two, three = (
        {role: np.asarray(Image.open(tmp_path / "out" / name)) for role, name in slots.items() if name}
        for slots in materials.resolved()
    )
    assert np.array_equal(one["albedo"], np.dstack([leaf["a"], mask])) and list(one) == ["albedo"]
    assert np.array_equal(two["albedo"][..., :3], leaf["b"]) and np.array_equal(
        two["normal"][..., :3], leaf["a"]
    )
    assert three["normal"].tolist() == [[[128, 128, 255, 255]]]
    before = stamps(tmp_path / "out")
    assert strata(*words)[0] == 0 and stamps(tmp_path / "out") == before


def test_data_is_averaged_as_numbers(strata, tmp_path):
    Image.fromarray(np.uint8([[[0] * 3, [255] * 3]])).save(tmp_path / "a.png")
    found = []
    for words in ((), ("--data",)):
        folder = tmp_path / f"out{len(words)}"
        assert strata("assets", "shrink", "a.png", "--out", folder, "--most", "1", *words)[0] == 0
        found.append(np.asarray(Image.open(next(folder.iterdir())))[0, 0, 0])
    assert found == [188, 128]  # half the light of white, and half its code


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("no.png", "--out", "out"), "There is no "),
        (("text.txt", "--out", "out"), "is neither a folder nor an .mtl file nor a picture"),
        (("empty", "--out", "out"), "There is no picture in empty"),
        (("empty", "--out", "./empty/"), "empty has sources in it"),
        (("a.png", "--out", "."), ". has sources in it"),
        (("a.png", "--out", "text.txt"), "text.txt is a file"),
        (("a.png", "--out", "text.txt/out"), "cannot be written"),
        (("a.png", "--out", "out", "--most", "0"), "0 texels a side are none"),
        (("bad.mtl", "--out", "out"), "bad.mtl has no material"),
        (("a.png",), "--out"),
    ],
)
def test_what_is_wrong_is_one_sentence(strata, tmp_path, words, says):
    picture(tmp_path / "a.png", (2, 2, 3))
    (tmp_path / "empty").mkdir()
    for name in ("text.txt", "bad.mtl"):
        (tmp_path / name).write_text("")
    code, out, err = strata("assets", "shrink", *words)
    assert (code, out) == (2, "") and says in err and err.count("\n") == 1
