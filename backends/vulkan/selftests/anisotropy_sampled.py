"""Self-test: with an elongated footprint, an anisotropic sampler takes a finer mip level than a trilinear one.

It also ends in time where a footprint is odd: see `too_slow`.
"""

from __future__ import annotations

import numpy as np

from backends.selftest.data import too_slow
from backends.vulkan import api as vk
from backends.vulkan.resources import create_image, destroy_image
from backends.vulkan.selftests import texturing_edges
from backends.vulkan.selftests.bench import FULL_SCREEN, Bench
from backends.vulkan.selftests.bindings import Texture

# Each level holds its own number; from pixel to pixel it is 16 texels across, and 1 down.
FRAGMENT = """
layout(set = 0, binding = 0) uniform sampler2D trilinear;
layout(set = 0, binding = 1) uniform sampler2D anisotropic;
layout(location = 0) out uint color;
void main() {
    vec2 uv = gl_FragCoord.xy * vec2(16.0, 1.0) / 64.0;
    vec2 levels = vec2(texture(trilinear, uv).r, texture(anisotropic, uv).r);
    color = packUnorm2x16(levels);
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    image = create_image(bench.device, "r8", (64, 64), usage, "selftest", levels=7)
    bench.at_end(destroy_image, bench.device, image)
    sides = [64 >> level for level in range(7)]
    # A copy begins at a multiple of 4 bytes: the last levels (4 and 1 bytes) happen to.
    data = np.concatenate([np.full(side * side, 20 * level, np.uint8) for level, side in enumerate(sides)])
    bench.fill(image.handle, (64, 64), data, levels=7)
    limit = float(bench.device.limits.maxSamplerAnisotropy)
    linear = {
        "magFilter": vk.VK_FILTER_LINEAR,
        "minFilter": vk.VK_FILTER_LINEAR,
        "mipmapMode": vk.VK_SAMPLER_MIPMAP_MODE_LINEAR,
        "maxLod": vk.VK_LOD_CLAMP_NONE,
    }
    plain = Texture(image.view, bench.sampler(**linear))
    better = Texture(image.view, bench.sampler(**linear, anisotropyEnable=1, maxAnisotropy=min(limit, 16.0)))
    program = bench.graphics({"vert": FULL_SCREEN, "frag": FRAGMENT}, [plain, better])
    pixels = bench.render(program, (8, 8), lambda commands: bench.fn.vkCmdDraw(commands, 3, 1, 0, 0))
    levels = np.array([pixels[4, 4] & 0xFFFF, pixels[4, 4] >> 16]) / 65535.0 * 255.0 / 20.0
    # log2(16) = 4 without; with a ratio of N, log2(16 / N), for which drivers take some freedom.
    wanted = max(4.0 - np.log2(min(limit, 16.0)), 0.0)
    if abs(levels[0] - 4.0) > 0.25:
        return f"the trilinear sampler took level {levels[0]:.2f} and should take 4"
    if abs(levels[1] - wanted) > 1.0:
        return f"the anisotropic sampler took level {levels[1]:.2f} and should take about {wanted:.0f}"
    repeat = vk.VK_SAMPLER_ADDRESS_MODE_REPEAT
    wrap = {"addressModeU": repeat, "addressModeV": repeat, "minFilter": vk.VK_FILTER_LINEAR}

    def draw(anisotropy: float) -> None:
        how = {"anisotropyEnable": int(anisotropy > 1.0), "maxAnisotropy": min(limit, anisotropy)}
        texturing_edges.drawn(bench, **wrap, **how)

    return too_slow(draw)
