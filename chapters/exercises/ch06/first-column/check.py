"""Radii of spheres under matrices of every kind, against the largest singular value."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import chapters
from tests.support.kernels import kernels_on
from tools.exercises.checking import Given

KERNEL = """
#include "masks.glsl"
layout(local_size_x = 64) in;
struct View {
#include "frame_constants.glsl"
};
layout(BIND(0, 0, 0), std430) readonly buffer View_ { View views[]; };
#define view views[0]
struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 1), std430) readonly buffer Pyramid_ { float pyramid[]; };
layout(BIND(0, 2, 2), std430) readonly buffer Matrices_ { mat3x4 matrices[]; };
layout(BIND(0, 3, 3), std430) writeonly buffer Radii_ { float radii[]; };
#define CULLING 1
#include "culling/tests.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < COUNT) {
        Instance instance;
        instance.world_from_object = matrices[number];
        radii[number] = bounds_of_meshlet(instance, vec4(0.0, 0.0, 0.0, 1.0), vec3(0.5)).radius;
    }
}
"""


def check(given: Given) -> None:
    """No radius is smaller than the largest singular value, and none is much larger."""
    named = _matrices()
    matrices = np.concatenate([kind for _, kind in named])
    names = [name for name, kind in named for _ in kind]
    rows = np.zeros((len(matrices), 3, 4), np.float32)
    rows[:, :, :3] = matrices
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "radii.comp"
        file.write_text(KERNEL, "utf-8")
        pipeline = kernels.pipeline(file, defines=(("COUNT", f"{len(rows)}u"),))
        # A view of zeros adds no rounding but that of the reach.
        arrays = [np.zeros(4096, np.float32), np.zeros(4, np.float32), rows, np.zeros(len(rows), np.float32)]
        radii = kernels.run(pipeline, arrays, (len(rows),))[3]
    given.silent()
    true = np.linalg.norm(rows[:, :, :3].astype(np.float64), ord=2, axis=(1, 2))
    for name, radius, least in zip(names, radii.tolist(), true.tolist(), strict=True):
        given.need(
            radius >= least,
            f"A sphere of radius 1 under a matrix with {name} reaches {least:.4g} m, and its bound is {radius:.4g} m.",
        )
        given.need(
            radius <= 1.8 * least + 1e-3,
            f"A sphere of radius 1 under a matrix with {name} reaches {least:.4g} m: {radius:.4g} m is far too much.",
        )


def _matrices() -> list[tuple[str, np.ndarray]]:
    """Return matrices (N, 3, 3) by what they do."""
    rng = np.random.default_rng(6)
    turns = np.linalg.qr(rng.normal(size=(8, 3, 3)))[0]
    kinds = [("a turn", np.eye(3)), ("a scale of 5 along x", np.diag([5.0, 1.0, 1.0]))]
    kinds += [
        ("a scale of 9 along y", np.diag([1.0, 9.0, 1.0])),
        ("a scale of 9 along z", np.diag([1.0, 1.0, 9.0])),
    ]
    kinds += [("a mirror", np.diag([-1.0, 1.0, 3.0]))]
    sheared = np.eye(3)
    sheared[0, 1] = 1.5
    kinds += [("a shear", sheared), ("a shear along y", sheared.T.copy())]
    return [(name, turns @ matrix) for name, matrix in kinds]
