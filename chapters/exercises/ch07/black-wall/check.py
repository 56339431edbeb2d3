"""Walls that face along each axis, and the mark of what has no normal."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import chapters
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.view.camera import Orthographic, View
from tests.support.kernels import kernels_on
from tests.support.scenes import quad_scene
from tools.exercises.checking import Given

KERNEL = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) readonly buffer Normals_ { vec4 normals[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Marked_ { uint marked[]; };
#include "shading/normal_code.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < COUNT) {
        vec3 n = number == 0u ? unit_from_octahedral(unpackSnorm2x16(NO_NORMAL)) : normals[number].xyz;
        marked[number] = kept_normal(n) == NO_NORMAL ? 1u : 0u;
    }
}
"""
AXES = {
    f"{'+' if sign > 0 else '-'}{name}": sign * axis
    for name, axis in zip("xyz", np.eye(3), strict=True)
    for sign in (1, -1)
}


def check(given: Given) -> None:
    """A wall for each direction, which a light hits at 45 degrees; then a million normals."""
    for name, axis in AXES.items():
        lit = {}
        for graph in ("forward", "deferred"):
            picture = _wall(given, axis, graph)
            lit[graph] = float(picture[16, 16, 0])
        given.need(
            abs(lit["deferred"] - lit["forward"]) <= 0.02 * lit["forward"],
            f"A wall that faces {name} has a luminance of {lit['deferred']:.3f}, and with graph=forward "
            f"{lit['forward']:.3f}.",
        )
    normals = np.random.default_rng(4).normal(size=(1 << 20, 4)).astype(np.float32)
    normals[: len(AXES), :3] = list(AXES.values())
    normals[:, :3] /= np.linalg.norm(normals[:, :3], axis=1, keepdims=True)
    normals = np.concatenate([np.zeros((1, 4), np.float32), normals])
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "marks.comp"
        file.write_text(KERNEL, "utf-8")
        pipeline = kernels.pipeline(file, defines=(("NORMAL_OCTAHEDRAL", 1), ("COUNT", f"{len(normals)}u")))
        marked = kernels.run(pipeline, [normals, np.zeros(len(normals), np.uint32)], (len(normals),))[1]
    given.silent()
    given.need(
        not marked[0],
        "The mark of what has no normal is a code, too: a wall in that direction would have none.",
    )
    for number in np.flatnonzero(marked)[:1].tolist():
        given.need(
            False, f"The normal {np.round(normals[number, :3], 3).tolist()} is kept as if it were none."
        )


def _wall(given: Given, axis: np.ndarray, graph: str) -> np.ndarray:
    """Return the picture of a wall with a normal, seen from its front."""
    up = np.roll(axis, 1)
    wall = np.eye(4)
    wall[:3, :3] = np.stack([np.cross(up, axis), up, axis], axis=1)
    sun = pose_looking_at(axis + up, np.zeros(3), np.cross(up, axis))
    scene = quad_scene(
        Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0),
        matrices=(wall, sun),
        lights=(Light("directional", node=1, intensity=3.0),),
    )
    scene.instances.visible[1] = False
    view = View(pose_looking_at(5 * axis, np.zeros(3), up), Orthographic(0.5, 0.1, 10.0), ev100=0.0)
    return given.draw(scene, view, graph=graph)
