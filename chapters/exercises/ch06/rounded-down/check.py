"""All levels of the pyramid of pictures of odd sizes: their sizes, and the minimum below each texel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import chapters
from tests.support.depth_pyramids import pyramid_of
from tests.support.kernels import kernels_on
from tests.twins.bounds import pyramid_levels
from tools.exercises.checking import Given

SIZES = ((64, 32), (13, 9), (131, 77), (1, 57), (333, 65))


def check(given: Given) -> None:
    """Powers of two, odd sizes, a single column, and a size with more than one dispatch."""
    layouts: Any = given.module("culling.pyramid").PyramidLayout
    with kernels_on(given.device, chapters.package_of(given.which)) as kernels:
        kernel = Path(str(given.module("culling.pyramid").__file__)).with_name("pyramid.comp")
        pipeline = kernels.pipeline(kernel)
        for number, (width, height) in enumerate(SIZES):
            depth = np.random.default_rng(number).random((height, width), np.float32)
            depth[:, -1] *= 0.5
            true, layout = pyramid_levels(depth), layouts.of((width, height))
            shapes = [(level.width, level.height) for level in layout.levels]
            wanted = [level.shape[::-1] for level in true]
            for level, (has, should) in enumerate(zip(shapes, wanted, strict=False), 1):
                given.need(
                    has == should,
                    f"Level {level} of a picture of {width}x{height} has {has[0]}x{has[1]} texels, and "
                    f"{should[0]}x{should[1]} are needed to be above every pixel.",
                )
            given.need(
                len(shapes) == len(wanted),
                f"The pyramid of a picture of {width}x{height} has {len(shapes)} levels; {len(wanted)} end in 1x1.",
            )
            levels = pyramid_of(kernels, depth, layout, pipeline)
            for level, (found, least) in enumerate(zip(levels, true, strict=True), 1):
                wrong = np.argwhere(found != least)
                if len(wrong):
                    y, x = wrong[0].tolist()
                    given.need(
                        False,
                        f"Texel ({x}, {y}) of level {level} of a picture of {width}x{height} is {found[y, x]:.3f}, and "
                        f"the least depth below it is {least[y, x]:.3f}.",
                    )
    given.silent()
