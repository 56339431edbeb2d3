"""What a scene does not need is not done, and the picture is the same as if it were: always in pairs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.renderer import Renderer
from chapters.ch01.scene.packing import material_variant
from chapters.ch01.settings import Settings
from common import layouts
from common.environment import constant
from common.scene import Image, Light, Material, Sampler, TextureRef
from common.settings import replaced
from tests.support.chapter import building, on_path, unshadowed
from tests.support.drivers import needs_whole_quads
from tests.support.scenes import facing, quad_scene, texture, translated

SIZE = (32, 32)
SUN = Light("directional", node=0, intensity=math.pi)
PLAIN = Material(base_color=(0.7, 0.5, 0.3, 1.0), metallic=0.2, roughness=0.4, emissive=(0.1, 0.2, 0.3))
SETTINGS = Settings(
    default_light=False,
    ambient=0.2,
    anisotropy=1.0,
    environment_size=32,
    irradiance_source=16,
    table_samples=64,
)


def texels(seed):
    return Image(f"texels {seed}", np.random.default_rng(seed).integers(0, 256, (8, 8, 4), dtype=np.uint8))


SCENES = {
    "nothing": quad_scene(PLAIN),
    "lights": quad_scene(PLAIN, lights=(SUN,)),
    "texture": quad_scene(replace(PLAIN, base_color_texture=texture()), images=(texels(0),)),
    "normal map": quad_scene(replace(PLAIN, normal_texture=texture()), images=(texels(1),), lights=(SUN,)),
    "mask": quad_scene(replace(PLAIN, alpha_mode="mask", base_color_texture=texture()), images=(texels(2),)),
    "blend": quad_scene(replace(PLAIN, base_color=(1, 1, 1, 0.5), alpha_mode="blend"), lights=(SUN,)),
    "unlit": quad_scene(replace(PLAIN, unlit=True)),
    "environment": replace(quad_scene(PLAIN), environment=constant(1.0)),
}


@pytest.fixture(scope="module")
def frames(chapter):
    """Return, by scene, the picture and the work with skipping, and both without."""
    made = {}
    for name, scene in SCENES.items():
        pair = []
        for skip in (True, False):
            settings = replaced(SETTINGS, skip_unused=skip)
            with chapter.open(scene, SIZE, settings, outputs={"color_linear"}) as renderer:
                frame = renderer.render(facing())
                pair.append((frame.image("color_linear"), frame.work))
        made[name] = pair
    return made


@pytest.mark.newest
@pytest.mark.parametrize("name", SCENES)
def test_the_picture_is_the_same_with_skipping_turned_off(frames, name):
    (skipped, _), (whole, _) = frames[name]
    assert np.allclose(skipped, whole, rtol=2e-3, atol=1e-6)  # one step of half precision in the target


@pytest.mark.feature("gltf/prebuilt-descriptor-sets")
def test_a_scene_without_textures_has_no_texture_sampler_or_material_set(chapter, frames):
    (_, skipped), (_, whole) = frames["lights"]
    assert skipped["textures"] == 0
    assert skipped["samplers"] == 0
    assert whole["textures"] > 0
    assert whole["samplers"] > 0
    assert whole["descriptor_sets"] - skipped["descriptor_sets"] == {"vulkan": 1, "gl": 0}[chapter.backend]


@pytest.mark.until(1, "pages of geometry have sets too")
def test_a_scene_without_textures_has_a_set_for_each_frame_in_flight_alone(chapter, frames):
    (_, skipped), _ = frames["lights"]
    assert skipped["descriptor_sets"] == {"vulkan": 2, "gl": 0}[chapter.backend]


@pytest.mark.newest
def test_a_scene_without_lights_has_no_light_buffer_and_no_light_loop(chapter, frames):
    (_, skipped), (_, whole) = frames["nothing"]
    assert skipped["lights"] == 0
    made = []
    for settings in (SETTINGS, replaced(SETTINGS, skip_unused=False)):
        with chapter.open(SCENES["nothing"], SIZE, settings, outputs={"color"}):
            made.append(sum(name.startswith("lights") for name in chapter.device.alive.values()))
    assert made == [0, 2]
    assert whole["bytes_written"] > skipped["bytes_written"]


def test_a_scene_without_masks_builds_no_pipeline_with_an_alpha_test():
    scene = SCENES["texture"]
    assert not material_variant(scene.materials[0], scene).has("ALPHA_MASK")
    assert material_variant(SCENES["mask"].materials[0], SCENES["mask"]).has("ALPHA_MASK")


def test_pipelines_are_those_of_materials_that_are_drawn(chapter):
    """Three materials, of which one is drawn twice, one once and one never: two forward pipelines, one tone curve."""
    materials = (PLAIN, replace(PLAIN, unlit=True), replace(PLAIN, alpha_mode="mask"))
    matrices = (translated(-1.0), translated(1.0), translated(2.0))
    scene = quad_scene(materials=materials, matrices=matrices, instance_materials=(0, 1, 0))
    with chapter.open(scene, SIZE, SETTINGS) as made:
        work = made.render(facing(ymag=3.0)).work
    assert work["pipelines"] == 3
    assert work["draws"] == 4


@pytest.mark.newest
def test_passes_whose_output_nobody_reads_do_not_run(chapter):
    draws, lights = (["gbuffer"], ["lighting"]) if chapter.graph == "auto" else (["forward"], [])
    for outputs, names in (
        ({"color"}, [*draws, *lights, "tonemap"]),
        ({"color_linear"}, [*draws, *lights]),
        ({"depth", "instance_id"}, [*draws, "instance_id"]),
    ):
        with chapter.open(SCENES["lights"], SIZE, SETTINGS, outputs=outputs) as made:
            frame = made.render(facing())
            assert [one.name for one in made.passes] == names
            assert frame.work["passes"] == len(names)
            known = getattr(made, "switches", range(4))  # the passes that a frame can have
            assert frame.work["passes_skipped"] == len(known) - len(names)
            assert list(frame.timings) == names


@pytest.mark.newest
@pytest.mark.feature("gltf/prebuilt-descriptor-sets")
def test_a_still_frame_builds_nothing_and_writes_one_record(chapter):
    with chapter.open(SCENES["texture"], SIZE, SETTINGS) as made:
        for _ in range(3):
            made.render(facing())
        with chapter.calls() as calls:
            frame = made.render(facing(distance=1.7))
    assert not building(calls)
    assert calls.count("glFlush" if chapter.backend == "gl" else "vkQueueSubmit2") == 1
    assert frame.work["bytes_written"] == layouts.dtype("FrameConstants").itemsize


@pytest.mark.until(1, "bindless resources and indirect draws make other calls")
@pytest.mark.variants("vulkan", "without-all")
@pytest.mark.feature("device/command-buffers")
@pytest.mark.feature("device/api-trace")
def test_a_frame_is_the_golden_list_of_calls(chapter):
    """Every pass between its label, stamps and attachments; every draw after its pipeline, sets and constants."""
    with chapter.open(SCENES["texture"], SIZE, SETTINGS) as made:
        made.render(facing())
        made.render(facing())
        with chapter.calls() as log:
            made.render(facing())
    calls = [name.removeprefix("vk").removeprefix("Cmd") for name in log]
    begin = ["BeginDebugUtilsLabelEXT", "WriteTimestamp2", "BeginRendering", "SetViewport", "SetScissor"]
    end = ["EndRendering", "WriteTimestamp2", "EndDebugUtilsLabelEXT"]
    state = ["BindPipeline", "SetCullMode", "SetFrontFace"]
    forward = ["BindVertexBuffers"] * 3 + ["BindIndexBuffer", *state]
    forward += ["BindDescriptorSets", "BindDescriptorSets", "PushConstants", "DrawIndexed"]
    tonemap = [*state, "BindDescriptorSets", "Draw"]
    copy = ["BeginDebugUtilsLabelEXT", "PipelineBarrier2", "CopyImageToBuffer", "PipelineBarrier2"]
    assert calls == [
        *("WaitForFences", "ResetCommandPool", "BeginCommandBuffer", "ResetQueryPool"),
        *("PipelineBarrier2", *begin, *forward, *end),
        *("PipelineBarrier2", *begin, *tonemap, *end),
        *(*copy, "EndDebugUtilsLabelEXT"),
        *("EndCommandBuffer", "ResetFences", "QueueSubmit2"),
    ]


@pytest.mark.feature("device/command-buffers")
@pytest.mark.feature("device/api-trace")
@pytest.mark.until(1, "bindless resources and indirect draws make other calls")
@pytest.mark.variants("gl")
def test_a_frame_on_opengl_is_the_golden_list_of_calls(chapter):
    """Every pass between its label, stamps and framebuffer; every draw after its program, textures and constants."""
    with chapter.open(SCENES["texture"], SIZE, SETTINGS) as made:
        made.render(facing())
        made.render(facing())
        with chapter.calls() as calls:
            made.render(facing())
    begin = [
        "PushDebugGroup",
        "QueryCounter",
        "BindFramebuffer",
        "Viewport",
        "Disable",
        "ColorMask",
        "DepthMask",
    ]
    end = ["QueryCounter", "PopDebugGroup"]
    # Program, culling, front face, depth test, its comparison and mask, blending: all of it, each time it changes.
    forward = ["UseProgram", "Enable", "FrontFace", "Enable", "DepthFunc", "DepthMask", "Disable"]
    tonemap = ["UseProgram", "Disable", "FrontFace", "Disable", "DepthFunc", "DepthMask", "Disable"]
    texture_of_material = ["BindTextureUnit", "BindSampler"]
    copy = ["MemoryBarrier", "BindBuffer", "GetTextureSubImage", "BindBuffer", "MemoryBarrier"]
    assert [name.removeprefix("gl") for name in calls] == [
        *("ClientWaitSync", "DeleteSync"),
        *["BindBufferRange"] * 3,  # constants, instances, materials
        *(*begin, "ClearNamedFramebufferfv", "ClearNamedFramebufferfv"),
        *(
            "BindVertexArray",
            *forward,
            *texture_of_material,
            "BindBufferRange",
            "DrawElementsBaseVertex",
            *end,
        ),
        *(*begin, *tonemap, *texture_of_material, "BindVertexArray", "DrawArrays", *end),
        *("PushDebugGroup", *copy, "PopDebugGroup"),
        *("FenceSync", "Flush"),
    ]


@pytest.mark.until(1, "bindless resources and indirect draws make other calls")
@pytest.mark.variants("gl")
def test_another_object_is_two_calls_more_on_opengl(chapter):
    """Its constants and its draw: what Python does per object and frame is these two."""
    counts = []
    for objects in (2, 12):
        matrices = tuple(translated(0.1 * place) for place in range(objects))
        scene = quad_scene(PLAIN, matrices=matrices, instance_materials=(0,) * objects)
        with chapter.open(scene, SIZE, SETTINGS) as made:
            for _ in range(3):
                made.render(facing())
            with chapter.calls() as calls:
                made.render(facing())
        counts.append(len(calls))
    assert counts[1] - counts[0] == 2 * 10


@pytest.mark.newest
@pytest.mark.variants("gl")
@pytest.mark.parametrize("name", SCENES)
def test_both_backends_count_the_same_work(vulkan_device, frames, name):
    """What is drawn, and what is left out, does not depend on the API: with skipping, and without."""
    counted = (
        "draws",
        "triangles",
        "lights",
        "passes",
        "passes_skipped",
        "instances",
        "pipelines",
        "textures",
    )
    counted += ("samplers", "bytes_written")
    for skip, (picture, work) in zip((True, False), frames[name], strict=True):
        settings = unshadowed(on_path(replaced(SETTINGS, skip_unused=skip)))
        with Renderer(
            SCENES[name], SIZE, settings, outputs={"color_linear"}, device=vulkan_device
        ) as renderer:
            frame = renderer.render(facing())
            assert {key: work[key] for key in counted} == {key: frame.work[key] for key in counted}
            assert np.allclose(picture, frame.image("color_linear"), rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("anisotropy", [1.0, 4.0, 16.0])
def test_a_map_at_one_point_is_its_texel_there(chapter, anisotropy):
    """Constant coordinates have no footprint: an anisotropic filter divides zero by zero there."""
    needs_whole_quads(chapter.device)
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[...] = (40, 90, 160, 255)
    pixels[6:, :] = 255
    scene = quad_scene(
        Material(unlit=True, base_color_texture=TextureRef(0, Sampler())),
        images=(Image("palette", pixels),),
    )
    scene.uv0[:] = 0.3
    settings = Settings(anisotropy=anisotropy, tone_curve="none")
    with chapter.open(scene, SIZE, settings=settings, outputs={"color"}) as made:
        middle = made.render(facing(), 0.0).image("color")[8:-8, 8:-8]
    assert (np.abs(middle.astype(int) - (40, 90, 160)) <= 1).all()


@pytest.mark.parametrize("anisotropy", [1.0, 4.0])
def test_real_scenes_look_the_same_with_skipping_turned_off(chapter, anisotropy):
    """Neutral maps on surfaces without coordinates of their own, under the filter that is the default."""
    import chapters
    from chapters import scenes

    scene = scenes.load("cornell")
    pictures = []
    for skip in (True, False):
        settings = replaced(SETTINGS, skip_unused=skip, anisotropy=anisotropy)
        with chapter.open(scene, SIZE, settings, outputs={"color_linear"}) as made:
            pictures.append(made.render(chapters.view_of(made), 0.0).image("color_linear"))
    assert np.allclose(*pictures, rtol=2.0**-9, atol=2.0**-12)
