"""The choice between the rasteriser and the kernel, and the mask as an attachment: what needs no such device.

The software drivers have no attachments of rates. Structs and barriers are held to the numbers of the specification,
and `pretended` draws the frame of a device with attachments in which the rasteriser takes no notice of the mask.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backends.contract import Access, Choice, Plan
from backends.vulkan import api as vk
from backends.vulkan.instance import shading_rates
from backends.vulkan.resources import Image
from chapters.ch09 import LESSON
from chapters.ch09.graph.checks import check_access
from chapters.ch09.graph.execute import vulkan_targets
from chapters.ch09.graph.frame_graph import compile_graph
from chapters.ch09.graph.memory import vulkan_images
from chapters.ch09.graph.plan import graph_name
from chapters.ch09.graph.sync import vulkan as sync
from chapters.ch09.graph.sync.states import touch_of
from chapters.ch09.graph.types import GraphError, Node, Touch
from chapters.ch09.rates import native
from chapters.ch09.rates.model import EDGES, MASK, RATES
from chapters.ch09.rates.passes import by_blocks
from chapters.ch09.rates.vulkan import rates_of_attachment
from chapters.ch09.settings import Settings
from chapters.ch09.shading.lighting import LightingPass
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.scenes import quad_scene

REASON = "the driver lacks VK_KHR_fragment_shading_rate"
WITH = Plan((Choice("shading-rate", True, "", "the device has it"),))
LACKING = Plan((Choice("shading-rate", False, "", REASON),))
OFF = Plan((Choice("shading-rate", False, "", "switched off by --without"),))
RATES_2X2, RATES_4X4 = 1 << 0 | 1 << 5, 1 << 0 | 1 << 5 | 1 << 10
LIMITS = {
    "minShadingRateTexel": 16,
    "maxShadingRateTexel": 16,
    "shadingRates": RATES_2X2,
    "maxComputeWorkGroupInvocations": 1024,
}
SOBEL = Settings(rate_policy="sobel")
DRAWN = {"graph": "deferred", "rate_fragments": "device"}
BASE = Settings(anisotropy=1.0, default_light=False, shadows="off", bloom=0.0, color_format="rgba32f")
VIEW = View(pose_looking_at((0.2, 0.1, 2.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.1), ev100=0.0)
SIZE = (83, 53)


@pytest.fixture(scope="module")
def scene():
    return quad_scene(
        Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.6),
        lights=(Light("directional", node=0, intensity=3.0),),
    )


# --- the choice -------------------------------------------------------------------------------------------------------


@pytest.mark.feature("vrs/texel-size-reduction", "vrs/detection-and-fallback")
@pytest.mark.runs_on("vulkan", "gl")
@pytest.mark.parametrize(
    ("least", "most", "invocations", "texel"),
    [
        (16, 16, 1024, 16),  # NVIDIA
        (8, 8, 1024, 8),  # AMD
        (8, 32, 1024, 16),
        (32, 32, 1024, 32),
        (32, 32, 512, 0),  # a work group has no invocation for each pixel
        (32, 16, 1024, 0),  # no square
        (1, 64, 1024, 0),  # a texel smaller than a block could be meant
        (0, 0, 1024, 0),
    ],
)
def test_a_texel_is_as_near_to_16_pixels_as_the_device_allows(least, most, invocations, texel):
    limits = {"minShadingRateTexel": least, "maxShadingRateTexel": most}
    assert native.texel_of(limits | {"maxComputeWorkGroupInvocations": invocations}) == texel
    assert native.texel_of({}) == 0


@pytest.mark.feature("vrs/detection-and-fallback")
@pytest.mark.runs_on("vulkan", "gl")
def test_auto_is_the_device_where_it_can_and_compute_elsewhere():
    assert LESSON.needs.optional >= {"shading-rate"}
    for plan, limits, knobs, native_light in (
        (WITH, LIMITS, {}, True),
        (WITH, LIMITS, {"rate_fragments": "device"}, True),
        (WITH, LIMITS, {"rate_fragments": "passes"}, False),
        (WITH, LIMITS, {"rate_coarse": "4x4"}, False),  # the device has no such fragments
        (WITH, LIMITS | {"shadingRates": RATES_4X4}, {"rate_coarse": "4x4"}, True),
        (WITH, LIMITS | {"maxShadingRateTexel": 8}, {}, False),
        (WITH, {}, {}, False),
        (LACKING, LIMITS, {}, False),
        (LACKING, LIMITS, {"rate_fragments": "device"}, False),
        (OFF, LIMITS, {}, False),
        (Plan(()), LIMITS, {}, False),
    ):
        auto = replaced(SOBEL, **knobs)
        asked_in_vain = knobs.get("rate_fragments") == "device" and not native_light
        sentence = native.without_effect(auto, plan, limits)
        assert sentence.startswith("rate_fragments=device has no effect, since") == asked_in_vain
        assert bool(sentence) == asked_in_vain
        settings = native.settled(auto, plan, limits)
        assert (graph_name(settings), settings.rates.rate_policy) == (
            "deferred" if native_light else "compute",
            "sobel",
        )
        mask = native.mask_of(settings, limits)
        assert (mask.drawn, mask.format) == ((True, "r8ui") if native_light else (False, "r32ui"))
        assert bool(native.attached(settings, limits)) == native_light and not by_blocks(settings)
        if knobs.get("rate_fragments") != "device":  # with a graph of fragments the other way are two passes
            drawn = native.settled(replaced(auto, graph="deferred"), plan, limits)
            assert by_blocks(drawn) != native_light and bool(native.attached(drawn, limits)) == native_light
        computed = native.settled(replaced(auto, graph="compute"), plan, limits)
        assert not native.attached(computed, limits) and not native.mask_of(computed, limits).drawn
    assert native.settled(Settings(), WITH, LIMITS) == Settings(), "without a policy nothing changes"


@pytest.mark.feature("vrs/detection-and-fallback")
@pytest.mark.runs_on("vulkan", "gl")
@pytest.mark.parametrize(
    ("knobs", "plan", "why"),
    [
        (DRAWN, LACKING, f"rate_fragments=device, since there is no variable rate shading ({REASON})"),
        (DRAWN, OFF, "since there is no variable rate shading (switched off by --without)"),
        (DRAWN | {"rate_coarse": "4x4"}, WITH, "the device draws no fragments of 4x4 pixels"),
        ({"graph": "forward"}, WITH, "graph=forward, which has no passes 'rate_mask' and 'lighting_compute'"),
        ({"msaa": 4}, WITH, "msaa=4, since a G-buffer holds one sample a pixel"),
        ({"view": "normal"}, WITH, "view=normal, which shows a quantity of surfaces while they are drawn"),
        (
            {"culling_overlay": "meshlets"},
            WITH,
            "culling_overlay=meshlets, which is drawn over the forward pass",
        ),
    ],
)
def test_a_policy_without_effect_is_none_and_says_why_in_a_sentence(knobs, plan, why):
    settings = replaced(SOBEL, **knobs)
    sentence = native.without_effect(settings, plan, LIMITS)
    assert sentence.startswith("rate_policy=sobel has no effect with ") and why in sentence
    assert sentence.endswith(".") and ". " not in sentence
    assert native.settled(settings, plan, LIMITS) == replaced(settings, rate_policy="none")
    assert native.without_effect(replaced(settings, rate_policy="none"), plan, LIMITS) == ""


@pytest.mark.feature("vrs/detection-and-fallback")
@pytest.mark.variants("without-all", "gl")
@pytest.mark.parametrize("policy", ["sobel", "radial"])
def test_without_the_capability_no_mask_exists_and_the_frame_is_that_of_full_rate(chapter, scene, policy):
    frames, names, work = [], [], []
    scene = replace(scene, warnings=[])
    for chosen in ("none", policy):
        settings = replaced(BASE, **DRAWN, rate_policy=chosen)
        for _ in range(2):
            with chapter.open(scene, SIZE, settings, outputs=("color", "color_linear")) as renderer:
                frame = renderer.render(VIEW)
                frames.append((frame.image("color"), frame.image("color_linear")))
                names.append({*renderer.graph.resources} | {step.name for step in renderer.graph.steps})
                work.append(
                    {
                        name: frame.work[name]
                        for name in ("passes", "barriers", "transient_bytes", "pipelines")
                    }
                )
    assert all(
        np.array_equal(one, other) for each in frames[1:] for one, other in zip(each, frames[0], strict=True)
    )
    assert not {RATES, EDGES, MASK, "rate_edges"} & set[str]().union(*names)
    assert all(one == work[0] for one in work)
    (said,) = scene.warnings
    assert said.startswith(
        f"rate_policy={policy} has no effect with rate_fragments=device, since there is no "
    )
    assert said.endswith("rate_fragments=passes needs none.")


@pytest.mark.feature("vrs/detection-and-fallback", "vrs/texel-size-reduction")
@pytest.mark.variants("without-all", "gl")
def test_without_the_capability_auto_lights_by_compute(chapter, scene):
    scene = replace(scene, warnings=[])
    settings = replaced(BASE, graph="auto", rate_policy="radial", gbuffer_format="full")
    renderer = opened_as_is(chapter, scene, settings)
    with renderer:
        renderer.render(VIEW)
        graph = renderer.graph
    assert {MASK, native.COMPUTED} <= {step.name for step in graph.steps}
    assert "rate" not in graph.resources[RATES].uses
    assert graph.resources[RATES].size == (42, 27) and graph.resources[RATES].format == "r32ui"
    assert not scene.warnings


def opened_as_is(chapter, scene, settings):
    """Return a renderer that takes the graph of graph=auto, which `Chapter.open` would replace."""
    from dataclasses import replace as other

    return other(chapter, graph="auto").open(scene, SIZE, settings)


# --- the device -------------------------------------------------------------------------------------------------------


@pytest.mark.feature("vrs/detection-and-fallback", "vrs/texel-size-reduction")
@pytest.mark.runs_on("vulkan")
def test_the_limits_are_those_that_the_driver_says():
    """A driver of words: rates of one sample count, and the sides of texels that are square."""
    rates = [((4, 4), 1), ((2, 2), 5), ((2, 1), 4), ((1, 1), 127)]

    def properties(handle, outer):
        limits = vk.ffi.cast("VkPhysicalDeviceFragmentShadingRatePropertiesKHR *", outer.pNext)
        assert limits.sType == 1000226002
        least, most = (
            limits.minFragmentShadingRateAttachmentTexelSize,
            limits.maxFragmentShadingRateAttachmentTexelSize,
        )
        least.width, least.height, most.width, most.height = 8, 16, 32, 16

    def listed(handle, count, data):
        if data == vk.NULL:
            count[0] = len(rates)
            return
        for place, ((width, height), samples) in enumerate(rates):
            assert data[place].sType == 1000226004
            data[place].sampleCounts = samples
            data[place].fragmentSize.width, data[place].fragmentSize.height = width, height

    fn = SimpleNamespace(
        vkGetPhysicalDeviceProperties2=properties, vkGetPhysicalDeviceFragmentShadingRatesKHR=listed
    )
    assert shading_rates(fn, None) == {
        "shadingRates": 1 << 10 | 1 << 5 | 1 << 0,  # 2x1 has no one sample
        "minShadingRateTexel": 16,
        "maxShadingRateTexel": 16,
    }


# --- the graph --------------------------------------------------------------------------------------------------------

WRITES = Access(RATES, "storage", format="r8ui", texel=(16, 8))
READS = Access(RATES, "rate", format="r8ui", texel=(16, 8))
LIT = Access("color_lit", "color", format="rgba16f")
RATE_TOUCH = Touch("rate", frozenset({"rate"}), frozenset({"rate_read"}))


@pytest.mark.feature("vrs/attachment", "vrs/texel-size-reduction")
@pytest.mark.runs_on("vulkan")
@pytest.mark.parametrize(("size", "texels"), [((160, 96), (10, 12)), ((161, 97), (11, 13)), ((1, 1), (1, 1))])
def test_the_mask_has_a_texel_for_each_part_of_the_picture_and_a_barrier_before_the_rasteriser(size, texels):
    nodes = [Node("mask", (), (WRITES,)), Node("light", (READS,), (LIT,))]
    graph = compile_graph(nodes, size, ("color_lit",))
    mask, light = graph.steps
    assert (mask.kind, light.kind) == ("compute", "graphics")
    assert graph.resources[RATES].size == texels and graph.resources[RATES].uses == {"storage", "rate"}
    assert light.rates((READS,)) == (RATES, (16, 8)) and mask.rates(()) is None and light.size == size
    (barrier,) = [it for it in light.barriers if it.resource == RATES]
    assert barrier.before == Touch("general", frozenset({"compute"}), barrier.before.access, writes=True)
    assert "storage_write" in barrier.before.access and barrier.after == RATE_TOUCH and not barrier.discard
    assert light.sampled((READS,)) == [], "the rasteriser reads it, and no shader"
    (again,) = mask.barriers
    assert again.discard and again.before.stages == {"rate"}, "the next frame waits for the rasteriser"


@pytest.mark.feature("vrs/attachment")
@pytest.mark.runs_on("vulkan")
def test_nothing_but_a_pass_that_draws_reads_rates():
    check_access(READS, "light", ("r8ui",))
    assert touch_of(READS, "graphics", writes=False) == RATE_TOUCH
    for kind, writes in (("compute", False), ("graphics", True), ("compute", True), ("copy", False)):
        with pytest.raises(GraphError, match=f"'{RATES}': a pass that is {kind} .* nothing as 'rate'"):
            touch_of(READS, kind, writes=writes)


def image(name: str, number: int) -> Image:
    handle = vk.ffi.cast("VkImage", number), vk.ffi.cast("VkImageView", number + 1)
    return Image(*handle, "r8ui", 6, 4, 1, 1, vk.VK_IMAGE_ASPECT_COLOR_BIT, None, name)


@pytest.mark.feature("vrs/attachment")
@pytest.mark.runs_on("vulkan")
def test_structs_have_the_numbers_of_the_specification():
    """Values of vk.xml, since the software drivers have no layer that knows them."""
    nodes = [Node("mask", (), (WRITES,)), Node("light", (READS,), (LIT,))]
    graph = compile_graph(nodes, SIZE, ("color_lit",))
    images = {RATES: image(RATES, 16), "color_lit": image("color_lit", 32)}
    light = graph.steps[1]
    dependency = sync.dependency(
        light.barriers, images, lambda *_: {**_masks_of(_[1]), "srcQueueFamilyIndex": 0}
    )
    (mask,) = [
        it
        for it in dependency.pImageMemoryBarriers[0 : dependency.imageMemoryBarrierCount]
        if int(vk.ffi.cast("uintptr_t", it.image)) == 16
    ]
    assert (mask.srcStageMask, mask.dstStageMask) == (
        0x800,
        0x00400000,
    )  # compute, and the rasteriser's reads
    assert mask.srcAccessMask & 0x400000000 and mask.dstAccessMask == 0x00800000
    assert (mask.oldLayout, mask.newLayout) == (1, 1000164003)
    info = vulkan_targets.Targets(light, images, (READS,)).info
    rates = vk.ffi.cast("VkRenderingFragmentShadingRateAttachmentInfoKHR *", info.pNext)
    assert rates.sType == 1000044006 and int(vk.ffi.cast("uintptr_t", rates.imageView)) == 17
    assert rates.imageLayout == 1000164003
    assert (rates.shadingRateAttachmentTexelSize.width, rates.shadingRateAttachmentTexelSize.height) == (
        16,
        8,
    )
    state = rates_of_attachment()
    assert state.sType == 1000226001 and list(state.combinerOps) == [0, 1]  # keep, replace
    assert (state.fragmentSize.width, state.fragmentSize.height) == (1, 1)
    memory = vulkan_images.GraphMemory(None)  # type: ignore[arg-type]
    assert memory.usage(graph.resources[RATES]) == 0x100 | 0x8
    plain = compile_graph([Node("light", (), (LIT,))], SIZE, ("color_lit",))
    assert vulkan_targets.Targets(plain.steps[0], images).info.pNext == vk.NULL


def _masks_of(masks: dict[str, int]) -> dict[str, int]:
    return dict(masks)


# --- the frame of a device with attachments, on one without -----------------------------------------------------------


@pytest.fixture(params=[16, 8])
def pretended(request, chapter, monkeypatch):
    """Let a device seem to have attachments of rates; the mask is there, and the rasteriser does not read it."""
    describe = LightingPass.describe
    monkeypatch.setattr(LightingPass, "describe", lambda self: replace(describe(self), by_rates=False))
    monkeypatch.setattr(vulkan_targets.Targets, "_rates", staticmethod(lambda *_: None))
    monkeypatch.setattr(native, "_why_not", lambda *_: "")
    monkeypatch.setattr(native, "texel_of", lambda *_: request.param)
    monkeypatch.setitem(sync.STAGES, "rate", sync.STAGES["fragment"])
    monkeypatch.setitem(sync._LAYOUTS, "rate", sync._LAYOUTS["read"])
    # A usage that an image in the layout of reads may have, and that no other pass asks for.
    monkeypatch.setitem(vulkan_images._IMAGE_USAGE, "rate", vk.VK_IMAGE_USAGE_INPUT_ATTACHMENT_BIT)
    monkeypatch.setitem(sync.ACCESS, "rate_read", sync.ACCESS["sampled"])
    return request.param


@pytest.mark.feature("vrs/attachment", "vrs/texel-size-reduction")
@pytest.mark.variants("vulkan")
def test_the_mask_of_the_rasteriser_is_that_of_the_kernel_in_bytes(chapter, scene, pretended):
    found = {}
    for graph in ("deferred", "compute"):
        settings = replaced(BASE, graph=graph, rate_policy="radial", rate_radius=0.3, gbuffer_format="full")
        settings = replaced(settings, rate_texel=16 if graph == "compute" else 0)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",), inspect=True) as renderer:
            frame = renderer.render(VIEW)
            found[graph] = frame.image(f"{MASK}/{RATES}")
            assert ("rate" in renderer.graph.resources[RATES].uses) == (graph == "deferred")
    assert found["deferred"].dtype == np.uint8 and found["compute"].dtype == np.uint32
    for codes, texel in ((found["deferred"], pretended), (found["compute"], 16)):
        width, height = SIZE
        y, x = np.mgrid[0:height, 0:width]
        away = np.hypot(x + 0.5 - width / 2, y + 0.5 - height / 2) / height
        rows, columns = -(-height // texel), -(-width // texel)
        finest, coarsest = np.full((rows, columns), 5), np.zeros((rows, columns), int)
        asked = np.where(away <= 0.3, 0, 5)
        np.minimum.at(finest, (y // texel, x // texel), asked)
        np.maximum.at(coarsest, (y // texel, x // texel), asked)
        assert np.array_equal(codes, finest)
        assert not np.array_equal(codes, coarsest), "the rule of reduction would be seen"


@pytest.mark.feature("vrs/attachment")
@pytest.mark.variants("vulkan")
def test_the_shader_of_blocks_is_that_of_pixels_where_each_block_is_one(chapter, scene, pretended):
    pictures = []
    for knobs in ({}, {"rate_policy": "sobel"}):
        settings = replaced(BASE, graph="deferred", gbuffer_format="full", **knobs)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            pictures.append([renderer.render(VIEW).image("color_linear") for _ in range(4)])
            assert (RATES in renderer.graph.resources) == bool(knobs)
            assert {"recorded": 0}.items() <= renderer.render(VIEW).work.items(), "no frame is recorded again"
    assert all(np.array_equal(one, other) for one, other in zip(*pictures, strict=True))
