"""The order of layers in a list, as the resolve finds it: that of numpy's sort, for any number of them and for ties."""

from __future__ import annotations

import numpy as np
import pytest

from chapters import ch07
from chapters.ch07.transparency.model import SHORT
from tests.support.kernels import kernels_on

TEXT = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) buffer Ends_ { uint ends[]; };
layout(BIND(0, 1, 1), std430) buffer Keys_ { uvec4 keys[]; };
layout(BIND(0, 2, 2), std430) buffer Colors_ { vec4 colors[]; };
layout(BIND(0, 3, 3), std430) buffer Found_ { vec4 found[]; };
#include "transparency/sort.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < uint(ends.length())) {
        uint begin = number > 0u ? ends[number - 1u] : 0u;
        found[number] = vec4(composited(begin, ends[number], vec3(0.0)), 0.0);
    }
}
"""
"""Composites lists that lie one behind another, each over black."""


@pytest.fixture(scope="module")
def composite(chapter, tmp_path_factory):
    """Return a function that composites lists of keys (N, 4) with colours (N, 4): one colour for each list."""
    file = tmp_path_factory.mktemp("order") / "order.comp"
    file.write_text(TEXT, "utf-8")
    with kernels_on(chapter.device, ch07.__name__) as kernels:
        pipeline = kernels.pipeline(file, defines=(("SHORT", f"{SHORT}u"),))

        def run(lengths, keys, colors):
            ends = np.cumsum(lengths, dtype=np.uint32)
            arrays = [ends, keys, colors, np.zeros((len(ends), 4), np.float32)]
            return kernels.run(pipeline, arrays, (len(ends),))[3][:, :3].astype(np.float64)

        yield run


def lists(rng, lengths, kinds):
    """Return keys with `kinds` values of depth, instance and triangle, all different, and places in a mixed order."""
    count = sum(lengths)
    keys = rng.integers(0, kinds, (count, 4)).astype(np.uint32)
    keys[:, 3] = np.arange(count)
    begin = 0
    for length in lengths:
        part = keys[begin : begin + length]
        part[:, 3] = rng.permutation(part[:, 3])
        begin += length
    return keys


@pytest.mark.feature("oit/per-pixel-lists")
@pytest.mark.parametrize("kinds", [2, 1 << 30])
def test_layers_are_composited_in_the_order_of_depth_instance_and_triangle(composite, kinds):
    """With two values of each word nearly all keys are ties in some word, which the next one decides.

    The colour of a layer is one of two with opacity 1/2, so the value over black is a binary fraction: exact for up to
    24 layers, and a wrong order changes it. Of longer lists the last 24 layers count alone, which is rounding to 2^-24.
    """
    rng = np.random.default_rng(7)
    lengths = [0, 1, 2, 3, SHORT - 1, SHORT, SHORT + 1, 24, 100, 777]
    keys = lists(rng, lengths, kinds)
    colors = np.column_stack([rng.integers(0, 2, (len(keys), 3)), np.full(len(keys), 0.5)]).astype(np.float32)
    found = composite(lengths, keys, colors)
    begin = 0
    for number, length in enumerate(lengths):
        part = keys[begin : begin + length]
        order = part[np.lexsort(part.T[::-1])][:, 3]
        wanted = np.zeros(3)
        for color in colors[order]:
            wanted = color[:3] * 0.5 + wanted * 0.5
        assert np.abs(found[number] - wanted).max() <= (0 if length <= 24 else 2.0**-23), length
        begin += length
