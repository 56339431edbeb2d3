"""Converted textures: sizes, alpha, means against slow loops, runs that change nothing, repaired names."""

from __future__ import annotations

import os
import unicodedata
import warnings
import zlib
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

from common.errors import UserError
from common.files.file_repair import Finder, as_typed
from common.materials import convert as texture_convert
from common.materials.convert import PLACEHOLDERS, TextureRequest, convert_textures, pictures_in, resized
from common.materials.importer import SourceMaterial, import_materials
from common.materials.textures import convert_materials

offline = pytest.mark.feature("textures/offline-conversion")
RNG = np.random.default_rng(11)


def picture(path, shape, values=None) -> np.ndarray:
    """Write a picture of noise, or of `values`, and return its pixels."""
    pixels = (
        RNG.integers(0, 256, shape, np.uint8) if values is None else np.broadcast_to(np.uint8(values), shape)
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(pixels)).save(path)
    return pixels


def one(request: TextureRequest, folder, out, **more):
    """Convert one texture; return what became of it and the pixels of its file."""
    done = convert_textures([request], folder, out, **more)[request]
    with Image.open(out / done.file) as read:
        assert read.format == "PNG" and read.mode == "RGBA" and read.size == done.size
        return done, np.asarray(read)


@offline
@pytest.mark.parametrize(
    ("width", "height"), [(512, 512), (513, 511), (1024, 16), (3, 700), (1, 1), (512, 1030)]
)
def test_each_axis_has_at_most_512_texels(tmp_path, width, height):
    picture(tmp_path / "a.png", (height, width, 3))
    done, pixels = one(TextureRequest("a.png"), tmp_path, tmp_path / "out")
    assert done.size == (min(width, 512), min(height, 512)) and done.written and not done.note
    assert pixels.shape == (min(height, 512), min(width, 512), 4) and (pixels[..., 3] == 255).all()
    small, _ = one(TextureRequest("a.png"), tmp_path, tmp_path / "small", most=7)
    assert small.size == (min(width, 7), min(height, 7))


@offline
@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "1", "LA", "I;16", "CMYK", "tga", "jpg"])
def test_every_kind_of_picture_becomes_rgba_of_8_bits(tmp_path, mode):
    """Small ones keep every bit; 16 bits of grey are rounded to the nearest of 8."""
    pixels = RNG.integers(0, 256, (5, 4, 4), np.uint8)
    source = Image.fromarray(pixels)
    name = "a.tif" if mode == "CMYK" else "a.png"
    if mode == "I;16":
        codes = RNG.integers(0, 65536, (5, 4), np.uint16)
        source = Image.fromarray(codes)
        truth = np.full((5, 4, 4), 255, np.uint8)
        truth[..., :3] = np.array([[int(code / 257 + 0.5) for code in row] for row in codes.tolist()])[
            ..., None
        ]
    elif mode in ("tga", "jpg"):
        name = f"a.{mode}"
        source = source.convert("RGB")
        truth = np.dstack([pixels[..., :3], np.full((5, 4), 255, np.uint8)])
    else:
        source = source.convert("RGB").convert(mode) if mode in ("P", "CMYK") else source.convert(mode)
        truth = np.asarray(source.convert("RGBA"))
    source.save(tmp_path / name)
    if mode == "jpg":
        truth = np.asarray(Image.open(tmp_path / name).convert("RGBA"))
    _, found = one(TextureRequest(name), tmp_path, tmp_path / "out")
    assert np.array_equal(found, truth)


@offline
def test_alpha_is_the_map_of_opacity(tmp_path):
    albedo = picture(tmp_path / "a.png", (300, 200, 4))
    mask = picture(tmp_path / "mask.png", (300, 200))
    _, found = one(TextureRequest("a.png", "mask.png"), tmp_path, tmp_path / "out")
    assert np.array_equal(found[..., 3], mask) and np.array_equal(found[..., :3], albedo[..., :3])
    grey = np.repeat(mask[..., None], 3, axis=2)
    picture(tmp_path / "grey.png", grey.shape, grey)
    assert np.array_equal(one(TextureRequest("a.png", "grey.png"), tmp_path, tmp_path / "out")[1], found)
    with_alpha = np.dstack([grey // 2, mask])
    picture(tmp_path / "alpha.png", with_alpha.shape, with_alpha)
    assert np.array_equal(one(TextureRequest("a.png", "alpha.png"), tmp_path, tmp_path / "out")[1], found)
    _, own = one(TextureRequest("a.png"), tmp_path, tmp_path / "out")
    assert np.array_equal(own, albedo) and not np.array_equal(own, found)
    _, alone = one(TextureRequest("", "mask.png"), tmp_path, tmp_path / "out")
    assert np.array_equal(alone[..., 3], mask) and (alone[..., :3] == 255).all()


@offline
def test_a_map_of_another_size_loses_nothing(tmp_path):
    """Neither the finer mask nor the finer colour: of each axis the larger number of texels is kept, up to the most."""
    picture(tmp_path / "flat.png", (2, 2, 3), (10, 20, 30))
    fine = picture(tmp_path / "fine.png", (600, 40))
    done, found = one(TextureRequest("flat.png", "fine.png"), tmp_path, tmp_path / "out")
    assert done.size == (40, 512) and (found[..., :3] == (10, 20, 30)).all()
    _, scaled = one(TextureRequest("fine.png", kind="data"), tmp_path, tmp_path / "out")
    assert np.array_equal(found[..., 3], scaled[..., 0])
    albedo = picture(tmp_path / "albedo.png", (4, 8, 3))
    picture(tmp_path / "coarse.png", (1, 2), [[0, 200]])
    _, found = one(TextureRequest("albedo.png", "coarse.png"), tmp_path, tmp_path / "out")
    assert np.array_equal(found[..., :3], albedo)
    # Between the middles of two texels, of which each covers four: at -3/8, -1/8 ... of the way from one to the other.
    way = np.clip((np.arange(8) + 0.5) / 4 - 0.5, 0, 1) * 200
    assert np.array_equal(found[..., 3], np.tile(np.rint(way), (4, 1)))
    assert (fine != 0).any()


def mean_of_area(codes, count, light):
    """The mean over the area of each new texel by exact fractions, texel by texel, along the first axis."""
    source, means = len(codes), []
    for new in range(count):
        begin, end = Fraction(new * source, count), Fraction((new + 1) * source, count)
        total = 0.0
        for texel in range(source):
            covered = min(end, Fraction(texel + 1)) - max(begin, Fraction(texel))
            if covered > 0:
                total += float(covered / (end - begin)) * light(codes[texel])
        means.append(total)
    return means


@offline
@pytest.mark.parametrize("kind", ["color", "emissive", "data", "normal"])
def test_means_are_those_of_slow_loops_of_light_or_of_codes(tmp_path, kind):
    pixels = picture(tmp_path / "a.png", (7, 11, 4))
    _, found = one(TextureRequest("a.png", kind=kind), tmp_path, tmp_path / "out", most=4)
    coded = kind in ("color", "emissive")

    def light(code):
        c = code / 255
        return (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4) if coded else c

    def code(value):
        return 255 * (
            (value * 12.92 if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055) if coded else value
        )

    for channel in range(4):
        one_channel = pixels[..., channel].tolist()
        to, back = (light, code) if channel < 3 else (lambda c: c / 255, lambda v: 255 * v)
        rows = [mean_of_area(row, 4, to) for row in one_channel]
        columns = [mean_of_area(list(column), 4, lambda value: value) for column in zip(*rows, strict=True)]
        truth = np.array([[back(value) for value in column] for column in columns]).T
        assert np.abs(found[..., channel] - truth).max() <= 0.5 + 1e-3


def test_large_pictures_are_filtered_in_bands_like_small_ones():
    pixels = RNG.integers(0, 256, (600, 90, 1), np.uint8)
    whole = resized(pixels, (30, 200), srgb=False)[..., 0]
    truth = pixels[..., 0].reshape(200, 3, 30, 3).mean(axis=(1, 3))
    assert np.abs(whole - truth).max() <= 0.5 + 1e-6
    same = resized(pixels, (90, 600), srgb=True)
    assert np.array_equal(same, pixels) and not np.shares_memory(same, pixels)


def stamped(folder):
    return {
        path.name: (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_ino)
        for path in folder.iterdir()
    }


REQUESTS = [
    TextureRequest("a.png"),
    TextureRequest("a.png", "mask.png"),
    TextureRequest("absent.png", kind="normal"),
    TextureRequest("a.png", "absent.png"),
    TextureRequest("broken.png"),
]


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "in"
    picture(home / "a.png", (40, 30, 3))
    picture(home / "mask.png", (40, 30))
    (home / "broken.png").write_bytes((home / "a.png").read_bytes()[:200])
    return home


@offline
def test_a_second_run_changes_nothing(tmp_path, folder):
    out = tmp_path / "out"
    first = convert_textures(REQUESTS, folder, out)
    before = stamped(out)
    assert len(before) == 5 and all(one.written for one in first.values())
    again = convert_textures([*REQUESTS, *REQUESTS], folder, out)
    assert stamped(out) == before and not any(one.written for one in again.values())
    assert [(one.file, one.size, one.placeholder, one.note) for one in first.values()] == [
        (one.file, one.size, one.placeholder, one.note) for one in again.values()
    ]
    # Elsewhere, and from a copy elsewhere, it makes the same bytes: nothing of the machine is in them.
    os.rename(folder, tmp_path / "moved")
    convert_textures(REQUESTS, tmp_path / "moved", tmp_path / "out2")
    assert {name: one[0] for name, one in stamped(tmp_path / "out2").items()} == {
        name: one[0] for name, one in before.items()
    }


@offline
def test_what_changed_is_made_again_and_nothing_else(tmp_path, folder):
    out = tmp_path / "out"
    done = convert_textures(REQUESTS, folder, out)

    def written(**more):
        again = convert_textures(REQUESTS, folder, out, **more)
        return [request for request in REQUESTS if again[request].written]

    picture(folder / "mask.png", (40, 30))
    assert written() == [REQUESTS[1]]
    picture(folder / "absent.png", (2, 2, 3))
    assert written() == REQUESTS[2:4] and written() == []
    assert not convert_textures(REQUESTS, folder, out)[REQUESTS[2]].placeholder
    (folder / "absent.png").unlink()
    assert written() == REQUESTS[2:4]
    damaged = out / done[REQUESTS[0]].file
    for broken in (damaged.read_bytes()[:-20], damaged.read_bytes()[:-30] + b"x" * 30, b""):
        damaged.write_bytes(broken)
        assert written() == [REQUESTS[0]]
    assert REQUESTS[0] in written(most=8)


@offline
def test_what_is_absent_or_damaged_is_a_placeholder_with_a_note(tmp_path, folder):
    for kind, texel in PLACEHOLDERS.items():
        done, found = one(TextureRequest("no/such.png", kind=kind), folder, tmp_path / "out")
        assert done.placeholder and done.note == "no/such.png is not there."
        assert found.tolist() == [[list(texel)]]
    done, found = one(REQUESTS[4], folder, tmp_path / "out")
    assert done.placeholder and done.note == "broken.png is damaged." and found.shape == (1, 1, 4)
    (folder / "text.png").write_text("no picture")
    assert one(TextureRequest("text.png"), folder, tmp_path / "out")[0].note.endswith(
        "of no kind that can be read."
    )
    done, found = one(REQUESTS[3], folder, tmp_path / "out")
    assert done.note == "absent.png is not there." and not done.placeholder and found.shape == (40, 30, 4)
    done, found = one(TextureRequest("absent.png", "mask.png"), folder, tmp_path / "out")
    assert done.placeholder and found.shape == (40, 30, 4) and (found[..., :3] == 255).all()
    huge = folder / "huge.png"
    data = (folder / "a.png").read_bytes()
    for width, height in ((2**16, 2**16), (10_000, 9_500)):  # of the second Pillow only warns
        size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        head = data[12:16] + size + data[24:29]
        huge.write_bytes(data[:12] + head + zlib.crc32(head).to_bytes(4, "big") + b"\0\0\0\x09IDAT")
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            done, _ = one(TextureRequest("huge.png"), folder, tmp_path / "out")
        assert done.note == "huge.png has more pixels than the 67108864 that are converted at most."
        assert not told


@offline
@pytest.mark.parametrize(
    "name",
    [
        "textures/Wood Bark.PNG",
        "Textures/Wood Bark.PNG",
        "TEXTURES/wood bark.png",
        "textures\\WOOD BARK.png",
        "./textures//wood bark.Png",
        "gone/../textures/wood bark.png",
    ],
)
def test_a_name_in_other_letters_finds_its_file(tmp_path, name):
    pixels = picture(tmp_path / "in" / "Textures" / "Wood Bark.png", (3, 2, 4))
    (tmp_path / "in" / "textures").mkdir(exist_ok=True)  # a folder of exactly that name, without the file
    done, found = one(TextureRequest(name), tmp_path / "in", tmp_path / "out")
    assert not done.placeholder and not done.note and np.array_equal(found, pixels)


@offline
@pytest.mark.parametrize(
    "name",
    [
        "../secret.png",
        "a/../../secret.png",
        "/secret.png",
        "C:\\secret.png",
        "link.png",
        "up/secret.png",
        "\0",
    ],
)
def test_nothing_outside_the_folder_is_read(tmp_path, name):
    secret = picture(tmp_path / "secret.png", (3, 2, 4))
    home = tmp_path / "in"
    home.mkdir()
    (home / "link.png").symlink_to(tmp_path / "secret.png")
    (home / "up").symlink_to(tmp_path)
    done, found = one(TextureRequest(name), home, tmp_path / "out")
    assert done.placeholder and found.shape != secret.shape
    linked = name in ("link.png", "up/secret.png", "\0")
    assert done.note == f"{name} {'is not there' if linked else 'lies outside the folder of the sources'}."


def test_the_exact_name_comes_first_and_accents_are_one_however_they_are_composed(tmp_path):
    if os.path.exists(tmp_path.parent / tmp_path.name.upper()):
        pytest.skip("this file system does not tell large letters from small ones")
    for name in ("b.png", "B.png", unicodedata.normalize("NFD", "größe.png")):
        (tmp_path / name).write_text("")
    finder = Finder(tmp_path)
    assert [finder.find(name).name for name in ("b.png", "B.png", "B.PNG")] == ["b.png", "B.png", "B.png"]
    assert finder.find(unicodedata.normalize("NFC", "GRÖSSE.png")) is not None
    assert finder.find("") is None and finder.find("b.png/") is not None and finder.find("b.png/c") is None
    assert as_typed("a\\.//b/../c.png") == "a/c.png" and as_typed("../../a") == "../../a"


@offline
def test_no_two_outputs_have_one_name(tmp_path):
    """Also on a file system that does not tell large letters from small ones."""
    names = [
        "a/b.png",
        "a__b.png",
        "A/B.png",
        "a/b.jpg",
        "b.png",
        "../a/b.png",
        "木.png",
        "本.png",
        "\udcff.png",
    ]
    requests = [TextureRequest(n, o, k) for n in names for o in ("", "a/b.png") for k in ("color", "data")]
    outputs = [request.output for request in requests]
    assert len({output.lower() for output in outputs}) == len(requests)
    assert all(output.isascii() and "/" not in output and len(output) < 80 for output in outputs)
    assert (
        TextureRequest("a//b.png").output
        == TextureRequest(".\\a\\b.png").output
        == TextureRequest("a/b.png").output
    )
    done = convert_textures(requests, tmp_path, tmp_path / "out")
    assert len(list((tmp_path / "out").iterdir())) == len(done) == len(requests)


@offline
def test_what_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"file cannot be written: "):
        convert_textures([TextureRequest("a.png")], tmp_path, tmp_path / "file")
    with pytest.raises(UserError, match="0 texels a side are none"):
        convert_textures([], tmp_path, tmp_path / "out", most=0)


def test_rights_of_files_are_those_of_any_other_after_threads_wrote(tmp_path):
    for number in range(12):
        picture(tmp_path / f"{number}.png", (2, 2, 3))
    (tmp_path / "plain").write_text("")
    seen: list[float] = []
    requests = [TextureRequest(f"{number}.png") for number in range(12)]
    convert_textures(requests, tmp_path, tmp_path / "out", progress=lambda part, _: seen.append(part))
    rights = {path.stat().st_mode for path in (tmp_path / "out").iterdir()}
    assert rights == {(tmp_path / "plain").stat().st_mode}
    assert seen == [number / 12 for number in range(1, 13)]


@offline
def test_materials_name_what_their_textures_became(tmp_path):
    albedo = picture(tmp_path / "Leaf.png", (8, 8, 3))
    masks = [picture(tmp_path / f"mask{n}.png", (8, 8)) for n in (0, 1)]
    picture(tmp_path / "bump.png", (4, 4))
    leaf = {"diffuse": "leaf.png", "opacity": "mask0.png", "height": "bump.png"}
    sources = [
        SourceMaterial("leaf", textures=leaf),
        SourceMaterial("hole", textures={**leaf, "opacity": "mask1.png"}),
        SourceMaterial("bark", textures={"diffuse": "leaf.png", "normals": "gone.png"}),
        SourceMaterial("veil", textures={"opacity": "mask0.png"}),
    ]
    before = import_materials(sources)
    after, done = convert_materials(before, tmp_path, tmp_path / "out")
    assert len(done) == len(after.textures) == 6 and [one.note for one in done if one.note] == [
        "gone.png is not there."
    ]
    files = after.resolved()
    texels = [
        {role: np.asarray(Image.open(tmp_path / "out" / name)) for role, name in slots.items() if name}
        for slots in files
    ]
    for number in (0, 1):
        assert np.array_equal(texels[number]["albedo"], np.dstack([albedo, masks[number]]))
    assert np.array_equal(texels[2]["albedo"][..., :3], albedo) and (texels[2]["albedo"][..., 3] == 255).all()
    assert texels[2]["normal"].tolist() == [[[128, 128, 255, 255]]]
    assert np.array_equal(texels[3]["albedo"][..., 3], masks[0])
    assert files[0]["normal"] == files[1]["normal"] and not any(slots["opacity"] for slots in files)
    for name in before.records.dtype.names:
        if not name.endswith("_texture"):
            assert np.array_equal(after.records[name], before.records[name])
    assert list(pictures_in(tmp_path, tmp_path / "out")) == ["Leaf.png", "bump.png", "mask0.png", "mask1.png"]


def test_a_second_run_decodes_no_source(tmp_path, folder, monkeypatch):
    convert_textures(REQUESTS, folder, tmp_path / "out")
    monkeypatch.setattr(texture_convert, "_decoded", lambda *_: pytest.fail("a source was decoded"))
    assert not any(one.written for one in convert_textures(REQUESTS, folder, tmp_path / "out").values())


def test_without_memory_no_placeholder_is_written(tmp_path, folder, monkeypatch):
    """It would be kept: the next run finds the same sources."""
    out, before = tmp_path / "out", Image.Image.convert

    def convert(*_):
        raise MemoryError

    monkeypatch.setattr(Image.Image, "convert", convert)
    with pytest.raises(MemoryError):
        convert_textures(REQUESTS[:1], folder, out)
    assert not list(out.iterdir())
    monkeypatch.setattr(Image.Image, "convert", before)
    assert not convert_textures(REQUESTS[:1], folder, out)[REQUESTS[0]].placeholder
