"""Materials of other programs: each field of the table, the names, and one meaning of opacity however it is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.errors import SceneError
from common.materials.importer import (
    SourceMaterial,
    import_materials,
    map_name,
    opacity_of,
    parse_mtl,
    read_mtl,
    words_of,
)
from common.materials.records import (
    MATERIAL_CAST_SHADOW,
    MATERIAL_HEIGHT_MAP,
    MATERIAL_RECEIVE_SHADOW,
    MATERIAL_TRANSPARENT,
    NO_TEXTURE,
    SLOTS,
    from_bytes,
    to_bytes,
)

importer = pytest.mark.feature("materials/importer")
SHADOWS = MATERIAL_CAST_SHADOW | MATERIAL_RECEIVE_SHADOW


def imported(**source: object) -> np.void:
    return import_materials([SourceMaterial(**source)]).records[0]  # type: ignore[arg-type]


@importer
@pytest.mark.parametrize(
    ("source", "field", "value"),
    [
        ({}, "emissive", (0, 0, 0, 0)),
        ({}, "albedo", (1, 1, 1, 1)),
        ({}, "roughness", (1, 1, 0, 0)),
        ({}, "metallic", 0),
        ({}, "opacity", 1),
        ({}, "alpha_test", 0),
        ({}, "flags", SHADOWS),
        # ambient and emissive are added, and each alpha is clamped in its own field
        ({"ambient": (0.25, 0, 2)}, "emissive", (0.25, 0, 2, 1)),
        ({"emissive": (1, 2, 3, 0.5)}, "emissive", (1, 2, 3, 0.5)),
        ({"ambient": (0.25, 0, 2, 1), "emissive": (1, 2, 3, 1)}, "emissive", (1.25, 2, 5, 1)),
        ({"diffuse": (0.5, 0.25, 3, 7), "emissive": (0, 0, 0, 0.5)}, "albedo", (0.5, 0.25, 3, 1)),
        ({"diffuse": (0.5, 0.25, 3, 7), "emissive": (0, 0, 0, 0.5)}, "emissive", (0, 0, 0, 0.5)),
        ({"diffuse": (0.5, 0.25, 0.125)}, "albedo", (0.5, 0.25, 0.125, 1)),
        ({"metallic": 0.75}, "metallic", 0.75),
        ({"metallic": 7}, "metallic", 1),
        ({"roughness": 0.25}, "roughness", (0.25, 0.25, 0, 0)),
        # opacity
        ({"opacity": 0.25}, "opacity", 0.25),
        ({"opacity": 0.25}, "flags", SHADOWS | MATERIAL_TRANSPARENT),
        ({"opacity": 0.25}, "alpha_test", 0),
        ({"opacity": 0.96}, "flags", SHADOWS),
        ({"transparency": (0.25, 0.75, 0.5)}, "opacity", 0.25),
        ({"transparency": (0.25, 0.75, 0.5)}, "alpha_test", 0.5),
        ({"transparency": (0, 0.04, 0)}, "opacity", 1),
        ({"transparency": (0, 0, 0)}, "alpha_test", 0),
        ({"transparency": (0.5, 0.5, 0.5), "opacity": 0.75}, "opacity", 0.75),
        ({"textures": {"opacity": "o.png"}}, "alpha_test", 0.5),
        ({"textures": {"opacity": ""}}, "alpha_test", 0),
        ({"textures": {"opacity": "o.png"}}, "opacity", 1),
        # names
        ({"name": "Glass"}, "alpha_test", 0.75),
        ({"name": "M_Green_GLASS.001"}, "opacity", 0.1),
        ({"name": "Bottle"}, "alpha_test", 0.54),
        ({"name": "wineBottles02"}, "opacity", 0.4),
        ({"name": "GlassBottle"}, "alpha_test", 0.54),
        ({"name": "BottleGlass"}, "flags", SHADOWS | MATERIAL_TRANSPARENT),
        ({"name": "Glass", "opacity": 1.0}, "opacity", 1),
        ({"name": "Glass", "opacity": 1.0}, "alpha_test", 0.75),
        ({"name": "Glass", "textures": {"opacity": "o.png"}}, "alpha_test", 0.75),
        ({"name": "fibreglass"}, "alpha_test", 0),
        ({"name": "brushedMetal"}, "metallic", 1),
        ({"name": "brushedMetal"}, "roughness", (0.1, 0.1, 0, 0)),
        ({"name": "metal", "metallic": 0.5, "roughness": 0.7}, "metallic", 0.5),
        ({"name": "metal", "metallic": 0.5, "roughness": 0.7}, "roughness", (0.7, 0.7, 0, 0)),
    ],
)
def test_each_field_is_that_of_the_table(source, field, value):
    assert imported(**source)[field].tolist() == np.float32(value).tolist()


@importer
@pytest.mark.parametrize("opacity", [-1, 0, 0.04, 0.05, 0.06, 0.5, 0.94, 0.949, 0.95, 0.951, 1, 2])
def test_opacity_grows_from_invisible_to_opaque_and_95_per_cent_are_opaque(opacity):
    """Never the other way round: what has 5 % left stays nearly invisible."""
    expected = 1.0 if opacity >= 0.95 else max(opacity, 0)
    assert opacity_of(SourceMaterial(opacity=opacity)) == expected
    assert opacity_of(SourceMaterial(opacity=float(np.float32(opacity)))) == pytest.approx(expected, abs=1e-7)
    through = 1 - min(max(opacity, 0), 1)
    assert opacity_of(SourceMaterial(transparency=(through, 0, through / 2))) == pytest.approx(expected)
    (same,), _ = parse_mtl(f"newmtl a\nd {opacity}\n")
    (turned,), _ = parse_mtl(f"newmtl a\nTr {1 - opacity!r}\n")
    assert opacity_of(same) == pytest.approx(opacity_of(turned)) == pytest.approx(expected)


@importer
def test_textures_are_numbered_as_they_come_and_found_again():
    first = {"diffuse": "wood.png", "normals": "n.png", "height": "h.png", "opacity": "leaf.png"}
    second = {"height": "h.png", "emissive": "wood.png", "diffuse": "", "occlusion": "orm.png"}
    made = import_materials(
        [SourceMaterial("a", textures=first), SourceMaterial("b", textures=second), SourceMaterial("c")]
    )
    assert made.textures == ("wood.png", "n.png", "leaf.png", "orm.png", "h.png")
    assert made.resolved() == [
        dict.fromkeys(SLOTS, "") | {"albedo": "wood.png", "normal": "n.png", "opacity": "leaf.png"},
        dict.fromkeys(SLOTS, "") | {"occlusion": "orm.png", "emissive": "wood.png", "normal": "h.png"},
        dict.fromkeys(SLOTS, ""),
    ]
    assert [bool(flags & MATERIAL_HEIGHT_MAP) for flags in made.records["flags"]] == [False, True, False]
    assert made.records["albedo_texture"][2] == NO_TEXTURE
    assert from_bytes(to_bytes(made)).resolved() == made.resolved()


@importer
@pytest.mark.parametrize(
    ("source", "fault"),
    [
        (
            {"name": "x", "diffuse": (0, 1, math.nan)},
            r"material 0 \(x\) has no three or four finite numbers as its diff",
        ),
        (
            {"ambient": (3e38, 0, 0), "emissive": (3e38, 0, 0)},
            "material 0 has no three or four finite numbers",
        ),
        (
            {"transparency": (0.5,)},
            "material 0 has no three or four finite numbers as its transparency colour",
        ),
        ({"opacity": math.inf}, "material 0 has a number that is not finite as its opacity"),
        (
            {"textures": {"albedo": "a.png"}},
            "a texture as its 'albedo', which is none of occlusion, emissive, diff",
        ),
    ],
)
def test_what_is_no_material_is_one_sentence(source, fault):
    with pytest.raises(SceneError, match=fault):
        imported(**source)


def test_words_of_names():
    assert {"wine", "bottle"} <= words_of("wineBottles02") and {"ior", "glass"} <= words_of("IORGlass_3")
    assert words_of("über") and "glass" in words_of("Glasses") and words_of("1_2-3") == set()


MTL = """
# a library
Kd 9 9 9
newmtl Bark Old
Ka 1 1 1
Kd 0.5 0.25 -1
Ke 0 2 0
Ns 98
Tf 1 1 1
illum 2
map_Kd -s 2 2 -o 0.5 0 0 -blendu on Textures\\Bark Old.PNG
map_Bump -bm 0.3 bark_h.png
map_Ka ao.png
map_d
newmtl leaf
d 0.5
Pm 0.25
Pr 0.75
Pr often
norm leaf_n.tga
bump leaf_h.tga
MAP_D -imfchan m leaf_o.png
d nan
Kd 1e39 0 0
"""


@importer
def test_a_wavefront_library_is_read(tmp_path):
    path = tmp_path / "a.mtl"
    path.write_bytes(b"\xef\xbb\xbf" + MTL.replace("\n", "\r\n").encode())
    (bark, leaf), warnings = read_mtl(path)
    roughness = (2 / 100) ** 0.25
    assert bark == SourceMaterial(
        "Bark Old",
        diffuse=(0.5, 0.25, 0),
        emissive=(0, 2, 0),
        roughness=roughness,
        textures={"diffuse": "Textures/Bark Old.PNG", "height": "bark_h.png"},
    )
    assert leaf == SourceMaterial(
        "leaf",
        opacity=0.5,
        metallic=0.25,
        roughness=0.75,
        textures={"normals": "leaf_n.tga", "height": "leaf_h.tga", "opacity": "leaf_o.png"},
    )
    assert warnings == [
        "Line 14 of a.mtl names no file for map_d and was left out.",
        "Line 19 of a.mtl has no numbers for Pr and was left out.",
        "Line 23 of a.mtl has no numbers for d and was left out.",
        "Line 24 of a.mtl has no numbers for Kd and was left out.",
        "Textures of a.mtl (map_Ka) were left out.",
    ]
    made = import_materials([bark, leaf])
    assert made.records["emissive"].tolist() == [[0, 2, 0, 1], [0, 0, 0, 0]]  # Ka does not glow
    assert made.records["opacity"].tolist() == [1, 0.5]  # nor does Tf make it clear
    assert made.textures == ("Textures/Bark Old.PNG", "bark_h.png", "leaf_n.tga", "leaf_o.png")


@importer
def test_a_file_that_is_no_library_is_one_sentence(tmp_path):
    path = tmp_path / "a.mtl"
    path.write_text("v 0 0 0\n")
    with pytest.raises(SceneError, match=r"a.mtl has no material: name a library"):
        read_mtl(path)
    with pytest.raises(SceneError, match=r"b.mtl cannot be read: No such file"):
        read_mtl(tmp_path / "b.mtl")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("a.png", "a.png"),
        ("-mm 0 1 a b.png", "a b.png"),
        ("-o 1 2 3 4.png", "4.png"),
        ("-s 1 -t 0 0 -clamp on -bm 2 x.png", "x.png"),
        ("-unknown x.png", "-unknown x.png"),
        ("-s 1 1 1", ""),
        ("-bm", ""),
        ("", ""),
    ],
)
def test_options_stand_before_the_name_of_a_map(words, name):
    assert map_name(words.split()) == name
