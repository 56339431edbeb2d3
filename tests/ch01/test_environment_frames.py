"""What the environment adds to a frame: the sky, the light on surfaces, nothing where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.environment import model as logic
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.environment import ENERGIES, Environment, constant
from common.environment.directions import panorama_directions
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.settings import replaced
from common.view.camera import View, exposure
from tests.support.chapter import as_modelled, on_opengl, on_path
from tests.support.scenes import facing, quad_scene, translated
from tests.twins import shading_environment as ibl

SIZE = (16, 16)
EXACT = Settings(
    color_format="rgba32f",
    background=0.0,
    tone_curve="none",
    environment_size=32,
    irradiance_source=16,
    table_samples=256,
)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Let no test find maps that another one, or the user, has kept."""
    folder = tmp_path / "environment"
    folder.mkdir()
    monkeypatch.setattr(logic, "cache_dir", lambda name: folder)


def smooth():
    """Return an environment that is different in every direction."""
    d = panorama_directions(128)
    return Environment("smooth", (1.0 + 0.5 * d).astype(np.float32))


def around(scene, environment):
    """Return the scene in an environment."""
    scene.environment = environment
    return scene


def draw(device, scene, view, settings=EXACT, size=SIZE, output="color_linear"):
    """Return one output of one frame, and its work."""
    settings = as_modelled(on_path(settings), 1)
    with Renderer(scene, size, settings, outputs={output}, device=device) as made:
        frame = made.render(view)
        return frame.image(output), frame.work


def looking(eye, direction):
    """Return a view from `eye` along `direction`."""
    eye = np.asarray(eye, np.float64)
    return View(pose_looking_at(eye, eye + direction))


@pytest.mark.newest
@pytest.mark.feature("environment/skybox")
def test_the_sky_is_the_environment_where_nothing_was_drawn(vulkan_device):
    scene = around(quad_scene(Material(unlit=True, base_color=(0, 0, 0, 1))), smooth())
    for direction in ((0.3, 0.2, -1.0), (1.0, -0.5, 0.2), (-0.2, 0.9, 0.5)):
        d = np.array(direction) / np.linalg.norm(direction)
        pictures = [
            draw(vulkan_device, scene, looking(e, d), size=(17, 17))[0] for e in ((0, 0, -9), (50, 70, -90))
        ]
        assert np.abs(pictures[0][8, 8] - (1 + 0.5 * d)).max() < 4e-3
        assert np.abs(pictures[0][8, 8] - (1 - 0.5 * d)).max() > 0.1, "what is behind is another light"
        assert np.array_equal(*pictures)  # where the camera stands changes nothing
    picture, _ = draw(vulkan_device, scene, facing())
    assert (picture == 0).all()  # the square fills the view, and is black
    bright = replaced(EXACT, environment_intensity=2.0)
    view = looking((0, 0, -9), np.array([0.0, 0.0, -1.0]))
    once, twice = (draw(vulkan_device, scene, view, one, (17, 17))[0] for one in (EXACT, bright))
    assert (once > 0).all() and np.allclose(twice, 2 * once, rtol=1e-6)
    turned = replaced(EXACT, environment_turn=90.0)
    picture, _ = draw(vulkan_device, scene, looking((0, 0, 9), np.array([0.0, 0.0, 1.0])), turned, (17, 17))
    assert np.abs(picture[8, 8] - (0.5, 1.0, 1.0)).max() < 4e-3  # what was on the left came behind


@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize(("metallic", "roughness"), [(1.0, 1.0), (0.0, 0.3), (0.5, 0.6)])
def test_a_square_in_uniform_light(vulkan_device, energy, metallic, roughness):
    """Seen head on by an orthographic camera: one direction, one number, by quadrature."""
    material = Material(base_color=(0.9, 0.5, 0.1, 1.0), metallic=metallic, roughness=roughness)
    scene = around(quad_scene(material), constant((2.0, 3.0, 4.0)))
    settings = replaced(EXACT, energy=energy, environment_intensity=1.5)
    picture, work = draw(vulkan_device, scene, facing(), settings)
    assert work["lights"] == 0  # the default light is for scenes without any
    table = ibl.albedo_table(1.0, roughness)
    mirrored, spread = ibl.weights((0.9, 0.5, 0.1), metallic, table, energy)
    assert np.allclose(picture, (mirrored + spread) * 1.5 * np.array([2.0, 3.0, 4.0]), rtol=5e-3)


@pytest.mark.newest
def test_exposure_and_transparency(vulkan_device):
    """The sky is seen through what is transparent; what a frame holds is exposed, and divided out again."""
    glass = Material(base_color=(0, 0, 0, 0.5), unlit=True, alpha_mode="blend")
    scene = around(quad_scene(glass, matrices=(translated(0, 0, 0),)), constant(8.0))
    picture, _ = draw(vulkan_device, scene, replace(facing(), ev100=5.0))
    assert np.allclose(picture, 4.0, rtol=2e-3)
    color, _ = draw(vulkan_device, scene, replace(facing(), ev100=5.0), output="color")
    coded = 4.0 * exposure(5.0)
    assert np.abs(color.astype(float) / 255 - (1.055 * coded ** (1 / 2.4) - 0.055)).max() < 0.01


def test_no_light_from_afar_is_no_environment(vulkan_device):
    """Work and picture in pairs: intensity 0, and no environment, make no maps, no pipeline and no sky."""
    light = Light("directional", node=0, intensity=3.0)
    plain = quad_scene(Material(metallic=0.3), lights=(light,))
    truth, work = draw(vulkan_device, plain, facing())
    dark, dark_work = draw(
        vulkan_device,
        around(quad_scene(Material(metallic=0.3), lights=(light,)), constant()),
        facing(),
        replaced(EXACT, environment_intensity=0.0),
    )
    assert np.array_equal(truth, dark)
    assert work == dark_work
    black, more = draw(
        vulkan_device, around(quad_scene(Material(metallic=0.3), lights=(light,)), constant(0.0)), facing()
    )
    assert np.array_equal(truth, black)
    assert more["draws"] == work["draws"] + 1
    seen, less = draw(
        vulkan_device,
        around(quad_scene(Material(metallic=0.3), lights=(light,)), constant(0.0)),
        facing(),
        replaced(EXACT, sky=False),
    )
    assert np.array_equal(truth, seen)
    assert less["draws"] == work["draws"]


def test_a_second_start_makes_nothing(vulkan_device, monkeypatch):
    scene = around(quad_scene(Material()), smooth())
    first, _ = draw(vulkan_device, scene, facing())
    monkeypatch.setattr(logic, "write_maps", None)  # nothing is made, so nothing is kept
    monkeypatch.setattr(logic, "write_table", None)
    second, _ = draw(vulkan_device, scene, facing())
    assert np.array_equal(first, second)


@pytest.mark.feature("environment/skybox")
@pytest.mark.parametrize("energy", ["gltf", "conserving"])
def test_opengl_draws_the_same(vulkan_device, gl_context, energy):
    OpenGL = on_opengl(Renderer)
    scene = around(
        quad_scene(
            materials=(Material(roughness=0.3), Material(metallic=0.0, base_color=(0.8, 0.3, 0.2, 1.0))),
            matrices=(translated(-0.5, 0, 0), translated(1.0, 0.3, -1.0)),
            instance_materials=(0, 1),
        ),
        smooth(),
    )
    settings = replaced(EXACT, energy=energy, environment_turn=30.0)
    view = looking((2.0, 1.0, 4.0), np.array([-0.4, -0.2, -1.0]))
    truth, work = draw(vulkan_device, scene, view, settings, (64, 48))
    plain = as_modelled(on_path(settings), 1)
    with OpenGL(scene, (64, 48), plain, outputs={"color_linear"}, device=gl_context) as made:
        frame = made.render(view)
        got = frame.image("color_linear")
        for name in ("draws", "triangles", "lights", "passes", "passes_skipped"):
            assert frame.work[name] == work[name]
    assert np.abs(got - truth).max() <= 1e-5 * max(1.0, truth.max())
