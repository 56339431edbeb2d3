"""Self-test: texels of bound pages are read right, and the shader is told which pages are bound."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench, differ
from backends.vulkan.selftests.bindings import Texture
from backends.vulkan.selftests.pages import SIZE, sparse_image

SOURCE = """
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) uniform usampler2D image;
layout(std430, set = 0, binding = 1) writeonly buffer B { uvec2 b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    uvec4 texel = uvec4(0);
    int code = sparseTexelFetchARB(image, ivec2(i % 256u, i / 256u), 0, texel);
    b[i] = uvec2(sparseTexelsResidentARB(code) ? 1u : 0u, texel.r);
}
"""
EXTENSIONS = ("GL_ARB_sparse_texture2",)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    image = sparse_image(
        bench, "r32ui", vk.VK_IMAGE_USAGE_SAMPLED_BIT, bound=lambda column, row: (column + row) % 2 == 0
    )
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    data = (y * 1000 + x + 1).astype(np.uint32)
    bench.fill(image.handle, (SIZE, SIZE), data)
    output = bench.output(2 * SIZE * SIZE)
    bench.dispatch(SOURCE, [Texture(image.view, bench.sampler()), output], SIZE * SIZE // 64, EXTENSIONS)
    words = bench.read(output, np.uint32).reshape(SIZE, SIZE, 2)
    bound = (x // image.page[0] + y // image.page[1]) % 2 == 0
    wrong = differ("residency codes", words[..., 0], bound.astype(np.uint32))
    # What an unbound page returns is the driver's to say.
    return wrong or differ("texels", words[..., 1][bound], data[bound])
