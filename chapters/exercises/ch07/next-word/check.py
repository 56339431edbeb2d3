"""The lamps that each pixel evaluates from the bits of its tile, and the picture that they give."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import chapters
from common.scene import Scene
from tests.support.kernels import kernels_on
from tests.support.lamps import lit_town
from tests.support.light_lists import Lists
from tests.support.towns import walk
from tests.twins.light_lists import built
from tools.exercises.checking import Given

KERNEL = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) readonly buffer Light_lists_ { uint light_lists[]; };
layout(BIND(0, 1, 1), std430) buffer Found_ { uint found[]; };
struct Light { vec3 color; };
struct Frame { mat4 view_from_world; vec4 eye; };
const Frame frame = Frame(mat4(1.0), vec4(1.0));
float exposure() { return 1.0; }
const uvec2 light_count = uvec2(COUNT, 0u);
Light lights[1];
vec3 illuminance(Light light, vec3 position, float smallest2, out vec3 to_light) {
    to_light = position;
    return light.color;
}
#include "clusters/walk.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < WIDTH * HEIGHT) {
        LightWalk walk = first_light(vec3(0.0), vec2(number % WIDTH, number / WIDTH) + 0.5);
        for (uint i; next_light(walk, i);) {
            if (i < COUNT) {
                found[number * COUNT + i] += 1u;
            }
        }
    }
}
"""
SIZE = (65, 41)
CUTOFF = 0.001
"""The default of `light_cutoff`, in lux."""


def check(given: Given) -> None:
    """A word of lamps, one lamp more, and three words."""
    for count in (32, 33, 70):
        scene = lit_town(count)
        with given.open(scene, SIZE, ("color_linear",), light_lists="tiles", graph="deferred") as renderer:
            picture = renderer.render(walk()[0]).image("color_linear").copy()
            words = Lists(renderer).words
        given.silent()
        _judge(given, scene, _evaluated(given, scene, words))
        brute = given.draw(scene, walk()[0], size=SIZE, light_lists="brute", graph="deferred")
        other = int((picture != brute).any(axis=-1).sum())
        given.need(
            other == 0, f"With {count} lamps {other} pixels are not what they are with light_lists=brute."
        )


def _evaluated(given: Given, scene: Scene, words: np.ndarray) -> np.ndarray:
    """Return (H, W, L) how often a pixel evaluates a lamp, by the shaders' own loop."""
    model: Any = given.module("clusters.model")
    width, height = SIZE
    count = len(scene.lights)
    defines = (
        *model.list_defines(scene, given.settings(light_lists="tiles")),
        ("COUNT", f"{count}u"),
        ("WIDTH", f"{width}u"),
        ("HEIGHT", f"{height}u"),
    )
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "walk.comp"
        file.write_text(KERNEL, "utf-8")
        arrays = [words, np.zeros((height, width, count), np.uint32)]
        found: np.ndarray = kernels.run(kernels.pipeline(file, defines=defines), arrays, (width * height,))[1]
    given.silent()
    return found


def _judge(given: Given, scene: Scene, found: np.ndarray) -> None:
    """Hold the lamps of each pixel to those of its tile in double precision, and with radii of a thousandth more."""
    count = len(scene.lights)
    least, most = (
        built(scene, walk()[0], SIZE, CUTOFF, wider)
        .tiles.repeat(8, axis=0)
        .repeat(8, axis=1)[: SIZE[1], : SIZE[0]]
        for wider in (0.0, 1e-3)
    )
    for wrong, sentence in (
        (least & (found == 0), "is not evaluated there"),
        (found > 1, "is evaluated twice there"),
    ):
        if wrong.any():
            y, x, lamp = np.argwhere(wrong)[0].tolist()
            given.need(
                False,
                f"With {count} lamps, lamp {lamp} reaches the tile of pixel ({x}, {y}), and {sentence}.",
            )
    wrong = ~most & (found > 0)
    if wrong.any():
        y, x, lamp = np.argwhere(wrong)[0].tolist()
        given.need(
            False,
            f"With {count} lamps, pixel ({x}, {y}) evaluates lamp {lamp}, which cannot reach its tile.",
        )
