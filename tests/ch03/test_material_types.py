"""Material types: prefix sums address exactly the range of each, and nothing is made for one that does not occur."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from assets import locate
from chapters.ch03.scene.material_types import (
    TYPES,
    index_offsets,
    material_ranges,
    mesh_ranges,
    prefix_offsets,
    sorted_by,
)
from common.gltf import load_scene
from common.scene import Material
from tests.support.scenes import facing, quad_scene, translated

sorting = pytest.mark.feature("scene-cache/material-sorting")


@sorting
@pytest.mark.parametrize("seed", range(20))
def test_ranges_hold_each_thing_once_beside_its_like(seed):
    rng = np.random.default_rng(seed)
    count, total = int(rng.integers(1, 9)), int(rng.integers(0, 50))
    types = rng.integers(0, count, total)
    types = types[types != seed % count]  # one type does not occur
    ranges = sorted_by(types, count)
    assert len(ranges.offsets) == count + 1
    assert ranges.offsets[0] == 0 and ranges.offsets[-1] == len(types)
    for kind in range(count):
        assert ranges.of(kind).tolist() == [place for place, found in enumerate(types) if found == kind]
    assert ranges.present == tuple(sorted(set(types.tolist())))
    assert seed % count not in ranges.present and len(ranges.of(seed % count)) == 0


@sorting
def test_offsets_are_the_prefix_sums_of_counts():
    assert prefix_offsets([3, 0, 2]).tolist() == [0, 3, 3, 5]
    assert prefix_offsets([]).tolist() == [0]


@sorting
def test_a_number_that_is_no_type_is_refused():
    for types in ([3], [-1], [0, 7]):
        with pytest.raises(ValueError, match="0 to 2"):
            sorted_by(types, 3)


@sorting
def test_the_triangles_of_a_scene_by_type():
    scene = load_scene(locate("atrium"))
    meshes, offsets = mesh_ranges(scene), index_offsets(scene, mesh_ranges(scene))
    for number, kind in enumerate(TYPES):
        drawn = [
            int(row["index_count"])
            for row in scene.meshes
            if scene.materials[row["material"]].alpha_mode == kind
        ]
        assert len(meshes.of(number)) == len(drawn) > 0
        assert offsets[number + 1] - offsets[number] == sum(drawn)
    assert [scene.materials[number].alpha_mode for number in material_ranges(scene).order] == sorted(
        (material.alpha_mode for material in scene.materials), key=TYPES.index
    )


@pytest.mark.core
@sorting
def test_a_type_that_does_not_occur_has_an_empty_range_and_no_pipeline(chapter):
    modes = {"opaque": Material(), "mask": Material(alpha_mode="mask"), "blend": Material(alpha_mode="blend")}
    made = {}
    for present in (("opaque",), ("opaque", "mask"), ("opaque", "mask", "blend")):
        scene = quad_scene(
            materials=tuple(replace(modes[mode], name=mode) for mode in present),
            instance_materials=tuple(range(len(present))),
            matrices=tuple(translated(z=-0.1 * number) for number in range(len(present))),
        )
        ranges = mesh_ranges(scene)
        assert ranges.present == tuple(TYPES.index(mode) for mode in present)
        assert all(len(ranges.of(kind)) == 0 for kind in range(3) if kind not in ranges.present)
        with chapter.open(scene, (8, 8)) as renderer:
            frame = renderer.render(facing())
            frame.image("color")
            made[len(present)] = frame.work["pipelines"]
    assert made[2] == made[1] + 1 and made[3] == made[1] + 2
