"""Which surfaces cast shadows in a traced picture: those that do in a rasterised one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch12.rays.model import BLENDED, SURFACES, UNLIT, masks
from chapters.ch12.settings import Settings
from common.numerics.transforms import rotation
from common.scene import Light, Material, Scene
from tests.support.scenes import facing, quad_scene, translated

GROUND = Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0)
SKY = Material(unlit=True)
GLASS = Material(base_color=(1.0, 1.0, 1.0, 0.5), metallic=0.0, alpha_mode="blend")
SIZE, TILT, HEIGHT = 32, 0.9, 0.5
DARK = {
    "ambient": 0.0,
    "default_light": False,
    "background": 0.0,
    "tone_curve": "none",
    "color_format": "rgba32f",
}
"""Nothing but the lights of a scene."""


def plates(*materials: Material) -> Scene:
    """Return a ground with plates half a metre above it, which the sun sees aslant: their shadows lie left of them."""
    quarter = np.diag((0.25, 0.25, 1.0, 1.0))
    above = [translated(0.4, y, HEIGHT) @ quarter for y in np.linspace(0.6, -0.6, len(materials))]
    return quad_scene(
        materials=(GROUND, *materials),
        matrices=(np.eye(4), *above, rotation((0.0, 1.0, 0.0), TILT)),
        instance_materials=tuple(range(len(materials) + 1)),
        lights=(Light("directional", node=len(materials) + 1, intensity=3.0),),
    )


def test_each_kind_of_surface_has_a_bit():
    scene = plates(GROUND, SKY, GLASS, Material(unlit=True, alpha_mode="blend"))
    assert masks(scene).tolist() == [SURFACES, SURFACES, UNLIT, BLENDED, UNLIT]
    scene.instances.visible[2] = False
    assert masks(scene)[2] == 0 and masks(scene, hidden=True)[2] == UNLIT
    assert len({SURFACES, BLENDED, UNLIT}) == 3 and SURFACES | BLENDED | UNLIT == 7


@pytest.mark.variants("vulkan")
def test_a_sky_casts_no_shadow_and_a_plate_does(chapter):
    settings = Settings(rays="whole", **DARK)
    with chapter.open(plates(GROUND, SKY), (SIZE, SIZE), settings, outputs={"color_linear"}) as renderer:
        picture = renderer.render(facing()).image("color_linear").astype(np.float64)[..., 0]
    column = int((0.4 - HEIGHT * np.tan(TILT) + 1) / 2 * SIZE)
    rows = [int((1 - y) / 2 * SIZE) for y in (0.6, -0.6)]
    lit = picture[SIZE // 2, 4]
    assert lit > 0.0
    assert picture[rows[0], column] == 0.0
    assert picture[rows[1], column] == pytest.approx(lit, rel=1e-3)


@pytest.mark.variants("vulkan")
def test_what_is_nearer_to_a_lamp_than_shadow_near_casts_no_shadow(chapter):
    """A plate 0.1 m below a lamp, as the glass of a bulb. Shadow maps begin behind it or before it; rays end there."""
    lamp, below, half = 0.5, 0.1, 0.05
    scene = quad_scene(
        materials=(GROUND, replace(GROUND, double_sided=True)),
        matrices=(
            np.eye(4),
            translated(0.0, 0.0, lamp - below) @ np.diag((half, half, 1.0, 1.0)),
            translated(0.0, 0.0, lamp),
        ),
        instance_materials=(0, 1),
        lights=(Light("point", node=2, intensity=3.0),),
    )
    column = int((0.6 * half * lamp / below + 1) / 2 * SIZE)  # in the shadow, beside the plate
    for metres, lit in ((0.05, False), (0.2, True)):
        for knobs in ({"rays": "whole"}, {"rays": "off", "shadows": "on"}):
            settings = Settings(**DARK, **knobs, shadow_near=metres / scene.length_scale)
            with chapter.open(scene, (SIZE, SIZE), settings, outputs={"color_linear"}) as renderer:
                picture = renderer.render(facing()).image("color_linear")[..., 0]
            assert (picture[SIZE // 2, column] > 0.0) == lit and picture[SIZE // 2, 2] > 0.0, knobs
