"""Codes of colours are decoded before anything is done with them, and numbers in other textures are not."""

from __future__ import annotations

import numpy as np

from common.scene import Image, Material, Sampler
from tests.support.scenes import facing, quad_scene, texture
from tools.exercises.checking import Given


def light_of(code: float) -> float:
    """Return the amount of light that an sRGB code from 0 to 1 stands for (IEC 61966-2-1)."""
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


def check(given: Given) -> None:
    """Draw squares that show one texture alone: base colour, then numbers, then emission."""
    grey = np.full((4, 4, 4), 128, np.uint8)
    scene = quad_scene(Material(unlit=True, base_color_texture=texture()), images=(Image("grey", grey),))
    seen = float(given.draw(scene, facing(), size=(8, 8)).mean())
    wanted = light_of(128 / 255)
    given.need(
        abs(seen - wanted) < 2e-3,
        f"A texel of code 128 stands for {wanted:.3f} of white light, and gives {seen:.3f}.",
    )
    stripes = np.zeros((64, 64, 4), np.uint8)
    stripes[:, ::2], stripes[..., 3] = 255, 255
    fine = texture(sampler=Sampler("linear", "linear", "linear"))
    scene = quad_scene(Material(unlit=True, base_color_texture=fine), images=(Image("stripes", stripes),))
    seen = float(given.draw(scene, facing(), size=(8, 8)).mean())
    given.need(
        abs(seen - 0.5) < 5e-3,
        f"Stripes of black and white are half of white light from afar, not {seen:.3f}.",
    )
    for material, view, stands_for in (
        (Material(metallic_roughness_texture=texture()), "roughness", "roughness"),
        (Material(occlusion_texture=texture()), "occlusion", "share of light"),
    ):
        scene = quad_scene(material, images=(Image("numbers", grey),))
        seen = float(given.draw(scene, facing(), size=(8, 8), view=view)[4, 4, 0])
        given.need(
            abs(seen - 128 / 255) < 2e-3,
            f"A texel of 128 in a texture of another kind is a {stands_for} of {128 / 255:.3f}, and gives {seen:.3f}.",
        )
    glow = quad_scene(
        Material(emissive=(1.0, 1.0, 1.0), emissive_texture=texture()), images=(Image("grey", grey),)
    )
    seen = float(given.draw(glow, facing(), size=(8, 8), view="emissive")[4, 4, 0])
    given.need(
        abs(seen - wanted) < 2e-3,
        f"A texel of code 128 that glows sends out {wanted:.3f}, and gives {seen:.3f}.",
    )
