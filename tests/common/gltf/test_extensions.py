"""What a file uses beyond the standard: found wherever it is, and drawn as is said where Strata does not have it."""

from __future__ import annotations

import re

import pytest

from common.gltf import load_scene
from common.gltf.document import SUPPORTED
from common.gltf.extensions import INSTEAD, UNKNOWN, extensions_of
from tests.common.gltf.builder import triangle

LOBES = sorted(name for name in INSTEAD if name.startswith("KHR_materials_") and "variants" not in name)


def test_no_extension_is_both_drawn_and_replaced():
    assert not SUPPORTED & INSTEAD.keys()


def test_sentences_are_ends_of_one():
    """Each goes on after "Strata draws"."""
    for text in (*INSTEAD.values(), UNKNOWN):
        assert re.fullmatch(r"[a-z].*[^.]", text)


def test_uses_are_counted_by_the_objects_that_have_them():
    """At any depth, once per object, listed or not, used or not; `extras` are the author's own."""
    root = {
        "extensionsUsed": ["B", "Never"],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "extensions": {"Top": {"lights": []}},
        "materials": [
            {"extensions": {"A": {}}},
            {"normalTexture": {"extensions": {"B": {}}}, "occlusionTexture": {"extensions": {"B": {}}}},
            {"extensions": {"A": {}, "B": {}}, "extras": {"extensions": {"C": {}}}},
        ],
        "nodes": [{"extensions": {"Top": {"light": 0}}}],
        "meshes": [{"primitives": [{"extensions": {"KHR_draco_mesh_compression": {}}}]}],
    }
    found = {use.name: use for use in extensions_of(root)}
    assert {name: dict(use.uses) for name, use in found.items()} == {
        "A": {"materials": 2},
        "B": {"materials": 2},
        "KHR_draco_mesh_compression": {"meshes": 1},
        "Never": {},
        "Top": {"nodes": 1},
    }
    assert [name for name, use in found.items() if use.required] == ["KHR_draco_mesh_compression"]
    assert found["KHR_draco_mesh_compression"].advice == "export it without Draco compression"
    assert found["A"].instead == UNKNOWN


@pytest.mark.parametrize(
    "root",
    [
        {},
        {"extensionsUsed": 3, "extensionsRequired": [1, None]},
        {"materials": "x", "nodes": [1, [2]], "extensions": []},
    ],
)
def test_what_has_not_the_form_of_gltf_is_passed_over(root):
    assert extensions_of(root) == []


@pytest.mark.parametrize("name", LOBES)
def test_a_surface_is_drawn_without_what_strata_lacks(name, tmp_path):
    """The material that comes out is the one without the extension, whatever that says."""
    made = triangle()
    made.json["materials"] = [{"pbrMetallicRoughness": {"roughnessFactor": 0.25}}]
    made.json["meshes"][0]["primitives"][0]["material"] = 0
    expected = load_scene(made.write(tmp_path, "data"))
    made.json["extensionsUsed"] = [name]
    made.json["materials"][0]["extensions"] = {name: {"transmissionFactor": 1.0, "ior": 2.0}}
    scene = load_scene(made.write(tmp_path))
    assert scene.materials == expected.materials
    assert [use.instead for use in extensions_of(made.json)] == [INSTEAD[name]]
    assert scene.warnings == [f"The extension {name} is not supported and was ignored."]
