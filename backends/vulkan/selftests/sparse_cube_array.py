"""Self-test: a sparse array of two cubes, sampled by direction on all twelve faces."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench, differ
from backends.vulkan.selftests.bindings import Texture
from backends.vulkan.selftests.pages import SIZE, sparse_image
from common.errors import UnsupportedError

SOURCE = """
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) uniform samplerCubeArray image;
layout(std430, set = 0, binding = 1) readonly buffer A { vec4 directions[]; };
layout(std430, set = 0, binding = 2) writeonly buffer B { float b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    b[i] = textureLod(image, directions[i], 0.0).r;
}
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    if ("VkPhysicalDeviceFeatures2", "imageCubeArray") not in bench.device.physical.bits:
        raise UnsupportedError("The driver lacks the feature imageCubeArray.")
    image = sparse_image(
        bench,
        "r32f",
        vk.VK_IMAGE_USAGE_SAMPLED_BIT,
        layers=12,
        flags=vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT,
        view_type=vk.VK_IMAGE_VIEW_TYPE_CUBE_ARRAY,
    )
    # Exact in 32 bits: layer, row and column of each texel.
    data = np.arange(12 * SIZE * SIZE, dtype=np.float32).reshape(12, SIZE, SIZE)
    bench.fill(image.handle, (SIZE, SIZE), data)
    layer, y, x = (a.ravel() for a in np.mgrid[0:12, 5:SIZE:16, 3:SIZE:16])
    directions = np.concatenate([_direction(layer % 6, x, y), layer[:, None] // 6], axis=1)
    output = bench.output(len(layer))
    texture, asked = Texture(image.view, bench.sampler()), bench.input(directions.astype(np.float32))
    bench.dispatch(SOURCE, [texture, asked, output], len(layer) // 64)
    return differ("texels", bench.read(output, np.float32), data[layer, y, x])


def _direction(face: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return (n, 3): towards the centre of texel (x, y) of a cube's face.

    The inverse of the table "Cube map face and coordinate selection" in the Vulkan specification.
    """
    s, t = (x + 0.5) / SIZE * 2 - 1, (y + 0.5) / SIZE * 2 - 1
    unit = np.ones_like(s)
    faces = [(unit, -t, -s), (-unit, -t, s), (s, unit, t), (s, -unit, -t), (s, -t, unit), (-s, -t, -unit)]
    table = np.stack([np.stack(vectors, axis=1) for vectors in faces])
    chosen: np.ndarray = table[face, np.arange(len(face))]
    return chosen
