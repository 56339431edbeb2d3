"""The G-buffer: what is in which target, which targets there are, and what their formats lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.settings import Settings
from chapters.ch07.shading.deferred import EMISSION, FORMATS, TARGETS
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material, TextureRef
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene
from tests.support.towns import town, walk

SIZE = (61, 35)
SURFACE = Material(base_color=(0.25, 0.5, 0.75, 1.0), roughness=0.4, metallic=0.6)
LAMP = replace(SURFACE, emissive=(3.0, 2.0, 1.0))
SUN = Light("directional", node=0, intensity=3.0)
AHEAD = View(pose_looking_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)), Orthographic(0.5, 0.1, 10.0), ev100=0.0)


def turned(angle: float) -> np.ndarray:
    """Return a matrix that turns about +y and then about +x."""
    c, s = np.cos(angle), np.sin(angle)
    about_y = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    about_x = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    return about_x @ about_y


def stored(chapter, scene, names, view=AHEAD, writer="gbuffer", **knobs):
    """Return targets of the G-buffer as numbers."""
    with chapter.open(
        scene, SIZE, Settings(anisotropy=1.0, graph="deferred", **knobs), inspect=True
    ) as renderer:
        frame = renderer.render(view)
        return {name: np.asarray(frame.image(f"{writer}/{name}")) for name in names}


def light_of(codes: np.ndarray) -> np.ndarray:
    """Return linear values of a colour target: those of 8 bits are codes of sRGB (IEC 61966-2-1)."""
    if codes.dtype != np.uint8:
        return codes.astype(np.float64)
    values = codes / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def values_of(codes: np.ndarray) -> np.ndarray:
    """Return the numbers of a target that is not in sRGB."""
    return codes / 255.0 if codes.dtype == np.uint8 else codes.astype(np.float64)


def normal_of(stored_normal: np.ndarray, format: str) -> np.ndarray:
    """Return the unit normal of a stored one, by the definition of its format."""
    if FORMATS[format][1] == "r32ui":
        halves = (
            np.stack([stored_normal & 0xFFFF, stored_normal >> 16], axis=-1).astype(np.uint16).view(np.int16)
        )
        p = np.maximum(halves / 32767.0, -1.0)
        n = np.concatenate([p, 1 - np.abs(p).sum(axis=-1, keepdims=True)], axis=-1)
        t = np.maximum(-n[..., 2:], 0)
        n[..., :2] -= np.where(n[..., :2] >= 0, t, -t)
    else:
        n = stored_normal[..., :3].astype(np.float64)
        n = (n * 1023 - 512) / 511 if FORMATS[format][1] == "rgb10a2" else n
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


@pytest.mark.feature("gbuffer/layout")
@pytest.mark.parametrize(
    ("format", "color", "degrees"),
    # sRGB of 8 bits: half a step of the code is 0.0046 at 0.75; ten bits and halves by their steps.
    [
        pytest.param("octahedral", 0.005, 0.004, marks=pytest.mark.core),
        ("compact", 0.005, 0.11),
        pytest.param("half", 0.005, 0.06, marks=pytest.mark.long),
        ("full", 1e-6, 1e-4),
    ],
)
def test_a_quad_is_kept_as_its_formats_say(chapter, format, color, degrees):
    """Base colour, normal and material of a turned quad; its normal is a column of the matrix that turns it."""
    matrix = turned(0.4)
    scene = quad_scene(SURFACE, matrices=(matrix,), lights=(SUN,))
    got = stored(chapter, scene, TARGETS, gbuffer_format=format)
    middle = (SIZE[1] // 2, SIZE[0] // 2)
    np.testing.assert_allclose(light_of(got[TARGETS[0]][middle])[:3], SURFACE.base_color[:3], atol=color)
    n = normal_of(got[TARGETS[1]][middle], format)
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(n, matrix[:3, 2])), n @ matrix[:3, 2]))
    assert angle <= degrees
    np.testing.assert_allclose(values_of(got[TARGETS[2]][middle]), (1.0, 0.4, 0.6, 1.0), atol=0.5 / 255)


@pytest.mark.feature("gbuffer/layout", "visibility-buffer/ids")
@pytest.mark.parametrize(
    "format", [pytest.param(it, marks=[pytest.mark.long] * (it in ("half", "full"))) for it in FORMATS]
)
def test_a_kernel_stores_the_codes_that_a_target_stores(chapter, format):
    """The base colour's code differs by one step of 8 bits at most: each rounds 255 times the same value by itself.

    The kernel stores octahedral normals for `compact`, too, since not every device stores channels of ten bits.
    """
    scene = quad_scene(SURFACE, matrices=(turned(0.4),), lights=(SUN,))
    drawn = stored(chapter, scene, TARGETS, gbuffer_format=format)
    kept = stored(
        chapter, scene, TARGETS, writer="visibility_resolve", gbuffer_format=format, surfaces="visibility"
    )
    middle = (SIZE[1] // 2, SIZE[0] // 2)
    color, _, material = (
        np.abs(kept[name][middle].astype(float) - drawn[name][middle].astype(float)).max() for name in TARGETS
    )
    assert color <= (1.0 if kept[TARGETS[0]].dtype == np.uint8 else 1e-6)
    assert material == 0.0
    normals = [
        normal_of(it[TARGETS[1]][middle], kind)
        for it, kind in ((drawn, format), (kept, "octahedral" if format == "compact" else format))
    ]
    degrees = {"octahedral": 0.008, "compact": 0.114, "half": 0.06, "full": 1e-4}[format]
    assert np.degrees(np.linalg.norm(normals[0] - normals[1])) <= degrees


@pytest.mark.feature("gbuffer/layout")
def test_no_position_is_stored_and_the_order_is_that_of_the_table(chapter):
    with chapter.open(quad_scene(LAMP, lights=(SUN,)), SIZE, Settings(graph="deferred")) as renderer:
        step = next(step for step in renderer.graph.steps if step.name == "gbuffer")
        names = [target.resource.removesuffix("_early") for target in step.colors]
        assert names == [*TARGETS, EMISSION]
        formats = [renderer.graph.resources[target.resource].format for target in step.colors]
        assert formats == list(FORMATS["octahedral"])


@pytest.mark.feature("gbuffer/position-from-depth")
@pytest.mark.parametrize("distance", [0.06, 1.0, 50.0, 3000.0])
def test_a_position_is_found_again_from_its_depth(chapter, distance):
    """A lamp as near to a plane as the plane is to the eye lights it by I cos / d^2, which tells the place.

    The plane faces the eye, and the lamp is at the eye: E = I / d^2 in the middle, so E is off by twice what d is.
    """
    eye = np.eye(4)
    eye[2, 3] = distance
    lamp = Light("point", node=1, intensity=distance * distance)
    chalk = replace(SURFACE, metallic=0.0, roughness=1.0)
    scene = quad_scene(chalk, matrices=(np.diag((distance, distance, 1.0, 1.0)), eye), lights=(lamp,))
    scene.instances.visible[1] = False
    view = View(pose_looking_at((0.0, 0.0, distance), (0.0, 0.0, 0.0)), Perspective(0.02, 0.05))
    settings = Settings(
        color_format="rgba32f",
        gbuffer_format="full",
        anisotropy=1.0,
        ambient=0.0,
        graph="deferred",
        light_cutoff=0.0,
    )
    lit = []
    for graph in ("deferred", "forward"):
        with chapter.open(
            scene, SIZE, replaced(settings, graph=graph), outputs=("color_linear",)
        ) as renderer:
            lit.append(
                renderer.render(view).image("color_linear")[SIZE[1] // 2, SIZE[0] // 2].astype(np.float64)
            )
    np.testing.assert_allclose(lit[0], lit[1], rtol=2e-3)
    assert lit[1].min() > 0
    assert not np.allclose(1.01 * lit[0], lit[1], rtol=2e-3), "half a percent of the distance would show"


# --- emission only where a material emits ---


@pytest.mark.feature("gbuffer/layout")
@pytest.mark.parametrize("graph", ["deferred", pytest.param("compute", marks=pytest.mark.long)])
def test_a_scene_without_emission_has_no_target_for_it(chapter, graph):
    """The pair: the target is not there, and the picture has the bits of a frame that keeps it."""
    pictures = []
    for skip in (True, False):
        settings = Settings(graph=graph, skip_unused=skip)
        with chapter.open(town(), SIZE, settings, outputs=("color_linear",)) as renderer:
            pictures.append(renderer.render(walk()[0]).image("color_linear").copy())
            assert (EMISSION in renderer.graph.names) == (not skip)
    assert np.array_equal(*pictures)


@pytest.mark.feature("gbuffer/layout")
@pytest.mark.parametrize(
    ("graph", "culling"), [("deferred", "occlusion"), pytest.param("compute", "off", marks=pytest.mark.long)]
)
def test_an_edit_lights_a_lamp_and_puts_it_out(chapter, graph, culling):
    """Each frame after an edit is that of a renderer which was opened with the edited scene."""
    settings = Settings(graph=graph, culling=culling, ambient=0.2)
    scene = town()
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        renderer.render(walk()[0])
        for emissive in ((3.0, 2.0, 1.0), (0.0, 0.0, 0.0)):
            with scene.edit() as edit:
                edit.set_material(0, replace(scene.materials[0], emissive=emissive))
            drawn = renderer.render(walk()[0]).image("color_linear").copy()
            assert (EMISSION in renderer.graph.names) == (max(emissive) > 0)
            with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as fresh:
                assert np.array_equal(drawn, fresh.render(walk()[0]).image("color_linear"))


@pytest.mark.feature("deferred/forward-and-deferred")
def test_forward_and_deferred_give_one_picture(chapter):
    """With 32 bits a channel they differ by the rounding of a position; octahedral normals add 0.004 degrees."""
    scene = replace(
        town(), materials=[replace(material, emissive=(0.2, 0.1, 0.0)) for material in town().materials]
    )
    pictures = {}
    for name, knobs in {
        "forward": {"graph": "forward"},
        "full": {"graph": "deferred", "gbuffer_format": "full"},
        "octahedral": {"graph": "deferred"},
    }.items():
        settings = Settings(color_format="rgba32f", anisotropy=1.0, ambient=0.3, **knobs)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            pictures[name] = renderer.render(walk()[0]).image("color_linear").astype(np.float64)
    np.testing.assert_allclose(pictures["full"], pictures["forward"], rtol=1e-3, atol=1e-4)
    error = np.abs(pictures["octahedral"] - pictures["forward"])
    assert np.quantile(error, 0.99) < 0.01, "8 bits of base colour lose half a percent"


@pytest.mark.feature("deferred/lighting")
@pytest.mark.parametrize("graph", ["deferred", "compute"])
def test_without_direct_light_a_pixel_keeps_ambient_times_occlusion(chapter, graph):
    """A quad whose back is to the sun: L = ambient x occlusion x (0.96 base + 0.04), of a dielectric."""
    map_ = Image("half", np.full((1, 1, 4), 102, np.uint8))
    material = Material(base_color=(0.25, 0.5, 0.75, 1.0), metallic=0.0, occlusion_texture=TextureRef(0))
    settings = Settings(
        color_format="rgba32f", gbuffer_format="full", anisotropy=1.0, ambient=2.0, graph=graph
    )
    wanted = 2.0 * 102 / 255 * (0.96 * np.array(material.base_color[:3]) + 0.04)
    for angle, behind in ((np.pi, True), (0.0, False)):
        about_y = np.diag((np.cos(angle), 1.0, np.cos(angle), 1.0))
        scene = quad_scene(
            material, matrices=(np.eye(4), about_y), lights=(replace(SUN, node=1),), images=(map_,)
        )
        scene.instances.visible[1] = False
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            middle = renderer.render(AHEAD).image("color_linear")[SIZE[1] // 2, SIZE[0] // 2]
        if behind:
            np.testing.assert_allclose(middle, wanted, rtol=2e-6)
        else:
            assert (middle > 1.1 * wanted).all()
