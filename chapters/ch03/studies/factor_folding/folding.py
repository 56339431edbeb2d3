"""Folding the factors of materials into their textures: afterwards all factors are 1, and every role has a texture.

A role without a texture gets one of a single texel, which is the factor itself. Occlusion, roughness and metalness
become the channels red, green and blue of one texture, where both were sampled in the same way at the same size, or one
of them is constant. Materials that emit nothing share one black texel, image 0. Products are rounded once, to float32:
eight bits would not hold them, which is what folding costs beside the memory of constants. The GPU then keeps half
floats, whose mip levels are not rounded to eight bits again: small textures look the same, distant ones a code better.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.images.color import decode_srgb
from common.scene import Image, Material, Scene, TextureRef
from common.scene.parts import changed

Float64 = NDArray[np.float64]

BLACK = 0
"""The image that all materials share which emit nothing."""


@dataclass
class _Pool:
    """The images of the folded scene, each made once."""

    source: list[Image]
    images: list[Image] = field(default_factory=list)
    _made: dict[Any, int] = field(default_factory=dict)

    def add(self, name: str, pixels: Float64) -> int:
        """Return the number of a new image with these pixels (H, W, 4), linear."""
        self.images.append(Image(name, pixels.astype(np.float32)))
        return len(self.images) - 1

    def once(self, key: Any, name: str, make: Any) -> int:
        """Return the number of the image for `key`; `made()` is what it has."""
        if key not in self._made:
            self._made[key] = self.add(name, make())
        return self._made[key]

    def as_it_is(self, number: int) -> int:
        """Return the new number of an image of the scene into which nothing is multiplied."""
        if number not in self._made:
            self._made[number] = len(self.images)
            self.images.append(self.source[number])
        return self._made[number]

    def light(self, texture: TextureRef | None, srgb: bool) -> Float64:
        """Return what a texture holds, linear (H, W, 4) float64; without one, a texel of ones."""
        if texture is None:
            return np.ones((1, 1, 4))
        pixels = self.source[texture.image].pixels
        if pixels.dtype == np.float32:
            return pixels.astype(np.float64)
        values = pixels.astype(np.float64) / (255.0 if pixels.dtype == np.uint8 else 65535.0)
        if srgb:
            values[..., :3] = decode_srgb(values[..., :3])
        return values


def folded(scene: Scene) -> Scene:
    """Return a scene of the same picture whose materials have no factors, and textures in every role but normals.

    Those have a scale that is no factor: the sum it is part of is normalised after it. Where occlusion and roughness
    cannot share a texture, each has its own.
    """
    pool = _Pool(scene.images)
    pool.add("black", np.array([[[0.0, 0.0, 0.0, 1.0]]]))
    materials = [_folded(material, pool) for material in scene.materials]
    parts = {"nodes": scene.nodes, "instances": scene.instances, "lights": list(scene.lights)}
    return changed(scene, materials=materials, images=pool.images, **parts)


def _folded(material: Material, pool: _Pool) -> Material:
    normal = material.normal_texture
    if normal is not None:
        normal = replace(normal, image=pool.as_it_is(normal.image))
    base = _product(material.base_color_texture, material.base_color, pool, "base color")
    emission = _product(material.emissive_texture, (*material.emissive, 1.0), pool, "emission")
    surface, occlusion = _surface(material, pool)
    return replace(
        material,
        base_color=(1.0, 1.0, 1.0, 1.0),
        metallic=1.0,
        roughness=1.0,
        emissive=(1.0, 1.0, 1.0),
        occlusion_strength=1.0,
        base_color_texture=base,
        emissive_texture=emission,
        metallic_roughness_texture=surface,
        occlusion_texture=occlusion,
        normal_texture=normal,
    )


def _product(texture: TextureRef | None, factor: tuple[float, ...], pool: _Pool, name: str) -> TextureRef:
    """Return a texture of a colour times its factor; black is one texel, whatever it was multiplied with."""
    if not any(factor[:3]) and name == "emission":
        return TextureRef(BLACK)
    key = (name, None if texture is None else texture.image, factor)
    number = pool.once(key, name, lambda: pool.light(texture, True) * np.array(factor))
    return TextureRef(number) if texture is None else replace(texture, image=number)


def _surface(material: Material, pool: _Pool) -> tuple[TextureRef, TextureRef]:
    """Return the textures of roughness and metalness, and of occlusion: one and the same, if it can be."""
    rough, dark, strength = (
        material.metallic_roughness_texture,
        material.occlusion_texture,
        material.occlusion_strength,
    )
    factor = np.array([1.0, material.roughness, material.metallic, 1.0])

    def made(surface: TextureRef | None, occlusion: TextureRef | None) -> Float64:
        values = pool.light(surface, False) * factor
        # glTF 2.0, 3.9.3: strength 0 is no occlusion, 1 is all of the texture's.
        red = 1.0 + strength * (pool.light(occlusion, False)[..., 0] - 1.0)
        whole = np.ones((*np.broadcast_shapes(values.shape[:2], red.shape), 4))
        whole[..., 0] = red
        whole[..., 1:3] = values[..., 1:3]
        return whole

    def texture(surface: TextureRef | None, occlusion: TextureRef | None) -> TextureRef:
        like = surface or occlusion
        numbers = [None if read is None else read.image for read in (surface, occlusion)]
        key = ("surface", *numbers, material.roughness, material.metallic, strength)
        number = pool.once(key, "occlusion, roughness, metalness", lambda: made(surface, occlusion))
        return TextureRef(number) if like is None else replace(like, image=number)

    if rough is None or dark is None or _alike(rough, dark, pool):
        both = texture(rough, dark)
        return both, both
    return texture(rough, None), texture(None, dark)


def _alike(first: TextureRef, second: TextureRef, pool: _Pool) -> bool:
    """Whether two textures are sampled at the same places of images of the same size."""
    sizes = [(pool.source[ref.image].width, pool.source[ref.image].height) for ref in (first, second)]
    return sizes[0] == sizes[1] and replace(first, image=0) == replace(second, image=0)
