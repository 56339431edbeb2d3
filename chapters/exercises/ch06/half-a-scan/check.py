"""Prefix sums of random numbers, twice in a row, against numpy."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import chapters
from tests.support.kernels import kernels_on
from tools.exercises.checking import Given

KERNEL = """
layout(local_size_x = 256) in;
layout(BIND(0, 0, 0), std430) readonly buffer Values_ { uvec2 values[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Before_ { uvec4 before[]; };
layout(BIND(0, 2, 2), std430) writeonly buffer Totals_ { uvec4 totals[]; };
#include "culling/sums.glsl"

void main() {
    uvec2 total, again;
    uvec2 first = sum_before(values[gl_GlobalInvocationID.x], total);
    uvec2 second = sum_before(values[gl_GlobalInvocationID.x].yx, again);
    before[gl_GlobalInvocationID.x] = uvec4(first, second);
    if (gl_LocalInvocationIndex == 0u) {
        totals[gl_WorkGroupID.x] = uvec4(total, again);
    }
}
"""
GROUP, GROUPS = 256, 40


def check(given: Given) -> None:
    """Some work groups, each of which sums two columns, and then the same columns exchanged."""
    values = np.random.default_rng(7).integers(0, 100, (GROUPS, GROUP, 2)).astype(np.uint32)
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "sums.comp"
        file.write_text(KERNEL, "utf-8")
        arrays = [
            values,
            np.zeros((GROUPS, GROUP, 4), np.uint32),
            np.zeros((GROUPS, 4), np.uint32),
        ]
        _, before, totals = kernels.run(kernels.pipeline(file), arrays, (GROUPS * GROUP,))
    given.silent()
    both = np.concatenate([values, values[..., ::-1]], axis=-1)
    wanted = np.cumsum(both, axis=1) - both
    for call in range(2):
        columns = slice(2 * call, 2 * call + 2)
        wrong = np.argwhere((before[..., columns] != wanted[..., columns]).any(axis=-1))
        if len(wrong):
            group, place = wrong[0].tolist()
            given.need(
                False,
                f"{'The second sum' if call else 'The sum'} before invocation {place} of work group {group} is "
                f"{before[group, place, 2 * call]}, and should be {wanted[group, place, 2 * call]}.",
            )
        given.need(
            np.array_equal(totals[:, columns], both.sum(axis=1)[:, columns]),
            "The total of a work group is not the sum of its values.",
        )
