"""What `strata reference` says that a chapter leaves out: each claim in the chapter's picture and in light by paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import chapters
from common.environment import constant
from common.environment.medium import Medium
from common.scene import Light, Material
from common.settings import preset, replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.path_scenes import ABOVE, MATTE, places
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import placed, point, sun
from tools.reference import settings
from tools.reference.tracing import reference

pytestmark = pytest.mark.feature("path-tracer/accumulation")

SIZE = (16, 12)
SHADOWS, INDIRECT = "no shadows of ambient light", "no light that one surface sends to another"
LOSS = " Its rough metals reflect all of the ambient light, and those of the reference a part of it."
GLASS = replace(MATTE, alpha_mode="blend", base_color=(0.7, 0.5, 0.3, 0.5))
METAL = Material(base_color=(1.0, 1.0, 1.0, 1.0), metallic=1.0, roughness=1.0, double_sided=True)


def lit(scene):
    """Return the scene with a light that casts shadows."""
    return replace(scene, lights=[Light("directional", 0)])


def test_what_a_chapter_leaves_out_is_one_sentence():
    scene = lit(quad_scene(MATTE))
    around, misty = replace(scene, environment=constant(1.0)), replace(scene, medium=Medium(0.1))

    def said(which, shown=scene, **changed):
        own = replaced(preset(chapters.settings_class(which), "reference"), **changed)
        return settings.differences(which, own, shown)

    assert said(1) == f"Chapter 1 draws by design no shadows and {INDIRECT}: the reference has them."
    assert said(8) == f"Chapter 8 draws by design {INDIRECT}: the reference has them."
    assert said(8, shadows="off") == said(1).replace("1", "8")
    assert said(1, misty).endswith(f"no shadows, {INDIRECT} and no fog: the reference has them.")
    assert said(10, misty, fog=False).endswith("and no fog: the reference has them.")
    assert "and no fog between surfaces and lights:" in said(10, misty)
    assert "no shadows of the environment's light" in said(8, around)
    assert "environment" not in said(8, around, environment_intensity=0.0)
    assert said(12, path_tracer=True) == ""
    assert said(12) == f"Chapter 12 without path_tracer draws by design {INDIRECT}: the reference has them."


def test_what_is_left_out_follows_from_the_scene():
    def said(which, *materials, light=True, **changed):
        own = replaced(preset(chapters.settings_class(which), "reference"), **changed)
        scene = quad_scene(materials=materials, matrices=(np.eye(4),) * len(materials))
        return settings.differences(which, own, lit(scene) if light else scene)

    glass = "no shadows of blended surfaces"
    assert glass in said(8, MATTE, GLASS) and glass in said(12, GLASS, rays="whole", shadows="off")
    assert glass not in said(1, GLASS) + said(8, MATTE) + said(8, replace(GLASS, unlit=True))
    by_default = "no shadows of the default light"
    assert by_default in said(8, MATTE, light=False)
    assert by_default not in said(1, MATTE, light=False) + said(8, MATTE, light=False, default_light=False)
    assert SHADOWS in said(8, MATTE, ambient=1.0) and SHADOWS in said(8, MATTE, light=False)
    assert SHADOWS not in said(8, MATTE) + said(8, MATTE, light=False, ambient=0.0)
    assert said(8, METAL, ambient=1.0).endswith(f"the reference has them.{LOSS}")
    for other in (replace(METAL, metallic=0.0), replace(METAL, roughness=0.2), replace(METAL, unlit=True)):
        assert LOSS not in said(8, other, ambient=1.0)
    assert LOSS not in said(8, METAL)


def pictures(number, scene, paths=64, view=ABOVE, **turned):
    """Return the red light of a chapter's picture and of its reference in nits, and what is said to be left out."""
    scene.ev100 = 0.0
    own = replaced(preset(chapters.settings_class(number), "reference"), **turned)
    more = {"size": SIZE, "settings": own, "outputs": {"color_linear"}}
    with chapters.open(number, "vulkan", scene=scene, **more) as renderer:
        drawn = renderer.render(view).image("color_linear")[..., 0]
    light, _ = reference(
        number, scene, view, SIZE, 0.0, paths=paths, settings=own, cached=False, backend="vulkan"
    )
    return drawn.astype(float), light[..., 0].astype(float), settings.differences(number, own, scene)


def above_the_ground(material, x=1.2, height=0.6, edge=0.8, light=True):
    """Return a ground and a square over it, and a sun that casts the shadow of the square into the picture."""
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((x, height, 0), (edge, edge), (0, 1, 0)))
    scene = quad_scene(materials=(MATTE, material), matrices=squares, instance_materials=(0, 1))
    if not light:
        return scene
    lamp, pose = sun((-1.0, -0.6, 0.0))
    return replace(scene, lights=[replace(lamp, node=2)], nodes=nodes_at(*squares, pose))


@pytest.mark.parametrize("material", [MATTE, GLASS])
def test_shadows_of_blended_surfaces_are_in_the_reference_alone(material):
    drawn, light, said = pictures(8, above_the_ground(material))
    share = light.min() / np.median(light)
    if material is GLASS:
        assert np.ptp(drawn) < 1e-3 * drawn.max() and 0.3 < share < 0.7
    else:
        assert drawn.min() < 0.01 * drawn.max() and share < 0.3
    assert ("no shadows of blended surfaces" in said) == (material is GLASS)


def test_shadows_of_the_default_light_are_in_the_reference_alone():
    """Seen past a square: the light stands above and beside the camera."""
    drawn, light, said = pictures(8, above_the_ground(MATTE, 0.2, 0.4, 0.6, light=False), ambient=0.0)
    assert np.ptp(drawn) < 1e-3 * drawn.max() and light.min() < 0.3 * np.median(light)
    assert "no shadows of the default light" in said


def test_shadows_of_ambient_light_are_in_the_reference_alone():
    scene = above_the_ground(MATTE, 1.2, 0.3, 1.6, light=False)
    drawn, light, said = pictures(1, scene, ambient=1.0, default_light=False)
    assert np.ptp(drawn) < 1e-3 * drawn.max()
    beside = light[:, 9:11].mean()  # left of the square, whose half of the sky is missing in part
    assert beside < 0.92 * drawn.max() and light[:, :2].mean() > 0.93 * drawn.max() and SHADOWS in said


def test_fog_between_surfaces_and_lights_is_in_the_reference_alone():
    """Black fog sends no light to the eye, and takes the same part of it in both."""
    placed_ground = placed((0, 0, 0), (8, 8), (0, 1, 0))
    lamp, pose = point((0.0, 2.0, 0.0))
    scene = quad_scene(MATTE, matrices=(placed_ground,))
    scene = replace(scene, lights=[replace(lamp, node=1)], nodes=nodes_at(placed_ground, pose))
    scene.medium = Medium(extinction=0.4, albedo=(0.0, 0.0, 0.0))
    half = math.tan(0.3) * 3.0  # metres of the ground from the middle to the upper edge of the picture
    view = View(ABOVE.world_from_view, Perspective(0.6, 0.1))
    drawn, light, said = pictures(10, scene, paths=1024, view=view)
    x, z = np.moveaxis(places(View(ABOVE.world_from_view, Orthographic(half, 0.1, 9.0)), SIZE), -1, 0)
    arrives = np.exp(-0.4 * np.sqrt(x * x + 4.0 + z * z))
    # Three paths of ten get through the fog before the eye: 60,000 in all, so the mean is off by 0.4 % or so.
    assert light.mean() == pytest.approx((drawn * arrives).mean(), rel=0.015)
    assert "no fog between surfaces and lights" in said


@pytest.mark.parametrize(("roughness", "part"), [(1.0, 0.31), (0.2, 1.0)])
def test_rough_metals_reflect_all_of_the_ambient_light_in_chapters_alone(roughness, part):
    """A white metal seen along its normal. Between facets of roughness 1 two thirds are lost, and of 0.2 little."""
    scene = quad_scene(replace(METAL, roughness=roughness), matrices=(placed((0, 0, 0), (8, 8), (0, 1, 0)),))
    drawn, light, said = pictures(1, scene, ambient=1.0, default_light=False)
    assert np.abs(drawn - 1.0).max() < 2e-3 and light.mean() == pytest.approx(part, abs=0.02)
    assert (LOSS in said) == (part < 1.0)


@pytest.mark.long
def test_with_an_environment_that_keeps_energy_rough_metals_lose_nothing():
    """The environment sends next to nothing; with it, paths have the setting `energy`."""
    scene = quad_scene(METAL, matrices=(placed((0, 0, 0), (8, 8), (0, 1, 0)),))
    scene.environment = constant(1e-6)
    turned = {"ambient": 1.0, "energy": "compensated"}
    drawn, light, said = pictures(1, scene, **turned)
    assert np.abs(drawn - 1.0).max() < 2e-3 and light.mean() == pytest.approx(1.0, abs=0.05)
    assert LOSS not in said and "no shadows of the environment's light" in said
