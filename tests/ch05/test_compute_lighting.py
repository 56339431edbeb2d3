"""Lighting as compute: at every pixel of any picture the light of the fragment shader, drawn over and made anew."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch05.graph.plan import COPY
from chapters.ch05.pipelines import gl as on_gl
from chapters.ch05.pipelines import vulkan as on_vulkan
from chapters.ch05.settings import Settings
from common.environment import Environment
from common.errors import ShaderError, UserError
from common.files import shader_files
from common.scene import Material
from common.settings import replaced
from tests.support.drivers import needs_line_marks
from tests.support.jumble import CAMERA, jumble
from tests.support.scenes import facing, quad_scene

SETTINGS = Settings(ambient=0.3, anisotropy=1.0)
SKY = {
    "environment_size": 16,
    "environment_detail": 2.0,
    "irradiance_source": 4,
    "table_size": 8,
    "table_samples": 16,
}
OUTPUTS = {"color", "color_linear", "depth"}
LINE = "    light();\n"
"""Of lighting.comp, where the colour is known."""


@pytest.fixture(scope="module")
def scene():
    return jumble(3)


@pytest.fixture(scope="module")
def lit_scene():
    """Return the same under a sky that differs in every direction."""
    radiance = np.random.default_rng(7).uniform(0.1, 4.0, (8, 16, 3)).astype(np.float32)
    return replace(jumble(3), environment=Environment("a sky of a test", radiance))


@pytest.fixture
def open_(chapter, scene):
    """Return a function that opens a renderer whose frame is lit by a graph, closed at the end."""
    made = []

    def opened(graph, size=(40, 32), shown=None, **turned):
        settings = replaced(SETTINGS, graph=graph, **turned)
        made.append(chapter.open(shown or scene, size, settings, outputs=OUTPUTS))
        return made[-1]

    yield opened
    for renderer in made:
        renderer.close()


def linear(frame):
    return frame.image("color_linear").astype(np.float64)


def assert_alike(renderer, one, other):
    """Hold two frames to each other: one 8-bit step anywhere, and the same bits where the device computes in software.

    What a compiler makes of one function in two kinds of shader, and how a store rounds, is each device's own.
    """
    shown, wanted = (frame.image("color").astype(int) for frame in (one, other))
    assert np.abs(shown - wanted).max() <= 1
    if renderer.capabilities.is_software:
        assert np.array_equal(one.image("color_linear"), other.image("color_linear"))


SIZES = ((1, 1), (16, 8), (9, 7), (65, 33))


@pytest.mark.feature("compute/fullscreen-lighting")
@pytest.mark.parametrize(
    "formats", [("rgba16f", "compact"), pytest.param(("rgba32f", "full"), marks=pytest.mark.long)]
)
def test_compute_lights_every_pixel_as_fragments_do(open_, formats):
    """Lamps of all kinds on surfaces of all kinds, and blended ones drawn over what was stored, at any size."""
    names = ("color_format", "gbuffer_format")
    turned = dict(zip(names, formats, strict=True))
    drawn, computed = (open_(graph, SIZES[0], **turned) for graph in ("deferred", "compute"))
    assert "lighting_compute" in {step.name for step in computed.graph.steps} >= {"transparent"}
    for size in SIZES:
        for renderer in (drawn, computed):
            renderer.resize(size)
        for _ in range(2):
            one, other = drawn.render(CAMERA), computed.render(CAMERA)
            assert_alike(drawn, one, other)
    assert linear(one).std() > 0.05, "a picture of nothing would prove nothing"


@pytest.mark.long
@pytest.mark.variants("vulkan", "gl")
def test_compute_looks_up_sky_and_environment_as_fragments_do(open_, lit_scene):
    """A pixel's direction is interpolated for a fragment, and computed for an invocation: equal but for rounding."""
    drawn, computed = (
        open_(graph, (25, 15), lit_scene, **SKY).render(CAMERA) for graph in ("deferred", "compute")
    )
    assert np.abs(drawn.image("color").astype(int) - computed.image("color").astype(int)).max() <= 1
    sky = drawn.image("depth") == 0
    assert 0.1 < sky.mean() < 0.9
    np.testing.assert_allclose(linear(computed), linear(drawn), rtol=2e-3, atol=1e-5)


def test_a_frame_is_lit_by_one_dispatch_and_recorded_once(open_):
    drawn, computed = (open_(graph) for graph in ("deferred", "compute"))
    works = [[renderer.render(CAMERA).work for _ in range(4)] for renderer in (drawn, computed)]
    assert [work["dispatches"] for work in works[0] + works[1]] == [0] * 4 + [1] * 4
    assert [work["recorded"] for work in works[1]] == [1, 1, 0, 0]
    assert works[1][3]["pipelines"] == works[0][3]["pipelines"]
    assert works[1][3]["draws"] == works[0][3]["draws"] - 1, "the triangle over the picture is not drawn"


@pytest.mark.core
def test_poisoned_memory_never_shows(open_):
    plain, poisoned = open_("compute", (33, 17)), open_("compute", (33, 17), poison="depth 1")
    for _ in range(3):
        wanted, found = plain.render(CAMERA), poisoned.render(CAMERA)
    assert np.array_equal(wanted.image("color_linear"), found.image("color_linear"))


def test_a_material_of_another_kind_is_followed(open_):
    """The scene's set is made anew then, for compute as for draws, and the kernel is another one."""
    scene = quad_scene(Material(base_color=(0.5, 0.5, 0.5, 1.0), unlit=True))
    kept = open_("compute", (35, 9), scene)
    before = linear(kept.render(facing()))
    with scene.edit() as edit:
        edit.set_material(0, Material(base_color=(0.5, 0.5, 0.5, 1.0), roughness=0.7))
    found = [kept.render(facing()) for _ in range(3)][-1]
    assert not np.array_equal(linear(found), before)
    assert_alike(kept, found, open_("deferred", (35, 9), scene).render(facing()))


@pytest.mark.variants("vulkan", "gl")
def test_an_empty_scene_is_its_background(open_):
    scene = quad_scene(matrices=())
    frame = open_("compute", (9, 7), scene).render(facing())
    found = linear(frame)[..., :3]
    assert found.shape == (7, 9, 3) and np.ptp(found) == 0.0 and found.max() > 0.0


@pytest.mark.feature("compute/fullscreen-lighting")
@pytest.mark.variants("vulkan", "gl")
def test_the_graph_says_when_it_cannot_be(open_):
    with pytest.raises(UserError, match=r"compute\.json has a G-buffer, which holds one sample a pixel"):
        open_("compute", msaa=4)
    with pytest.raises(UserError, match=r"no graph 'computed'.*compute"):
        open_("computed")


@pytest.mark.variants("vulkan", "gl")
def test_an_edited_kernel_is_taken_over_and_a_wrong_one_changes_nothing(
    chapter, open_, tmp_path, monkeypatch
):
    needs_line_marks(chapter.device)
    folder = tmp_path / "chapter"
    shutil.copytree(on_vulkan.CHAPTER, folder, ignore=shutil.ignore_patterns("*.py", "*.md", "studies"))
    monkeypatch.setattr(on_vulkan, "CHAPTER", folder)
    monkeypatch.setattr(on_gl, "CHAPTER", folder)
    file = folder / "shading/lighting.comp"
    text = file.read_text("utf-8")
    assert text.count(LINE) == 1

    def save(line):
        file.write_text(text.replace(LINE, LINE + line), "utf-8")
        with shader_files.refreshed([file]):
            return renderer.reload_shaders({file})

    renderer = open_("compute", color_format="rgba32f")
    before = linear(renderer.render(CAMERA))
    assert file in renderer.shader_files
    assert save("    out_color.rgb = vec3(0.0, 1.0, 0.0);\n").pipelines == ("lighting_compute",)
    green = linear(renderer.render(CAMERA))
    assert not np.array_equal(green, before) and np.ptp(green, (0, 1)).max() > 0, (
        "blended objects lie over it"
    )
    with pytest.raises(ShaderError, match=r"lighting\.comp:\d+"):
        save("    out_color = 1.0;\n")
    with pytest.raises(ShaderError):  # what nobody binds
        save("    out_color += imageLoad(other, pixel);\n")
    assert np.array_equal(linear(renderer.render(CAMERA)), green)
    assert save("").pipelines == ("lighting_compute",)
    assert np.array_equal(linear(renderer.render(CAMERA)), before)


def test_only_the_compute_pass_makes_another_step(open_):
    steps = [[step.name for step in open_(graph).graph.steps] for graph in ("deferred", "compute")]
    assert [name.removesuffix("_compute") for name in steps[1]] == steps[0]
    assert steps[0][-1] == COPY
