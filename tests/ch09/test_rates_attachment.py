"""Light by a mask of shading rates: the rasteriser that reads it as an attachment, and the kernel that takes its place.

What holds for both runs for both; the rasteriser's half is skipped on a device without such attachments.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch09.pipelines.compute_description import ComputeDescription
from chapters.ch09.rates.model import MASK, RATES, decode
from chapters.ch09.rates.native import DRAWN
from chapters.ch09.rates.passes import RateMaskPass
from chapters.ch09.settings import Settings
from chapters.ch09.shading.lighting import LightingPass
from common.environment.environment import Environment
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.scenes import quad_scene, texture, translated

pytestmark = pytest.mark.variants("vulkan")

SIZE = (83, 53)  # odd: blocks and texels stand over the edges
WHOLE = (96, 64)  # whole texels of 8, 16 and 32 pixels
BASE = Settings(
    anisotropy=1.0,
    default_light=False,
    shadows="off",
    bloom=0.0,
    color_format="rgba32f",
    gbuffer_format="full",
    environment_size=64,
)
FULL_RATE = {"rate_policy": "radial", "rate_radius": 4.0}
"""A mask of zeros: no pixel is 4 heights away from the middle."""
BLOCKS = {"rate_policy": "radial", "rate_radius": 0.0}
"""A mask of coarse rates, but for the pixel in the very middle of a picture with odd sides."""
VIEW = View(pose_looking_at((0.3, 0.2, 2.4), (0.0, 0.0, 0.0)), Perspective(0.9, 0.1), ev100=0.0)

HALVES = """layout(local_size_x = 1) in;
layout(BIND(1, 0, 0), RATE_FORMAT) uniform writeonly uimage2D rates;
void main() {
    uint code = 2u * gl_WorkGroupID.x < gl_NumWorkGroups.x ? 0u : 5u;
    imageStore(rates, ivec2(gl_WorkGroupID.xy), uvec4(code));
}
"""


def noise() -> Image:
    """Return an image in which each texel has a colour of its own."""
    texels = np.random.default_rng(9).integers(30, 255, (128, 128, 4)).astype(np.uint8)
    texels[..., 3] = 255
    return Image("noise", texels)


@pytest.fixture(scope="module")
def scene():
    """Squares full of noise that leave the sky free around them, which brightens from side to side."""
    sides = np.linspace(0.2, 4.0, 32, dtype=np.float32)
    sky = np.ascontiguousarray(np.broadcast_to(sides[None, :, None], (16, 32, 3)))
    rough = Material(base_color_texture=texture(), roughness=0.7)
    made = quad_scene(
        rough,
        matrices=(translated(-0.8, 0.1, 0.0), translated(0.7, -0.2, 0.5)),
        images=(noise(),),
        materials=(rough, replace(rough, metallic=1.0, roughness=0.4)),
        instance_materials=(0, 1),
        lights=(Light("directional", node=0, intensity=3.0),),
    )
    return replace(made, environment=Environment("sides", sky))


@pytest.fixture(params=["deferred", "compute"])
def graph(request, chapter):
    """Return each graph whose light the device takes from a mask."""
    if request.param == "deferred":
        has_attachment(chapter)
    return request.param


def has_attachment(chapter):
    if not chapter.device.has("shading-rate"):
        pytest.skip("the device has no shading-rate")


def rendered(chapter, scene, size=SIZE, frames=1, **knobs):
    """Return the picture in float64 and the mask, None without one, of the last of some frames."""
    knobs = {"rate_texel": 16, **knobs} if knobs.get("graph") == "compute" else knobs
    settings = replaced(BASE, **knobs)
    with chapter.open(scene, size, settings, outputs=("color_linear",), inspect=True) as renderer:
        for _ in range(frames):
            frame = renderer.render(VIEW)
        mask = frame.image(f"{MASK}/{RATES}").astype(int) if RATES in renderer.graph.resources else None
        return frame.image("color_linear").astype(np.float64), mask, texel_in(renderer)


def lit_pixels(codes: np.ndarray, texel: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns (H, W) of the pixels that are lit for each pixel: the middle of its block, rounded up."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width]
    sides = np.array([decode(code) if code in (0, 1, 4, 5, 10) else (1, 1) for code in range(16)])
    across, down = np.moveaxis(sides[codes[y // texel, x // texel]], -1, 0)
    rows, columns = y // down * down + down // 2, x // across * across + across // 2
    return np.minimum(rows, height - 1), np.minimum(columns, width - 1)


def texel_in(renderer) -> int:
    """Return the pixels along a texel of the mask, from what the rasteriser reads; 16 where a kernel reads it."""
    texels = [access.texel[0] for node in renderer.nodes for access in node.reads if access.use == "rate"]
    return texels[0] if texels else 16


@pytest.mark.feature("vrs/attachment")
@pytest.mark.parametrize("size", [WHOLE, SIZE])
def test_blocks_of_one_pixel_are_the_picture_at_full_rate_bit_for_bit(chapter, scene, graph, size):
    if size == SIZE or graph == "compute":
        # Mesa's software driver rounds what it samples from a cube by invocations beside it. Those that stand over the
        # edge are others, and so are those of the list that the kernel makes: a bit of 24 in 1 % of the pixels.
        scene = replace(scene, environment=None)
    plain, none, _ = rendered(chapter, scene, size, graph=graph)
    drawn, codes, _ = rendered(chapter, scene, size, graph=graph, **FULL_RATE)
    assert none is None and not codes.any()
    assert np.ptp(plain) > 1.0, "there is something to see"
    assert np.array_equal(drawn, plain)


@pytest.mark.feature("vrs/attachment", "vrs/texel-size-reduction")
@pytest.mark.parametrize("coarse", ["2x2", "4x4"])
def test_a_block_has_the_light_of_its_middle_pixel(chapter, scene, graph, coarse):
    limits = chapter.device.capabilities.limits
    if graph == "deferred" and coarse == "4x4" and not limits["shadingRates"] >> 10 & 1:
        pytest.skip("the device has no shading-rate of 4x4")
    plain, _, _ = rendered(chapter, scene, graph=graph)
    drawn, codes, texel = rendered(chapter, scene, graph=graph, rate_coarse=coarse, **BLOCKS)
    assert codes.shape == tuple(-(-side // texel) for side in SIZE[::-1])
    assert np.mean(codes != 0) > 0.9
    rows, columns = lit_pixels(codes, texel, SIZE)
    # Of 24 bits. The sky of a block is drawn at the middle of a pixel, found by a sum in which a bit may be lost.
    assert np.abs(drawn - plain[rows, columns]).max() <= 1e-5 * plain.max()
    assert np.abs(drawn - plain).max() > 0.1, "blocks differ from pixels, so a wrong pixel would be seen"


@pytest.mark.feature("vrs/attachment")
@pytest.mark.parametrize(
    "knobs", [BLOCKS, {"rate_policy": "radial", "rate_radius": 0.4}, {"rate_policy": "sobel"}]
)
def test_the_rasteriser_and_the_kernel_light_the_same_pixels(chapter, scene, knobs):
    has_attachment(chapter)
    drawn, codes, texel = rendered(chapter, scene, frames=4, graph="deferred", **knobs)
    if texel != 16:
        pytest.skip("the device has no shading-rate for texels of 16 pixels")
    computed, of_kernel, _ = rendered(chapter, scene, frames=4, graph="compute", **knobs)
    assert np.array_equal(codes, of_kernel)
    # A wrong pixel of the noise differs by a tenth of the brightest; rounding in two shaders by some bits of 24.
    assert np.abs(drawn - computed).max() <= 1e-4 * computed.max()


@pytest.mark.feature("vrs/attachment")
def test_half_a_mask_of_2x2_takes_a_quarter_of_its_fragments(chapter, scene, tmp_path):
    """Fragments are counted by the device; dynamic rendering is the only kind here."""
    has_attachment(chapter)
    if not chapter.device.has("pipeline-statistics"):
        pytest.skip("the device has no shading-rate that it could count")
    file = tmp_path / "halves.comp"
    file.write_text(HALVES)

    class Halves(RateMaskPass):
        def create(self):
            described = ComputeDescription(str(file), (("RATE_FORMAT", self._mask.format),), name=self.name)
            self.build(described, (0,), self._mask.texel)

    pixels, half = WHOLE[0] * WHOLE[1], WHOLE[0] // 2 * WHOLE[1]
    with chapter.open(scene, WHOLE, replaced(BASE, graph="deferred", **FULL_RATE), inspect=True) as renderer:
        texel = texel_in(renderer)
        counted = Counter(renderer, chapter.device)
        assert counted.fragments() == pytest.approx(pixels, rel=0.02)
        renderer.swap_pass(MASK, renderer.make_pass(Halves))
        fragments = counted.fragments()
        codes = counted.frame.image(f"{MASK}/{RATES}")
        counted.close()
    columns = WHOLE[0] // texel
    assert (
        (codes[:, : columns // 2] == 0).all() and (codes[:, columns // 2 :] == 5).all() and columns % 2 == 0
    )
    assert fragments - half == pytest.approx(half / 4, rel=0.02)


class Counter:
    """Counts the invocations of the fragment shader in the lighting pass of a renderer, frame by frame."""

    def __init__(self, renderer, device) -> None:
        from backends.vulkan import api as vk

        self._vk, self._device, self._renderer = vk, device, renderer
        info = vk.new(
            "VkQueryPoolCreateInfo",
            queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
            queryCount=1,
            pipelineStatistics=vk.VK_QUERY_PIPELINE_STATISTIC_FRAGMENT_SHADER_INVOCATIONS_BIT,
        )
        self._pool = pool = device.create("vkCreateQueryPool", info, "fragments")

        class Counted(LightingPass):
            def record(self, commands):
                device.fn.vkCmdBeginQuery(commands.handle, pool, 0, 0)
                super().record(commands)
                device.fn.vkCmdEndQuery(commands.handle, pool, 0)

        counted = renderer.make_pass(Counted)
        counted.declare()
        renderer.swap_pass(DRAWN, counted)

    def fragments(self) -> int:
        """Render a frame and return its count."""
        vk, fn = self._vk, self._device.fn
        fn.vkResetQueryPool(self._device.handle, self._pool, 0, 1)
        self.frame = self._renderer.render(VIEW)
        self.frame.image("color")
        value = np.zeros(1, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        held = vk.ffi.from_buffer(value)
        code = fn.vkGetQueryPoolResults(self._device.handle, self._pool, 0, 1, 8, held, 8, flags)
        vk.check(code, "vkGetQueryPoolResults")
        return int(value[0])

    def close(self) -> None:
        self._device.wait_idle()
        self._device.destroy("VkQueryPool", self._pool)


@pytest.mark.feature("vrs/attachment")
def test_fragments_are_counted_where_each_pixel_has_its_own(chapter, scene):
    """The count itself, on any device that counts."""
    if not chapter.device.has("pipeline-statistics"):
        pytest.skip("the device has no shading-rate that it could count")
    with chapter.open(scene, WHOLE, replaced(BASE, graph="deferred"), inspect=True) as renderer:
        counted = Counter(renderer, chapter.device)
        assert counted.fragments() == pytest.approx(WHOLE[0] * WHOLE[1], rel=0.02)
        counted.close()


@pytest.mark.feature("vrs/attachment", "vrs/texel-size-reduction")
def test_the_picture_follows_a_mask_through_other_sizes_and_frames(chapter, scene, graph):
    """Transitions between the kernel that writes the mask and its reader, in both slots: validated, held to bits."""
    settings = replaced(BASE, graph=graph, rate_policy="sobel")
    with chapter.open(scene, (40, 24), settings, outputs=("color_linear",)) as renderer:
        for size in ((40, 24), SIZE, (16, 16), SIZE):
            renderer.resize(size)
            pictures = [renderer.render(VIEW).image("color_linear") for _ in range(5)]
            renderer.reset_history("again")
            again = [renderer.render(VIEW).image("color_linear") for _ in range(5)]
            assert all(np.isfinite(one).all() for one in pictures)
            assert all(np.array_equal(one, other) for one, other in zip(pictures, again, strict=True))
