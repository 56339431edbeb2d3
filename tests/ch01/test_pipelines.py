"""Pipelines: equal descriptions share one, every switch changes its own state alone, variants exist where needed."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import fields, replace
from inspect import signature

import numpy as np
import pytest

from backends.gl import api as gl
from backends.vulkan import api as vk
from chapters.ch01.pipelines.description import PipelineDescription
from chapters.ch01.pipelines.vulkan import Pipelines
from chapters.ch01.pipelines.vulkan_descriptors import Descriptors
from chapters.ch01.renderer import Renderer
from chapters.ch01.scene.packing import ROLES, material_variant
from chapters.ch01.settings import Settings
from common.scene import Image, Light, Material
from tests.support import gl_functions
from tests.support.chapter import as_modelled, on_path
from tests.support.scenes import facing, quad_scene, texture, translated

FULLSCREEN = PipelineDescription(
    ("post/fullscreen.vert", "post/tonemap.frag"), color="rgba8", depth=None, name="plain"
)
SUN = Light("directional", node=0, intensity=math.pi)
PLAIN = as_modelled(on_path(Settings()), 1)


@pytest.fixture
def pipelines(vulkan_device):
    """Pipelines of a device; in chapter 1 they take set layouts from the descriptors."""
    with ExitStack() as stack:
        more = {}
        if "descriptors" in signature(Pipelines).parameters:
            more = {"descriptors": stack.enter_context(closing(Descriptors(vulkan_device)))}
        yield stack.enter_context(closing(Pipelines(vulkan_device, **more)))


@pytest.fixture
def fullscreen():
    """A pipeline with one texture, which `tonemap.frag` reads. In chapter 1 its description says so."""
    if "sets" not in {field.name for field in fields(PipelineDescription)}:
        return FULLSCREEN
    from chapters.ch01.post.fullscreen import SOURCE

    return replace(FULLSCREEN, sets=(SOURCE,))


class States(list):
    """A log that reads the state of each pipeline when it is made: the structs do not outlive the call."""

    def append(self, call):
        name, arguments = call
        if name == "vkCreateGraphicsPipelines":
            super().append(state(arguments[3][0]))


def created(device, made, described):
    """Return the state of the VkGraphicsPipelineCreateInfo with which `described` was built."""
    states = States()
    device.fn.trace(states)
    try:
        made.get([described])
    finally:
        device.fn.trace(None)
    (found,) = states
    return found


def state(info):
    """Return what a pipeline's state says, in plain numbers."""
    depth, blend = info.pDepthStencilState, info.pColorBlendState
    attachment = blend.pAttachments[0] if blend.attachmentCount else None
    rendering = vk.ffi.cast("VkPipelineRenderingCreateInfo *", info.pNext)
    dynamic = info.pDynamicState
    return {
        "depth test": depth.depthTestEnable,
        "depth write": depth.depthWriteEnable,
        "depth compare": depth.depthCompareOp,
        "blend": attachment.blendEnable if attachment else 0,
        "blend factors": (attachment.srcColorBlendFactor, attachment.dstColorBlendFactor)
        if attachment
        else (0, 0),
        "color": rendering.pColorAttachmentFormats[0] if rendering.colorAttachmentCount else 0,
        "depth format": rendering.depthAttachmentFormat,
        "dynamic": {dynamic.pDynamicStates[i] for i in range(dynamic.dynamicStateCount)},
    }


@pytest.mark.feature("device/graphics-pipelines")
def test_equal_descriptions_share_a_pipeline(pipelines, fullscreen, vulkan_device):
    first, second, other = pipelines.get(
        [fullscreen, replace(fullscreen), replace(fullscreen, color="rgba16f")]
    )
    assert first is second
    assert first.handle != other.handle
    assert first.layout == other.layout, "pipelines with the same sets share their layout too"
    assert len(pipelines) == 2
    log: list = []
    vulkan_device.fn.trace(log)
    assert pipelines.get([replace(fullscreen)])[0] is first
    vulkan_device.fn.trace(None)
    assert not log


@pytest.mark.feature("device/graphics-pipelines")
def test_a_switch_changes_its_own_state_alone(pipelines, fullscreen, vulkan_device):
    base = replace(fullscreen, depth="write")
    plain = created(vulkan_device, pipelines, base)
    compare = vk.VK_COMPARE_OP_GREATER_OR_EQUAL
    assert (plain["depth test"], plain["depth write"], plain["depth compare"]) == (1, 1, compare)
    cases = {
        "test": ({"depth": "test"}, {"depth write": 0}),
        "equal": ({"depth": "equal"}, {"depth write": 0, "depth compare": vk.VK_COMPARE_OP_EQUAL}),
        "none": (
            {"depth": None},
            {"depth test": 0, "depth write": 0, "depth format": vk.VK_FORMAT_UNDEFINED},
        ),
        "add": (
            {"blend": "add"},
            {"blend": 1, "blend factors": (vk.VK_BLEND_FACTOR_ONE, vk.VK_BLEND_FACTOR_ONE)},
        ),
        "over": (
            {"blend": "over"},
            {
                "blend": 1,
                "blend factors": (vk.VK_BLEND_FACTOR_SRC_ALPHA, vk.VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA),
            },
        ),
        "color": ({"color": "rgba32f"}, {"color": vk.VK_FORMAT_R32G32B32A32_SFLOAT}),
    }
    for name, (switch, changed) in cases.items():
        info = created(vulkan_device, pipelines, replace(base, **switch))
        assert {key: value for key, value in info.items() if value != plain[key]} == changed, name


def test_what_changes_from_draw_to_draw_is_dynamic(pipelines, fullscreen, vulkan_device):
    assert created(vulkan_device, pipelines, fullscreen)["dynamic"] == {
        vk.VK_DYNAMIC_STATE_VIEWPORT,
        vk.VK_DYNAMIC_STATE_SCISSOR,
        vk.VK_DYNAMIC_STATE_CULL_MODE,
        vk.VK_DYNAMIC_STATE_FRONT_FACE,
    }


@pytest.mark.until(1, "the size of push constants is read from the shaders once they are reflected")
def test_push_constants_fit_every_device(vulkan_device):
    from chapters.ch01.scene.packing import PUSH_SIZE

    assert PUSH_SIZE <= 128, "what every device has"
    assert vulkan_device.capabilities.limits["maxPushConstantsSize"] >= PUSH_SIZE


def test_shader_modules_go_when_the_pipeline_is_built(pipelines, fullscreen, vulkan_device):
    pipelines.get([fullscreen])
    assert not [kind for kind, _ in vulkan_device.alive if kind == "VkShaderModule"]


OPENGL = {
    "glDepthFunc": "depth compare",
    "glDepthMask": "depth write",
    "glUseProgram": "program",
    "glBlendFuncSeparate": "blend factors",
}
SWITCHES = {gl.GL_DEPTH_TEST: "depth test", gl.GL_BLEND: "blend", gl.GL_CULL_FACE: "cull"}


def bound_on_opengl(context, pipelines, described):
    """Return the state that a pipeline sets where it is bound, in plain numbers."""
    (built,) = pipelines.get([described])
    found = {}

    def note(name, arguments):
        if name in ("glEnable", "glDisable"):
            found[SWITCHES[arguments[0]]] = int(name == "glEnable")
        elif name in OPENGL:
            found[OPENGL[name]] = arguments if len(arguments) > 1 else arguments[0]

    with gl_functions.noted(context, note):
        pipelines.bind(built, True, "counter_clockwise")
    return found


@pytest.mark.until(1, "a pipeline's description is another one")
@pytest.mark.feature("device/graphics-pipelines")
def test_a_switch_changes_its_own_state_alone_on_opengl(gl_context):
    """Descriptions that are equal share a pipeline there, too, and binding it makes nothing."""
    from chapters.ch01.pipelines.gl import Pipelines as OpenGL

    base, made = (
        PipelineDescription(("post/fullscreen.vert", "post/tonemap.frag"), name="plain"),
        OpenGL(gl_context),
    )
    try:
        plain = bound_on_opengl(gl_context, made, base)
        assert (plain["depth test"], plain["depth write"], plain["depth compare"]) == (1, 1, gl.GL_GEQUAL)
        one, over = gl.GL_ONE, gl.GL_ONE_MINUS_SRC_ALPHA
        cases = {
            "test": ({"depth": "test"}, {"depth write": 0}),
            "equal": ({"depth": "equal"}, {"depth write": 0, "depth compare": gl.GL_EQUAL}),
            "none": ({"depth": None}, {"depth test": 0, "depth write": 0}),
            "add": ({"blend": "add"}, {"blend": 1, "blend factors": (one, one, one, one)}),
            "over": (
                {"blend": "over"},
                {"blend": 1, "blend factors": (gl.GL_SRC_ALPHA, over, one, over)},
            ),
        }
        for name, (switch, changed) in cases.items():
            found = bound_on_opengl(gl_context, made, replace(base, **switch))
            assert {key: value for key, value in found.items() if value != plain.get(key)} == changed, name
        with gl_functions.traced(gl_context) as calls:
            assert made.get([replace(base)])[0] is made.get([base])[0]
        assert calls == [] and len(made) == 1 + len(cases)
        (other,) = made.get([replace(base, defines=(("BACKGROUND", 1),))])
        assert other.handle != plain["program"], "another text is another program"
    finally:
        made.close()


# --- variants ---


@pytest.mark.until(1, "layouts come from the shaders, which these tests of chapter 2 hold")
@pytest.mark.feature("device/program-variants")
def test_two_vertex_and_three_fragment_shaders_make_six_pipelines_once(pipelines, vulkan_device, tmp_path):
    for number in range(2):
        (tmp_path / f"{number}.vert").write_text(
            f"layout(location = 0) out float c;\nvoid main() {{ c = {number}.5; gl_Position = vec4(0); }}"
        )
    for number in range(3):
        (tmp_path / f"{number}.frag").write_text(
            "layout(location = 0) in float c;\nlayout(location = 0) out vec4 o;\n"
            f"void main() {{ o = vec4(c * {number}.0); }}"
        )
    pairs = itertools.product(range(2), range(3))
    wanted = [
        replace(FULLSCREEN, shaders=(str(tmp_path / f"{v}.vert"), str(tmp_path / f"{f}.frag")))
        for v, f in pairs
    ]
    made = pipelines.get(wanted)
    assert len({int(vk.ffi.cast("uint64_t", one.handle)) for one in made}) == len(pipelines) == 6
    log: list = []
    vulkan_device.fn.trace(log)
    assert all(a is b for a, b in zip(pipelines.get(wanted), made, strict=True))
    vulkan_device.fn.trace(None)
    assert not log, "a pair that was asked for before is there"


def needs(material, **more):
    scene = quad_scene(material, lights=(SUN,), **more)
    return {name for name, _ in material_variant(material, scene).defines}


@pytest.mark.feature("device/program-variants")
def test_a_variant_has_what_its_material_needs_and_nothing_else():
    images = (Image("white", np.full((1, 1, 4), 255, np.uint8)),)
    assert needs(Material()) == {"SHADED", "LIT"}
    assert needs(Material(unlit=True)) == set()
    assert needs(Material(double_sided=True)) == {"SHADED", "LIT", "DOUBLE_SIDED"}
    assert needs(Material(alpha_mode="mask")) == {"SHADED", "LIT", "ALPHA_MASK"}
    assert needs(Material(alpha_mode="blend")) == {"SHADED", "LIT", "ALPHA_BLEND"}
    assert needs(Material(), colors=np.ones((4, 4), np.float32)) == {"SHADED", "LIT", "VERTEX_COLOR"}
    for role in ROLES:
        material = Material(**{f"{role}_texture": texture()})
        expected = {"SHADED", "LIT", "TEXTURED", f"{role.upper()}_MAP"}
        assert needs(material, images=images) == expected
        unlit = {"TEXTURED", "BASE_COLOR_MAP"} if role == "base_color" else set()
        assert needs(replace(material, unlit=True), images=images) == unlit
    dark = quad_scene(Material())
    assert not material_variant(dark.materials[0], dark).has("LIT")


def test_the_second_uv_set_is_read_by_those_that_name_it():
    images = (Image("white", np.full((1, 1, 4), 255, np.uint8)),)
    first, second = (Material(base_color_texture=texture(uv_set=number)) for number in (0, 1))
    scene = quad_scene(materials=(first, second), images=images)
    scene.uv1 = scene.uv0.copy()
    assert [material_variant(one, scene).has("UV1") for one in (first, second)] == [False, True]


def test_numbers_make_no_variants(vulkan_device):
    """Twelve materials that differ in colours, factors and cutoff alone: one pipeline per alpha mode."""
    materials = tuple(
        Material(
            name=str(i),
            base_color=(i / 12, 0.5, 0.5, 0.9),
            roughness=i / 12,
            metallic=i / 24,
            alpha_mode=mode,
        )
        for i, mode in zip(range(12), itertools.cycle(["opaque", "mask", "blend"]), strict=False)
    )
    scene = quad_scene(
        materials=materials,
        matrices=tuple(translated(z=-0.1 * i) for i in range(12)),
        instance_materials=tuple(range(12)),
        lights=(SUN,),
    )
    outputs = {"color_linear", "instance_id"}
    with Renderer(scene, (8, 8), PLAIN, outputs=outputs, device=vulkan_device) as made:
        work = made.render(facing()).work
    assert work["pipelines"] == 3 + 2, "the forward pass's, and the ids of what is not transparent"


def test_ids_need_shapes_alone(vulkan_device):
    """Six opaque materials of six kinds share the pipeline of the ids, which binds no texture and no normal."""
    images = (Image("white", np.full((1, 1, 4), 255, np.uint8)),)
    kinds = [{}, {"unlit": True}, {"double_sided": True}] + [
        {f"{role}_texture": texture()} for role in ("base_color", "normal", "emissive")
    ]
    materials = (
        *(Material(**kind) for kind in kinds),
        Material(alpha_mode="mask", base_color_texture=texture()),
    )
    count = len(materials)
    scene = quad_scene(
        materials=materials,
        images=images,
        matrices=tuple(translated(z=-0.1 * i) for i in range(count)),
        instance_materials=tuple(range(count)),
        lights=(SUN,),
    )
    log: list = []
    outputs = {"instance_id"}
    with Renderer(scene, (8, 8), PLAIN, outputs=outputs, device=vulkan_device) as made:
        made.render(facing())
        vulkan_device.fn.trace(log)
        frame = made.render(facing())
        vulkan_device.fn.trace(None)
        assert (frame.image("instance_id") == 1).all()
        assert frame.work["pipelines"] == count + 2
    begins = [i for i, (name, _) in enumerate(log) if name == "vkCmdBeginRendering"]
    ids = log[begins[1] :]
    assert [name for name, _ in ids].count("vkCmdBindPipeline") == 4, (
        "opaque in the forward pass's order, amid it what is double-sided; masked"
    )
    sets = Counter(arguments[3] for name, arguments in ids if name == "vkCmdBindDescriptorSets")
    assert sets.pop(max(sets)) == 1, "the mask's texture"
    assert {*sets.values()} == {2}, "the frame's, and in later chapters the geometry's, for either layout"


def test_materials_that_nothing_has_build_no_pipeline_in_any_pass(vulkan_device):
    scene = quad_scene(
        materials=(Material(), Material(alpha_mode="mask"), Material(double_sided=True)), lights=(SUN,)
    )
    outputs = {"color_linear", "instance_id"}
    with Renderer(scene, (8, 8), PLAIN, outputs=outputs, device=vulkan_device) as made:
        assert made.render(facing()).work["pipelines"] == 2
