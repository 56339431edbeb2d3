"""The study factor-folding: texels are the exact products, and the picture is that of the chapter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch03.studies.factor_folding.folding import BLACK, folded
from common.images.color import decode_srgb
from common.scene import Image, Light, Material, Sampler, TextureRef
from tests.support.bounds import codes_off
from tests.support.scenes import facing, quad_scene, translated

folding = pytest.mark.feature("scene-cache/factor-folding")


def image(seed, size=(3, 5)):
    return Image(f"{seed}", np.random.default_rng(seed).integers(0, 256, (*size, 4), np.uint8))


def texels(scene, texture):
    """Return the pixels that a texture of a folded scene has."""
    return scene.images[texture.image].pixels


@folding
def test_factors_become_single_texels():
    material = Material(
        base_color=(0.1, 0.2, 0.3, 0.4), metallic=0.7, roughness=0.3, emissive=(5e5, 0.0, 2.0)
    )
    scene = folded(quad_scene(material))
    made = scene.materials[0]
    assert texels(scene, made.base_color_texture).tolist() == [[np.float32([0.1, 0.2, 0.3, 0.4]).tolist()]]
    assert texels(scene, made.metallic_roughness_texture).tolist() == [
        [np.float32([1, 0.3, 0.7, 1]).tolist()]
    ]
    assert texels(scene, made.emissive_texture).tolist() == [[np.float32([5e5, 0.0, 2.0, 1.0]).tolist()]]
    assert made.base_color == (1, 1, 1, 1) and (made.metallic, made.roughness, made.emissive) == (
        1,
        1,
        (1, 1, 1),
    )


@folding
def test_factors_are_multiplied_in_and_rounded_once():
    material = Material(
        base_color=(0.1, 0.2, 0.3, 0.4),
        metallic=0.7,
        roughness=0.3,
        emissive=(0.3, 7.0, 0.1),
        occlusion_strength=0.6,
        base_color_texture=TextureRef(0),
        metallic_roughness_texture=TextureRef(1),
        occlusion_texture=TextureRef(2),
        emissive_texture=TextureRef(0),
    )
    source = quad_scene(material, images=(image(1), image(2), image(3)))
    scene = folded(source)
    made = scene.materials[0]
    colors, surface, dark = (one.pixels / 255.0 for one in source.images)
    light = np.concatenate([decode_srgb(colors[..., :3]), colors[..., 3:]], axis=2)
    assert (texels(scene, made.base_color_texture) == (light * material.base_color).astype(np.float32)).all()
    assert (texels(scene, made.emissive_texture) == (light * (0.3, 7.0, 0.1, 1.0)).astype(np.float32)).all()
    whole = texels(scene, made.metallic_roughness_texture)
    assert made.occlusion_texture == made.metallic_roughness_texture
    assert (whole[..., 0] == (1.0 + 0.6 * (dark[..., 0] - 1.0)).astype(np.float32)).all()
    assert (whole[..., 1] == (surface[..., 1] * 0.3).astype(np.float32)).all()
    assert (whole[..., 2] == (surface[..., 2] * 0.7).astype(np.float32)).all()


@folding
def test_what_emits_nothing_shares_one_black_texel():
    materials = (Material(), Material(emissive_texture=TextureRef(0)), Material(emissive=(0.0, 0.0, 1e-3)))
    scene = folded(quad_scene(materials=materials, images=(image(1),)))
    assert [one.emissive_texture.image == BLACK for one in scene.materials] == [True, True, False]
    assert scene.images[BLACK].pixels.tolist() == [[[0.0, 0.0, 0.0, 1.0]]]


@folding
def test_one_texture_serves_occlusion_and_roughness_unless_they_are_sampled_differently():
    def shared(rough, dark, **more):
        scene = folded(
            quad_scene(
                Material(metallic_roughness_texture=rough, occlusion_texture=dark, **more),
                images=(image(1), image(2), image(3, (4, 4))),
            )
        )
        made = scene.materials[0]
        return made.metallic_roughness_texture == made.occlusion_texture

    here = TextureRef(0)
    assert shared(here, replace(here, image=1)) and shared(here, None) and shared(None, here)
    assert not shared(here, TextureRef(2))
    assert not shared(here, TextureRef(1, uv_set=1))
    assert not shared(here, TextureRef(1, Sampler(wrap_u="clamp")))


def test_equal_materials_share_their_images_and_the_scene_stays_as_it_was():
    material = Material(base_color=(0.5, 0.5, 0.5, 1.0), base_color_texture=TextureRef(0))
    source = quad_scene(materials=(material, replace(material, name="other")), images=(image(1),))
    scene = folded(source)
    assert scene.materials[0].base_color_texture == scene.materials[1].base_color_texture
    assert len(scene.images) == 3  # black, colour, and the texel of roughness
    assert source.materials[0] is material and len(source.images) == 1


@folding
def test_the_picture_is_that_of_the_chapter(stage):
    near = Sampler("nearest", "nearest", None)
    materials = (
        Material(base_color=(0.5, 0.9, 0.2, 1.0), roughness=0.6, metallic=0.2, emissive=(0.1, 0.0, 0.2)),
        Material(
            base_color=(0.9, 0.5, 0.7, 1.0),
            roughness=0.8,
            metallic=0.5,
            emissive=(0.2, 0.3, 0.1),
            occlusion_strength=0.5,
            **{
                f"{role}_texture": TextureRef(number, near)
                for number, role in enumerate(
                    ("base_color", "metallic_roughness", "occlusion", "emissive", "normal")
                )
            },
        ),
    )
    apart = (translated(-1.1), translated(1.1))
    scene = quad_scene(
        materials=materials,
        instance_materials=(0, 1),
        matrices=apart,
        images=tuple(image(seed) for seed in range(5)),
        lights=(Light("directional", 0, intensity=2.0),),
    )
    scene.ambient = 0.5
    pictures = []
    for which in ("3", "3/factor-folding"):
        with chapters.open(which, stage.backend, scene=scene, size=(48, 24), device=stage.device) as renderer:
            pictures.append(renderer.render(facing(ymag=1.1, ev100=-1.0)).image("color").astype(int))
    assert len(np.unique(pictures[0])) > 30
    # Half floats have eleven bits: less than a code.
    assert np.abs(pictures[0] - pictures[1]).max() <= 1 + codes_off(stage.device)
