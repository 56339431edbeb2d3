"""The deferred path gives the picture of the forward path, as exactly as its G-buffer holds a surface.

What that means in each pixel is computed here in float64: the same lights on the surfaces that are read back, and how
far their light moves when a surface moves by what rounding may move it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch04.settings import Settings
from common.environment import constant
from common.images.color import decode_srgb
from common.scene import Light, Material, Scene
from common.settings import replaced
from common.view.camera import exposure
from tests.support.jumble import CAMERA, KINDS, jumble
from tests.support.scenes import facing, quad_scene, translated
from tests.twins import shading

pytestmark = pytest.mark.variants("vulkan", "gl")  # no optional feature takes part in lighting

SIZE = (40, 32)
FULL = Settings(color_format="rgba32f", gbuffer_format="full", ambient=0.3, anisotropy=1.0)
EPS = 2.0**-24
"""Half a step of a float32 at 1."""

Surfaces = dict[str, np.ndarray]


def frame_of(chapter, scene, settings, graph, view=CAMERA, inspect=False, size=SIZE):
    """Return the light of one frame, (H, W, 3) float64, and if `inspect` what the G-buffer holds, decoded."""
    chosen = replaced(settings, graph=graph)
    with chapter.open(scene, size, chosen, outputs={"color_linear"}, inspect=inspect) as renderer:
        frame = renderer.render(view)
        light = frame.image("color_linear").astype(np.float64)
        return (light, surfaces(frame, view, settings, size, scene)) if inspect else light


def surfaces(frame, view, settings, size, scene) -> Surfaces:
    """Return the surfaces of a frame in float64: place in the world, and what the G-buffer holds."""
    stored = {
        name: frame.image(f"gbuffer/gbuffer_{name}").astype(np.float64)
        for name in ("base_color", "normal", "material", "emissive")
    }
    if settings.shading.gbuffer_format == "half":
        stored["base_color"] = decode_srgb(stored["base_color"] / 255)
        stored["material"] /= 255
    depth = frame.image("gbuffer/depth").astype(np.float64)
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, (np.arange(height) + 0.5) / height * 2 - 1)
    world_from_clip = np.linalg.inv(view.clip_from_world(width / height))
    clip = np.stack([x, y, np.maximum(depth, 1e-9), np.ones_like(x)], axis=-1)
    world = clip @ world_from_clip.T
    return stored | {"position": world[..., :3] / world[..., 3:], "there": depth > 0}


def lit(held: Surfaces, scene: Scene, settings, view=CAMERA) -> np.ndarray:
    """Return the light that leaves surfaces towards the eye under a scene's lights, in float64."""
    place, base = held["position"], held["base_color"][..., :3]
    occlusion, roughness, metallic, counts = np.moveaxis(held["material"], -1, 0)
    normal = held["normal"][..., :3]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    to_eye = view.eye - place
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    total = np.zeros_like(base)
    for light in scene.lights:
        strength = light.intensity * exposure(view.ev100) * np.ones(place.shape[:-1])
        at = scene.nodes.matrix[light.node][:3, 3]
        towards = at - place if light.kind != "directional" else np.broadcast_to((0.0, 0.0, 1.0), place.shape)
        distance = np.linalg.norm(towards, axis=-1)
        towards = towards / distance[..., None]
        if light.kind != "directional":
            strength = strength / distance**2
        if light.kind == "spot":
            strength = strength * shading.spot_cone(towards[..., 2], light.inner_cone, light.outer_cone)
        alpha = np.maximum(roughness**2, 1e-3)
        total += strength[..., None] * shading.metallic_roughness(
            normal, towards, to_eye, base, metallic, alpha
        )
    albedo = base * metallic[..., None] + (0.96 * base + 0.04) * (1 - metallic[..., None])
    total += settings.scene.ambient * exposure(view.ev100) * occlusion[..., None] * albedo
    return total * (counts > 0.5)[..., None] + held["emissive"][..., :3]


def moved(held: Surfaces, name: str, channel: int, by: Callable[[np.ndarray], np.ndarray]) -> list[Surfaces]:
    """Return the surfaces with one number moved up and down by what `by` says of it."""
    found = []
    for sign in (-1.0, 1.0):
        other = held[name].copy()
        other[..., channel] += sign * by(held[name][..., channel])
        found.append(held | {name: other})
    return found


def spread(
    held: Surfaces, scene, settings, steps: dict[str, Callable[[np.ndarray], np.ndarray]]
) -> np.ndarray:
    """Return how far the light moves, (H, W, 3), if every number moves by its step: all added up."""
    middle = lit(held, scene, settings)
    total = np.zeros_like(middle)
    for name, by in steps.items():
        for channel in range(3):
            both = [np.abs(lit(one, scene, settings) - middle) for one in moved(held, name, channel, by)]
            total += np.maximum(*both)
    return total


def rounding(held: Surfaces, scene, settings) -> np.ndarray:
    """Return what a place that is off by rounding, and the sums over the lights, may change.

    A place is found by a product of three matrices and vectors whose numbers are as large as the way to the eye and
    back: 4 products in each of 3 sums, each rounded. The forward path interpolates it, rounding as often.
    """
    reach = np.linalg.norm(CAMERA.eye) * 2 + 2
    places = spread(held, scene, settings, {"position": lambda x: np.full_like(x, 12 * EPS * reach)})
    # A highlight's D is a fourth power of differences of unit vectors: some 100 roundings on the way.
    return places + 100 * EPS * (lit(held, scene, settings) + 1.0)


SOLID = tuple(kind for kind in KINDS if kind.alpha_mode != "blend")


@pytest.mark.feature("deferred/forward-and-deferred")
@pytest.mark.parametrize("seed", [1, 2])
def test_in_full_precision_both_paths_differ_by_the_rounding_of_a_place(chapter, seed):
    """Under a point light, a spot and a sun: surfaces of all kinds, transparent ones before and behind them."""
    scene = jumble(seed)
    forward = frame_of(chapter, scene, FULL, "forward")
    deferred, held = frame_of(chapter, scene, FULL, "deferred", inspect=True)
    bound = np.where(held["there"][..., None], rounding(held, scene, FULL), 4 * EPS)
    assert held["there"].mean() > 0.2
    assert (bound < 1e-3 * (1.0 + forward)).mean() > 0.95, "a bound that holds nothing"
    ratio = (np.abs(deferred - forward) / (bound + 4 * EPS * forward)).max()
    # Hardware interpolates places by weights of fewer bits, and its roots and quotients are a few units off: 10.5 times
    # the bound of exact rounding on an H200.
    assert ratio <= (1.0 if chapter.device.capabilities.is_software else 12.0), ratio


@pytest.mark.core
@pytest.mark.feature("deferred/forward-and-deferred")
def test_lighting_is_that_of_the_formulas_on_what_was_stored(chapter):
    scene = jumble(3, SOLID)
    for kind in ("full", "half"):
        settings = replaced(FULL, gbuffer_format=kind)
        deferred, held = frame_of(chapter, scene, settings, "deferred", inspect=True)
        there = held["there"]
        bound = rounding(held, scene, settings)
        if kind == "half":  # a texture unit may decode a code of colour as half a code beside it
            half = {"base_color": lambda x: 0.5 / 255 * 2.4 / 1.055 * np.maximum(x, 1e-3) ** (1.4 / 2.4)}
            bound = bound + spread(held, scene, settings, half)
        off = np.abs(deferred - lit(held, scene, settings))
        assert (off[there] <= bound[there]).all(), kind
        assert np.allclose(deferred[~there], settings.shading.background, atol=1e-6)


@pytest.mark.feature("deferred/forward-and-deferred")
def test_in_few_bits_both_paths_differ_by_the_steps_of_the_formats(chapter):
    """Half a code of 8 bits, of a colour as of a factor, and 2^-12 of a normal's component: all at their worst."""
    scene = jumble(4, SOLID)
    settings = replaced(FULL, gbuffer_format="half")
    forward = frame_of(chapter, scene, settings, "forward")
    deferred, held = frame_of(chapter, scene, settings, "deferred", inspect=True)
    code = 0.6 / 255
    steps = {
        # The slope of sRGB's curve at x, from code to light, and no less than that of its straight beginning.
        "base_color": lambda x: code * np.maximum(2.4 / 1.055 * np.maximum(x, 0.0) ** (1.4 / 2.4), 1 / 12.92),
        "material": lambda x: np.full_like(x, code),
        "normal": lambda x: np.full_like(x, 2.0**-12),
        "emissive": lambda x: 2.0**-11 * x,
    }
    there = held["there"]
    bound = 1.5 * spread(held, scene, settings, steps) + rounding(held, scene, settings)
    off = np.abs(deferred - forward)
    assert (off[there] <= bound[there]).all()
    assert 1e-4 < off[there].max() < 0.5, "the formats show, and not by much"
    assert np.array_equal(deferred[~there], forward[~there])


@pytest.mark.parametrize("shown", [True, False])
def test_an_environment_and_its_sky_are_the_same_on_both_paths(chapter, shown):
    scene = replace(jumble(5, KINDS[:3]), environment=constant((0.4, 0.5, 0.9)), lights=[])
    quick = replaced(
        FULL, environment_size=16, irradiance_source=4, table_size=8, table_samples=16, sky=shown
    )
    forward, deferred = (frame_of(chapter, scene, quick, graph) for graph in ("forward", "deferred"))
    behind = (0.4, 0.5, 0.9) if shown else (quick.shading.background,) * 3
    nothing = np.isclose(forward, behind, rtol=2e-3).all(axis=-1)
    assert 0.3 < nothing.mean() < 0.9
    # Light that is the same from everywhere does not depend on the place; the direction to the eye does, a little.
    assert np.abs(forward - deferred).max() <= 1e-4
    assert np.array_equal(forward[nothing], deferred[nothing])


def test_an_orthographic_view_is_the_same_on_both_paths(chapter):
    scene, view = jumble(6), facing(5.0, 2.0)
    forward, deferred = (frame_of(chapter, scene, FULL, graph, view) for graph in ("forward", "deferred"))
    assert np.abs(forward - deferred).max() <= 1e-4 * forward.max()
    assert forward.std() > 0.01


def test_only_what_the_scene_needs_is_there(chapter):
    """No pass for what is transparent where nothing is, and no pipeline of the forward path's."""
    lamp = Light("point", node=0, intensity=30.0)
    opaque = quad_scene(Material(), matrices=(translated(0, 0, -1),), lights=(lamp,))
    glass = quad_scene(
        materials=(Material(), Material(alpha_mode="blend", base_color=(1, 1, 1, 0.5))),
        matrices=(translated(0, 0, -1), np.eye(4)),
        instance_materials=(0, 1),
        lights=(lamp,),
    )
    for scene, passes, pipelines in (
        (opaque, ["gbuffer", "lighting", "tonemap"], 3),
        (glass, ["gbuffer", "lighting", "transparent", "tonemap"], 4),
    ):
        with chapter.open(scene, (8, 8), replaced(FULL, graph="deferred")) as renderer:
            frame = renderer.render(facing())
            assert [made.name for made in renderer.passes] == passes
            assert frame.work["pipelines"] == pipelines


def test_a_view_takes_the_forward_path(chapter):
    """A G-buffer holds no view's quantity: asked for one, the deferred graph gives way."""
    scene = quad_scene(Material())
    with chapter.open(scene, (8, 8), replaced(FULL, graph="deferred", view="normal")) as renderer:
        shown = renderer.render(facing()).image("color")
        assert [made.name for made in renderer.passes] == ["forward", "tonemap"]
    assert np.abs(shown.astype(int) - (128, 128, 255)).max() <= 1


def test_an_edit_that_makes_a_surface_transparent_brings_the_pass_for_it(chapter):
    lamp = Light("directional", node=0, intensity=2.0)
    scene = quad_scene(
        materials=(Material(base_color=(0.1, 0.2, 0.9, 1)), Material(base_color=(0.9, 0.3, 0.1, 1))),
        matrices=(translated(0, 0, -1), np.diag((0.5, 0.5, 1.0, 1.0))),
        instance_materials=(0, 1),
        lights=(lamp,),
    )
    with (
        chapter.open(scene, (16, 16), replaced(FULL, graph="forward"), outputs={"color_linear"}) as forward,
        chapter.open(scene, (16, 16), replaced(FULL, graph="deferred"), outputs={"color_linear"}) as deferred,
    ):

        def both() -> np.ndarray:
            pictures = [made.render(facing()).image("color_linear") for made in (forward, deferred)]
            assert np.allclose(*pictures, rtol=1e-5, atol=1e-6)
            return pictures[0]

        before = both()
        with scene.edit() as edit:
            edit.set_material(1, Material(base_color=(0.9, 0.3, 0.1, 0.5), alpha_mode="blend"))
        through = both()
        assert np.abs(before - through).max() > 0.01
        with scene.edit() as edit:
            edit.set_material(1, Material(base_color=(0.9, 0.3, 0.1, 1)))
        assert np.array_equal(both(), before)
