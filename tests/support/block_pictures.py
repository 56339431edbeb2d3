"""Pictures for tests of block compression, and what their blocks decode to by the package of other authors."""

from __future__ import annotations

import numpy as np
import pytest

from backends.contract import Capabilities
from common.images.blocks import BLOCK_BYTES, stored_shape
from common.images.color import quantize
from tests.support.bounds import decoded_srgb

DECODED = [
    format if format in ("bc4", "bc5") else pytest.param(format, marks=pytest.mark.needs("texture2ddecoder"))
    for format in BLOCK_BYTES
]
"""Every block format, as a parameter of tests that call `check`: of most the truth is that package's."""

SAMPLE = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0)) uniform sampler2DArray source;
layout(BIND(0, 1, 0), std430) writeonly buffer Texels { vec4 texels[]; };
void main() {
    // All layers of level 0, row by row, then those of level 1, and so on.
    int rest = int(gl_GlobalInvocationID.x), level = 0;
    ivec3 size = ivec3(WIDTH, HEIGHT, LAYERS);
    while (level < LEVELS && rest >= size.x * size.y * size.z) {
        rest -= size.x * size.y * size.z;
        size.xy = max(size.xy / 2, ivec2(1));
        ++level;
    }
    if (level < LEVELS) {
        ivec3 place = ivec3(rest % size.x, rest / size.x % size.y, rest / (size.x * size.y));
        texels[gl_GlobalInvocationID.x] = texelFetch(source, place, level);
    }
}
"""
"""A shader that writes every texel of an array texture; its four constants are put into the text by `sampling`."""


def sampling(width: int, height: int, levels: int, layers: int) -> tuple[str, int]:
    """Return the shader for an image of this size, and the number of its texels."""
    text = SAMPLE
    for name, value in {"WIDTH": width, "HEIGHT": height, "LEVELS": levels, "LAYERS": layers}.items():
        text = text.replace(name, str(value))
    return text, layers * sum(max(1, width >> n) * max(1, height >> n) for n in range(levels))


def by_level(texels: np.ndarray, width: int, height: int, levels: int, layers: int) -> list[np.ndarray]:
    """Return what the shader wrote as (layers, h, w, 4) for each level."""
    found, start = [], 0
    for level in range(levels):
        shape = (layers, max(1, height >> level), max(1, width >> level), 4)
        count = int(np.prod(shape))
        found.append(texels.reshape(-1)[start : start + count].reshape(shape))
        start += count
    return found


def pictures(width: int, height: int) -> dict[str, np.ndarray]:
    """Return (H, W, 4) uint8 by name: smooth colour, noise, a normal map, and smooth colour with hard alpha."""
    y, x = (np.mgrid[0:height, 0:width] + 0.5) / np.array([height, width])[:, None, None]
    one = np.ones_like(x)
    smooth = np.stack([np.sin(6 * x + 2 * y) / 2 + 0.5, np.cos(5 * y - x) / 2 + 0.5, np.sqrt(x * y), one], -1)
    noise = np.random.default_rng(1).random((height, width, 4))
    bumps = 0.5 * np.sin(9 * x), 0.5 * np.cos(11 * y + 3 * x)
    normal = np.stack([*bumps, np.sqrt(1 - bumps[0] ** 2 - bumps[1] ** 2), one], -1) / 2 + 0.5
    alpha = smooth.copy()
    alpha[..., 3] = np.sin(20 * x) * np.sin(20 * y) > 0
    made = {"smooth": smooth, "noise": noise, "normal": normal, "alpha": alpha}
    return {name: quantize(picture) for name, picture in made.items()}


def decoded(rows: np.ndarray, format: str, width: int, height: int) -> np.ndarray:
    """Return (height, width, 4) uint8 of blocks by texture2ddecoder; of "bc4" red alone means something."""
    import texture2ddecoder

    assert rows.shape == stored_shape(format, width, height)
    decode = getattr(texture2ddecoder, f"decode_{format.removesuffix('_srgb')}")
    return np.frombuffer(decode(rows.tobytes(), width, height), np.uint8).reshape(height, width, 4)[
        ..., [2, 1, 0, 3]
    ]


def exact_bc4(rows: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return (height, width) float64 in codes of blocks of one channel, by the specification: no value is rounded.

    Two ends and 3 bits a texel. The order of the ends chooses between 6 values between them, and 4 with black and white
    (Khronos Data Format Specification 1.3, 20.4).
    """
    blocks = rows.reshape(-1, 8).astype(np.int64)
    first, second = blocks[:, 0:1], blocks[:, 1:2]
    word = sum(blocks[:, 2 + byte] << 8 * byte for byte in range(6))
    code = (word[:, None] >> 3 * np.arange(16)) & 7
    eight = np.select([code == 0, code == 1], [first, second], ((8 - code) * first + (code - 1) * second) / 7)
    six = np.select(
        [code == 0, code == 1, code == 6, code == 7],
        [first, second, 0, 255],
        ((6 - code) * first + (code - 1) * second) / 5,
    )
    texels = np.where(first > second, eight, six).reshape(len(rows), -1, 4, 4)
    return texels.transpose(0, 2, 1, 3).reshape(4 * len(rows), -1)[:height, :width]


def random_blocks(format: str, width: int, height: int, seed: int) -> np.ndarray:
    """Return blocks of random bits: they use what no encoder does, and each means something in every format here."""
    shape = stored_shape(format, width, height)
    rows = np.random.default_rng(seed).integers(0, 256, shape, np.uint8)
    if format.startswith(
        "bc7"
    ):  # whose modes are told by the first bit that is set: each as often as any other
        rows[:, ::16] |= (1 << np.random.default_rng(seed).integers(0, 8, rows[:, ::16].shape)).astype(
            np.uint8
        )
    return rows


def chains(format: str, width: int, height: int, levels: int, layers: int) -> list[list[np.ndarray]]:
    """Return random blocks for each level of each layer."""
    return [
        [
            random_blocks(format, max(1, width >> level), max(1, height >> level), 100 * layer + level)
            for level in range(levels)
        ]
        for layer in range(layers)
    ]


BC4_ROUNDING = {True: 2.0, False: 7.0}
"""Codes by which BC4 and BC5 may be off, in software and on hardware.

Mesa's software driver mixes the ends in 8 bits, and is 1.6 off at most. Where four values lie between the ends, an
NVIDIA H200 takes 0.3735 for 2/5 of the way (ends 33 and 215: 100.98 for 105.8), which is 6.8 off between 0 and 255.
"""


def check(format: str, found: np.ndarray, rows: np.ndarray, capabilities: Capabilities) -> None:
    """Assert that a shader reads from `rows` the texels (H, W, 4) float32 that the format means, in [0, 1]."""
    height, width = found.shape[:2]
    if format in ("bc4", "bc5"):
        parts = [rows] if format == "bc4" else np.split(rows.reshape(len(rows), -1, 2, 8), 2, axis=2)
        for channel, part in enumerate(parts):
            truth = exact_bc4(part.reshape(len(rows), -1), width, height)
            assert np.abs(found[..., channel] * 255 - truth).max() <= BC4_ROUNDING[capabilities.is_software]
        assert (found[..., len(parts) : 3] == 0).all() and (found[..., 3] == 1).all()
        return
    truth = decoded(rows, format, width, height)
    assert np.array_equal(np.rint(found[..., 3] * 255), truth[..., 3])
    if format.endswith("_srgb"):
        least, most = decoded_srgb(truth[..., :3])
        assert (least - 1e-6 <= found[..., :3]).all() and (found[..., :3] <= most + 1e-6).all()
    else:
        assert np.abs(found * 255 - truth).max() < 1e-3, "these formats decode to whole codes"
