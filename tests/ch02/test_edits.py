"""Edits while frames are in flight, and scenes that lack what others have: no stale texture, faults in a sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch02.scene import pages
from chapters.ch02.settings import Settings
from common.errors import SceneError, ShaderError
from common.scene import Image, Instances, Light, Material, Sampler, Scene
from tests.support.scenes import NEAREST, facing, quad_scene, texture, translated

SIZE = (32, 16)
EXACT = Settings(
    color_format="rgba32f", background=0.1, default_light=False, tone_curve="none", anisotropy=1.0
)
UNLIT = Material(unlit=True)
MATTE = Material(metallic=0.0, roughness=1.0)
SUN = Light("directional", node=0, intensity=3.0)
OUTPUTS = ("color_linear", "instance_id", "depth")


def noise(seed: int) -> Image:
    """Return an image of 4x4 texels."""
    pixels = np.random.default_rng(seed).integers(0, 256, (4, 4, 4), dtype=np.uint8)
    return Image(f"noise {seed}", pixels)


def pair(first: Material, second: Material) -> Scene:
    """Return two squares side by side, which fill the picture, under a sun."""
    return quad_scene(
        materials=(first, second),
        matrices=(translated(-1.0), translated(1.0)),
        instance_materials=(0, 1),
        images=tuple(noise(seed) for seed in range(4)),
        lights=(SUN,),
    )


def textured(number: int, sampler: Sampler = NEAREST, **more: object) -> Material:
    """Return an unlit material with one image."""
    return replace(UNLIT, base_color_texture=texture(number, sampler), **more)


def fresh(chapter, scene: Scene) -> list[np.ndarray]:
    """Return the outputs of a renderer that never knew the scene before."""
    with chapter.open(scene, SIZE, EXACT, outputs=OUTPUTS) as made:
        frame = made.render(facing())
        return [frame.image(name) for name in OUTPUTS]


STEPS = {
    "the first texture": (UNLIT, textured(0)),
    "another texture": (textured(0), textured(1)),
    "another sampler": (textured(0), textured(0, Sampler())),
    "opaque to blend": (textured(1), textured(1, alpha_mode="blend")),
    "masked": (UNLIT, textured(2, alpha_mode="mask")),
    "unlit to lit": (textured(0), replace(MATTE, occlusion_texture=texture(3), normal_texture=texture(1))),
    "lit to unlit": (replace(MATTE, metallic_roughness_texture=texture(2)), textured(3)),
}


@pytest.mark.parametrize("name", STEPS)
def test_an_edit_shows_in_the_next_frame_whatever_is_in_flight(chapter, name):
    """Back and forth, at odd and even frames; nothing is waited for between them, and every picture is a new one's."""
    before, after = STEPS[name]
    second = textured(2)
    scene = pair(before, second)
    truth = {id(material): fresh(chapter, pair(material, second)) for material in (before, after)}
    assert any(not np.array_equal(a, b) for a, b in zip(*truth.values(), strict=True))
    with chapter.open(scene, SIZE, EXACT, outputs=OUTPUTS) as made:
        for change_at in (before, after, after, before, after, before, before, before, after):
            with scene.edit() as change:
                change.set_material(0, change_at)
            frame = made.render(facing())
            if change_at is after:  # the others stay in flight while the next edit is followed
                for output, expected in zip(OUTPUTS, truth[id(after)], strict=True):
                    assert np.array_equal(frame.image(output), expected), output
        with scene.edit() as change:
            change.set_material(0, before)
        frame = made.render(facing())
        for output, expected in zip(OUTPUTS, truth[id(before)], strict=True):
            assert np.array_equal(frame.image(output), expected), output


def test_textures_come_and_go_for_ever_and_nothing_piles_up(chapter):
    """Thirty edits without one wait: as many objects live at the end as after the first few."""
    scene = pair(textured(0), textured(1))
    counts = []
    with chapter.open(scene, SIZE, EXACT) as made:
        for step in range(30):
            with scene.edit() as change:
                change.set_material(0, (textured(step % 4), UNLIT, textured(2, alpha_mode="blend"))[step % 3])
            made.render(facing())
            counts.append(len(chapter.device.alive))
    assert max(counts[18:]) <= max(counts[6:18]), counts


def test_glass_in_any_order_keeps_no_more_than_its_states(chapter):
    """A camera that goes round two kinds of panes: what is kept for drawing does not grow with the orders they had."""
    kinds = (
        replace(UNLIT, alpha_mode="blend", double_sided=True),
        textured(1, alpha_mode="blend", double_sided=True),
    )
    scene = quad_scene(
        materials=kinds,
        images=(noise(0), noise(1)),
        matrices=tuple(translated(0.3 * np.cos(i), 0.1 * i, np.sin(i)) for i in range(9)),
        instance_materials=tuple(i * i % 3 % 2 for i in range(9)),
    )
    with chapter.open(scene, SIZE, EXACT) as made:
        for step in range(24):
            turn = np.eye(4)
            angle = step * 0.7
            turn[0, 0] = turn[2, 2] = np.cos(angle)
            turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
            made.render(replace(facing(), world_from_view=turn @ facing().world_from_view))
        assert len(next(one for one in made.passes if one.name == "forward")._groups) <= 2 * len(kinds), (
            "one for each slot and state"
        )


# --- what a scene may lack ---


@pytest.mark.parametrize("size", [(0, 0), (0, 3), (3, 0)], ids=str)
def test_an_image_without_pixels_is_one_sentence(chapter, size):
    """When it is opened, when it is edited, and only where somebody reads it."""
    empty = Image("nothing", np.zeros((*size, 4), np.uint8))
    scene = pair(UNLIT, textured(0))
    scene.images.append(empty)
    said = (
        rf"^Image 4 \('nothing'\) has {size[1]}x{size[0]} pixels, and material 0 reads it as its base_color: "
    )
    alive = len(chapter.device.alive)
    with pytest.raises(SceneError, match=said):
        chapter.open(replace(scene, materials=[textured(4), UNLIT]), SIZE, EXACT)
    assert len(chapter.device.alive) == alive
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        expected = made.render(facing()).image("color_linear")
        with scene.edit() as change:
            change.set_material(0, textured(4))
        for _ in range(2):
            with pytest.raises(SceneError, match=said):
                made.render(facing())
        with scene.edit() as change:
            change.set_material(0, UNLIT)
        assert np.array_equal(made.render(facing()).image("color_linear"), expected)


def test_a_scene_without_materials_is_one_sentence_where_something_is_drawn(chapter):
    scene = pair(UNLIT, UNLIT)
    scene.materials.clear()
    alive = len(chapter.device.alive)
    with pytest.raises(
        SceneError, match=r"^Mesh 0 has material 0, but there are 0 materials, counted from 0: "
    ):
        chapter.open(scene, SIZE, EXACT)
    assert len(chapter.device.alive) == alive
    scene.materials.append(UNLIT)
    with pytest.raises(SceneError, match=r"^Mesh 1 has material 1, but there are 1 materials"):
        chapter.open(scene, SIZE, EXACT)


NONE = Instances(np.zeros(0, np.int32), np.zeros(0, np.int32))


@pytest.mark.parametrize("lacking", ["instances", "instances and materials", "everything", "triangles"])
def test_a_scene_of_nothing_is_its_background(chapter, lacking):
    scene = pair(textured(0), replace(MATTE, alpha_mode="mask"))
    if lacking == "triangles":
        scene.meshes["index_count"] = 0
    else:
        scene = replace(scene, instances=NONE)
    if lacking.endswith("materials"):
        scene.materials.clear()
    if lacking == "everything":
        arrays = {
            name: getattr(scene, name)[:0] for name in ("positions", "normals", "tangents", "uv0", "indices")
        }
        scene = replace(
            scene, meshes=scene.meshes[:0], mesh_names=[], materials=[], images=[], lights=[], **arrays
        )
    with chapter.open(scene, SIZE, EXACT, outputs=OUTPUTS) as made:
        for _ in range(3):
            frame = made.render(facing())
        light, ids, depth = (frame.image(name) for name in OUTPUTS)
    assert light.min() == light.max() > 0 and not ids.any() and not depth.any()
    assert frame.work["draws"] == 0


@pytest.mark.core
def test_textures_may_come_to_a_scene_that_had_none(chapter):
    """No set, no slot and no array was made before."""
    scene = pair(UNLIT, replace(UNLIT, base_color=(0.2, 0.4, 0.6, 1.0)))
    with chapter.open(scene, SIZE, EXACT, outputs=OUTPUTS) as made:
        assert made.render(facing()).work["textures"] == 0
        for number in range(3):
            with scene.edit() as change:
                change.set_material(number % 2, textured(number))
            frame = made.render(facing())
            found = [frame.image(name) for name in OUTPUTS]
            assert all(np.array_equal(a, b) for a, b in zip(found, fresh(chapter, scene), strict=True))


def test_an_edit_that_makes_a_mesh_too_large_for_a_page_changes_nothing(chapter, monkeypatch):
    """Streams that a material reads in addition make geometry grow: refused until the edit is taken back."""
    scene = pair(UNLIT, UNLIT)
    monkeypatch.setattr(pages, "PAGE_BYTES", 300)  # four positions and six indices, each in 256 bytes
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        expected = made.render(facing()).image("color_linear")
        for material in (textured(0), UNLIT):
            with scene.edit() as change:
                change.set_material(0, material)
            for _ in range(2):
                if material is UNLIT:
                    assert np.array_equal(made.render(facing()).image("color_linear"), expected)
                else:
                    with pytest.raises(
                        SceneError, match=r"^Mesh \d takes 1 MiB, and a page of geometry holds 0"
                    ):
                        made.render(facing())


@pytest.mark.variants("vulkan", "without-all")
def test_pipelines_that_share_a_set_but_not_its_layout_are_refused(chapter):
    """As one is that was made from a file which was edited since, and refused for those before it."""
    with chapter.open(pair(UNLIT, textured(0)), SIZE, EXACT, outputs=OUTPUTS) as made:
        made.render(facing())
        forward = next(one for one in made.passes if one.name == "forward")
        first = forward.pipelines[0]
        other = replace(first.sets[0], handle=first.sets[1].handle)
        forward.pipelines = (*forward.pipelines, replace(first, sets=(other, *first.sets[1:])))
        with pytest.raises(ShaderError, match="disagree about set 0"):
            made._api.make_sets(made.passes) if hasattr(made, "_api") else made._make_sets()
