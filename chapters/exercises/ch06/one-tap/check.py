"""The farthest depth of rectangles: never nearer than a pixel of theirs, and as near as four texels allow."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import chapters
from tests.support.kernels import kernels_on
from tests.twins.bounds import pyramid_levels
from tools.exercises.checking import Given

KERNEL = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) readonly buffer Pyramid_ { float pyramid[]; };
layout(BIND(0, 1, 1), std430) readonly buffer Rectangles_ { uvec4 rectangles[]; };
layout(BIND(0, 2, 2), std430) writeonly buffer Depths_ { float depths[]; };
#include "culling/pyramid.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < COUNT) {
        uvec4 rectangle = rectangles[number];
        depths[number] = farthest_depth(rectangle.xy, rectangle.zw, uvec2(WIDTH, HEIGHT));
    }
}
"""
SIZES = ((64, 64), (131, 77), (53, 200))


def check(given: Given) -> None:
    """Noise, in which every pixel matters, at three sizes."""
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "rectangles.comp"
        file.write_text(KERNEL, "utf-8")
        for seed, (width, height) in enumerate(SIZES):
            rng = np.random.default_rng(seed)
            depth = rng.random((height, width), np.float32)
            levels = pyramid_levels(depth)
            rectangles = _rectangles(rng, width, height)
            defines = (("COUNT", f"{len(rectangles)}u"), ("WIDTH", f"{width}u"), ("HEIGHT", f"{height}u"))
            words = np.concatenate([level.reshape(-1) for level in levels])
            arrays = [words, rectangles, np.zeros(len(rectangles), np.float32)]
            found = kernels.run(kernels.pipeline(file, defines=defines), arrays, (len(rectangles),))[2]
            given.silent()
            _judge(given, depth, levels, rectangles, found)


def _rectangles(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Return (N, 4) uint32: first and last pixel of rectangles of every size, those of single pixels among them."""
    corner = rng.integers(0, (width, height), (200, 2))
    size = np.minimum(2.0 ** rng.uniform(0, 7, (200, 2)), (width, height)).astype(int) - 1
    last = np.minimum(corner + size, (width - 1, height - 1))
    return np.concatenate([corner, last], axis=1).astype(np.uint32)


def _judge(
    given: Given, depth: np.ndarray, levels: list[np.ndarray], rectangles: np.ndarray, found: np.ndarray
) -> None:
    height, width = depth.shape
    for (x0, y0, x1, y1), value in zip(rectangles.tolist(), found.tolist(), strict=True):
        where = f"The pixels ({x0}, {y0}) to ({x1}, {y1}) of a picture of {width}x{height}"
        farthest = float(depth[y0 : y1 + 1, x0 : x1 + 1].min())
        given.need(
            value <= farthest,
            f"{where} have depths down to {farthest:.3f}, and {value:.3f} is returned: something behind is lost.",
        )
        level = next(
            number
            for number in count(1)
            if (x1 >> number) - (x0 >> number) <= 1 and (y1 >> number) - (y0 >> number) <= 1
        )
        texels = levels[level - 1][y0 >> level : (y1 >> level) + 1, x0 >> level : (x1 >> level) + 1]
        given.need(
            value >= float(texels.min()),
            f"{where} lie in four texels of level {level} with the minimum {texels.min():.3f}, and {value:.3f} is "
            "returned: hidden things are kept.",
        )
