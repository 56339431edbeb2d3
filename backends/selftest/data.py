"""What the self-tests of both backends compute and sample: shaders, what they read, and the results that are right.

`selftest_draws` has what they draw. Neither names an API. `BIND(0, b, k)` is binding `b` on Vulkan and `k` on OpenGL,
which counts buffers and textures by themselves: a bench binds its list of resources in that order.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

SIZE = (16, 16)
"""The target of every draw."""

UNSET = 0xCDCDCDCD
"""What an output buffer holds before the GPU writes to it."""

FULL_SCREEN = "void main() { gl_Position = vec4(VERTEX_ID == 1 ? 3 : -1, VERTEX_ID == 2 ? 3 : -1, 0.5, 1); }"
"""A vertex shader whose three vertices cover everything."""


def differ(what: str, values: np.ndarray, expected: np.ndarray) -> str:
    """Return "" where two arrays are equal, else how many of their values differ, and the first of these."""
    wrong = np.flatnonzero(np.ravel(values != expected))
    if not wrong.size:
        return ""
    first = int(wrong[0])
    return (
        f"{wrong.size} of {expected.size} {what} differ, the first ({first}) is {values.ravel()[first]} "
        f"and should be {expected.ravel()[first]}"
    )


# --- computing --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Computation:
    """A compute shader that reads storage buffer 0, filled with `input`, and writes storage buffer 1.

    A result may be off by `tolerance`, relative to the right one.
    """

    source: str
    input: np.ndarray
    expected: np.ndarray
    groups: int = 1
    tolerance: float = 0.0

    @property
    def words(self) -> int:
        """The length of the output in 32-bit words."""
        return self.expected.nbytes // 4

    def wrong(self, values: np.ndarray) -> str:
        """Return "" for results that are right, else what is wrong."""
        if not self.tolerance:
            return differ("numbers", values, self.expected)
        error = np.max(np.abs(values - self.expected) / np.abs(self.expected))
        return "" if error < self.tolerance else f"the relative error is {error:.1e}"


_BUFFERS = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) readonly buffer In { uint given[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Out { uint sums[]; };
shared uint held[64];
void main() {
    uint i = gl_LocalInvocationIndex;
    held[i] = given[gl_GlobalInvocationID.x];
    barrier();
    sums[gl_GlobalInvocationID.x] = held[i] + 3u * held[63u - i];
}
"""


def compute_buffers() -> Computation:
    """Return sums of each word with another one of its group, which share memory."""
    numbers = (np.arange(256, dtype=np.uint64) * 2654435761 % 65521).astype(np.uint32)
    rows = numbers.reshape(4, 64)
    return Computation(_BUFFERS, numbers, (rows + 3 * rows[:, ::-1]).ravel(), groups=4)


_FP64 = """
layout(local_size_x = 64) in;
layout(std430, BIND(0, 0, 0)) readonly buffer A { double a[]; };
layout(std430, BIND(0, 1, 1)) writeonly buffer B { double b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    double x = a[i], y = a[i ^ 1u];
    b[4 * i + 0] = x + y * 1e-9lf;
    b[4 * i + 1] = x * y;
    b[4 * i + 2] = x / y;
    b[4 * i + 3] = sqrt(abs(x));
}
"""


def fp64() -> Computation:
    """Return arithmetic of 64-bit floats.

    Division and root may be off by some steps of the last place; 32-bit floats would be off by 1e-8 and more.
    """
    x = np.random.default_rng(53).uniform(1.0, 2.0, 64) * np.where(np.arange(64) % 3, 1.0, -1e6)
    y = x[np.arange(64) ^ 1]
    expected = np.stack([x + y * 1e-9, x * y, x / y, np.sqrt(np.abs(x))], axis=1).ravel()
    return Computation(_FP64, x, expected, tolerance=1e-14)


_INT64 = """
layout(local_size_x = 64) in;
layout(std430, BIND(0, 0, 0)) readonly buffer A { uint64_t a[]; };
layout(std430, BIND(0, 1, 1)) writeonly buffer B { uint64_t b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    uint64_t x = a[i], y = a[i ^ 1u];
    b[4 * i + 0] = x * y + 12345678901234567ul;
    b[4 * i + 1] = x / (y | 1ul);
    b[4 * i + 2] = (x >> 7) ^ (y << 33);
    b[4 * i + 3] = x > y ? x - y : uint64_t(int64_t(x) >> 3);
}
"""


def int64() -> Computation:
    """Return arithmetic of 64-bit integers."""
    x = np.random.default_rng(64).integers(0, 2**64, 64, dtype=np.uint64)
    y = x[np.arange(64) ^ 1]
    with np.errstate(over="ignore"):
        expected = np.stack(
            [
                x * y + np.uint64(12345678901234567),
                x // (y | np.uint64(1)),
                (x >> np.uint64(7)) ^ (y << np.uint64(33)),
                np.where(x > y, x - y, (x.view(np.int64) >> np.int64(3)).view(np.uint64)),
            ],
            axis=1,
        )
    return Computation(_INT64, x, expected.ravel())


_SUBGROUPS = """
layout(local_size_x = 64) in;
layout(std430, BIND(0, 0, 0)) readonly buffer A { uint a[]; };
layout(std430, BIND(0, 1, 1)) writeonly buffer B { uint b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x, own = a[i], fine = 0u;
    if (i % 3u != 0u) {
        uint low = subgroupMin(own), high = subgroupMax(own), bits = subgroupOr(own);
        fine = low <= own && own <= high && (bits & own) == own ? 1u : 0u;
        // Words of invocations that do not take part are multiples of 4.
        fine *= low % 4u != 0u && high % 4u != 0u && bits % 4u == 3u ? 1u : 0u;
    }
    b[2 * i] = fine;
    b[2 * i + 1] = subgroupMin(gl_WorkGroupID.x) == subgroupMax(gl_WorkGroupID.x) ? 1u : 0u;
}
"""


def subgroups() -> Computation:
    """Return what holds for any size of a subgroup, from 4 invocations on; a third of them sits out.

    Words are multiples of 4, and those that take part have 1 or 2 added in turn.
    """
    number = np.arange(256, dtype=np.uint32)
    words = number * np.uint32(2654435761) // np.uint32(4) * np.uint32(4) + number % 3
    expected = np.stack([number % 3 != 0, np.ones(256)], axis=1).astype(np.uint32)
    return Computation(_SUBGROUPS, words.astype(np.uint32), expected.ravel(), groups=4)


COUNTED_GROUPS = 5
COUNTED_INVOCATIONS = 48 * COUNTED_GROUPS
COUNTED_COMPUTE = """
layout(local_size_x = 48) in;
layout(std430, BIND(0, 0, 0)) writeonly buffer B { uint b[]; };
void main() { b[gl_GlobalInvocationID.x] = gl_GlobalInvocationID.x; }
"""


def computed_count(counted: int, written: np.ndarray) -> str:
    """Return what is wrong with the number of invocations of COUNTED_COMPUTE, or with what they wrote."""
    if counted != COUNTED_INVOCATIONS:
        return f"{counted} invocations were counted and there are {COUNTED_INVOCATIONS}"
    return differ("numbers", written, np.arange(COUNTED_INVOCATIONS, dtype=np.uint32))


# --- textures ---------------------------------------------------------------------------------------------------------

BLOCK_COMPUTE = """
layout(local_size_x = 16) in;
layout(BIND(0, 0, 0)) uniform sampler2D blocks;
layout(std430, BIND(0, 1, 0)) writeonly buffer B { uint b[]; };
void main() {
    uint i = gl_LocalInvocationID.x;
    b[i] = packUnorm4x8(texelFetch(blocks, ivec2(i % 4u, i / 4u), 0));
}
"""
"""Writes the 16 texels of one block."""


@dataclass(frozen=True)
class Block:
    """A block of 4x4 texels in a compressed format: its bytes, (1, 8) or (1, 16), and its texels, (16,) packed."""

    format: str
    data: np.ndarray
    texels: np.ndarray


def _packed(*fields: tuple[int, int]) -> np.ndarray:
    """Return a block's bytes of (value, bits) fields, the lowest bits first, in memory's order."""
    value = place = 0
    for field, width in fields:
        value |= field << place
        place += width
    return np.frombuffer(value.to_bytes(place // 8, "little"), np.uint8)


def _words(red: np.ndarray, green: np.ndarray, blue: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return texels (16,) as the shader packs them."""
    return (red | green << 8 | blue << 16 | alpha << 24).astype(np.uint32)


def bc_blocks() -> list[Block]:
    """Return a block of BC4, one of BC5 and one of BC7."""
    random = np.random.default_rng(6)
    zero, full = np.zeros(16, np.uint32), np.full(16, 255, np.uint32)
    # One channel in 8 bytes: two ends, the lower one first, and 3 bits a texel, of which 6 is black and 7 white.
    ends = np.array([40, 200, 0, 0, 0, 0, 0, 255], np.uint32)
    red, green = random.choice([0, 1, 6, 7], (2, 16))
    red_block, two = (
        _packed((40, 8), (200, 8), *((int(code), 3) for code in codes)) for codes in (red, green)
    )
    # BC7's mode 6: ends of 7 bits a channel and one more that its channels share, and 4 bits a texel (the first: 3).
    low, high = (10, 20, 30, 40), (120, 90, 70, 127)
    colors = [(end[channel], 7) for channel in range(4) for end in (low, high)]
    last = random.choice([0, 15], 16)
    last[0] = 0
    indices = [(int(code), 3 if texel == 0 else 4) for texel, code in enumerate(last)]
    seven = _packed((1 << 6, 7), *colors, (0, 1), (1, 1), *indices)
    texels = [np.where(last == 0, 2 * low[c], 2 * high[c] + 1).astype(np.uint32) for c in range(4)]
    return [
        Block("bc4", red_block[None], _words(ends[red], zero, zero, full)),
        Block("bc5", np.concatenate([red_block, two])[None], _words(ends[red], ends[green], zero, full)),
        Block("bc7", seven[None], _words(*texels)),
    ]


def etc2_block() -> Block:
    """Return a block of ETC2.

    Differential: two halves of the same colour, 5 bits a channel and a difference of 0. Texels are numbered by columns,
    and the upper bits of their codes come before the lower ones, texel 15 first.
    """
    base = (5, 17, 28)
    modifiers = np.array([2, 8, -2, -8])  # of table 0, by a texel's code
    codes = np.random.default_rng(7).integers(0, 4, (4, 4))  # by row and column
    value = base[0] << 59 | base[1] << 51 | base[2] << 43 | 1 << 33
    for texel, code in enumerate(codes.T.ravel().tolist()):
        value |= (code >> 1) << (16 + texel) | (code & 1) << texel
    texels = [(channel << 3 | channel >> 2) + modifiers[codes.ravel()] for channel in base]
    red, green, blue = (np.clip(channel, 0, 255).astype(np.uint32) for channel in texels)
    data = np.frombuffer(value.to_bytes(8, "big"), np.uint8)
    return Block("etc2", data[None], _words(red, green, blue, np.full(16, 255, np.uint32)))


MINMAX_COMPUTE = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0)) uniform sampler2D smallest;
layout(BIND(0, 1, 1)) uniform sampler2D largest;
layout(std430, BIND(0, 2, 0)) writeonly buffer B { vec2 b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    vec2 uv = (vec2(i % 8u, i / 8u) * 2.0 + 1.0) / 16.0;
    b[i] = vec2(textureLod(smallest, uv, 0.0).r, textureLod(largest, uv, 0.0).r);
}
"""


def minmax() -> tuple[np.ndarray, np.ndarray]:
    """Return texels (16, 16) and what MINMAX_COMPUTE writes: minimum and maximum of each 2x2 of them."""
    data = np.random.default_rng(4).permutation(256).reshape(16, 16).astype(np.float32)
    blocks = data.reshape(8, 2, 8, 2)
    return data, np.stack([blocks.min((1, 3)), blocks.max((1, 3))], axis=-1).ravel()


def gray_levels(values: Sequence[int]) -> list[np.ndarray]:
    """Return the five mip levels of a texture of 16x16 texels (rgba8 in a word), each of one value."""
    return [np.full((16 >> n, 16 >> n), value * 0x01010101, np.uint32) for n, value in enumerate(values)]


MIPS_FRAGMENT = """
layout(BIND(0, 0, 0)) uniform sampler2D map;
layout(location = 0) out uint color;
void main() {
    color = packUnorm2x16(vec2(textureLod(map, vec2(0.5), 0.5 * floor(gl_FragCoord.x)).r, 0.0));
}
"""
"""The column chooses the level, in steps of a half."""

MIPS_LEVELS = (0, 200, 40, 160, 80)


def mips_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture by MIPS_FRAGMENT of `gray_levels(MIPS_LEVELS)`."""
    levels = (pixels[4] & 0xFFFF) / 65535.0 * 255.0
    expected = np.interp(np.minimum(0.5 * np.arange(16), 4.0), np.arange(5), MIPS_LEVELS)
    # The specification leaves 8 bits of fraction between levels, here of 200 codes, and a code to the format.
    worst = int(np.abs(levels - expected).argmax())
    if abs(levels[worst] - expected[worst]) > 200 / 256 + 1:
        return f"level {0.5 * worst:g} reads {levels[worst]:.1f} and should read {expected[worst]:.1f}"
    return ""


EDGES_VERTEX = """
layout(location = 0) out vec2 uv;
void main() {
    uv = vec2(VERTEX_ID == 1 || VERTEX_ID == 2 || VERTEX_ID == 4, VERTEX_ID == 2 || VERTEX_ID == 4 || VERTEX_ID == 5);
    gl_Position = vec4(uv * 2.0 - 1.0, 0.5, 1.0);
}
"""
EDGES_FRAGMENT = """
layout(BIND(0, 0, 0)) uniform sampler2D map;
layout(BIND(0, 1, 0), std430) readonly buffer Transforms { vec4 transform[]; };
layout(location = 0) in vec2 uv;
layout(location = 0) out uint color;
void main() {
    vec2 at = uv * transform[0].xy + transform[0].zw;
    color = packUnorm2x16(vec2(texture(map, at).r, 0.0));
}
"""
"""Two triangles that meet in the diagonal; a texel a pixel, so that level 0 is read. `transform` is EDGES_TRANSFORM."""

EDGES_LEVELS = (50, 100, 150, 200, 250)
EDGES_TRANSFORM = np.array([1, 1, 64, 64], np.float32)
"""Far from 0, so that a fragment that reads zeros is 1,024 texels away from its neighbours."""


def edges_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture by EDGES_FRAGMENT of `gray_levels(EDGES_LEVELS)`."""
    levels = (pixels & 0xFFFF) / 65535.0 * 255.0 / 50.0 - 1.0
    wrong, worst = int((np.abs(levels) > 0.1).sum()), levels.ravel()[np.abs(levels).argmax()]
    if not wrong:
        return ""
    return (
        f"{wrong} of 256 fragments along edges read mip level {worst:.1f} in place of 0: textures get seams"
    )


ANISOTROPY = 16.0
_LONGEST = 3.0 * ANISOTROPY
_NOTICEABLE_S = 0.1


def too_slow(draw: Callable[[float], object]) -> str:
    """Return by how much anisotropic filtering takes too long along edges of triangles, or "".

    `draw(anisotropy)` makes the picture of EDGES_FRAGMENT, whose programs were used before. A filter of ratio 16 reads
    up to 16 times as many texels; three times that is for chance. The llvmpipe of Mesa 22.3 looks at every texel of a
    footprint that reaches from the coordinate to 0: a second for these 256 fragments, in chapters hours.
    """

    def seconds(anisotropy: float) -> float:
        begun = time.perf_counter()
        draw(anisotropy)
        return time.perf_counter() - begun

    draw(1.0)
    plain = min(seconds(1.0) for _ in range(3))
    most = max(_LONGEST * plain, _NOTICEABLE_S)
    taken = seconds(ANISOTROPY)
    if taken > most:  # once more: this process may have had to wait
        taken = min(taken, seconds(ANISOTROPY))
    if taken <= most:
        return ""
    return f"256 fragments along edges take {taken:.1f} s, {taken / plain:.0f} times as long as without anisotropy"
