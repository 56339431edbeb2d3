"""Rays of tests, traced on Vulkan by a chapter's structures: through a ray pipeline, or by ray queries in compute.

The chapter is given as the name of its package.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import create_buffer, destroy_buffer
from common.scene import Scene
from tests.support.scenes import facing

RUN = """
struct Job { vec4 origin; vec4 direction; };  // w: t_min, t_max
layout(BIND(0, 0, 0), std430) readonly buffer Jobs_ { Job jobs[]; };
layout(BIND(0, 1, 0), std430) writeonly buffer Hits_ { uvec4 hits[]; };
struct Push { uvec4 count; };  // x: rays, y: mask, z: sides that rays skip
PUSH(Push, push)

void run(uvec3 id) {
    if (id.x >= push.count.x) {
        return;
    }
    Job job = jobs[id.x];
    Ray ray = Ray(job.origin.xyz, job.origin.w, job.direction.xyz, job.direction.w);
    Hit hit = trace(ray, push.count.y, push.count.z);
    bool blocked = occluded(ray, push.count.y, push.count.z);
    hits[2u * id.x] = uvec4(floatBitsToUint(hit.t), hit.instance, hit.primitive, hit.flags);
    hits[2u * id.x + 1u] = uvec4(floatBitsToUint(hit.at), uint(blocked), 1u);
}
"""
PLACED = (("RAYS_SET", 1), ("RAYS_BINDING", 0))
WAYS = {"pipeline": "ray-tracing", "query": "ray-query"}
"""The ways on Vulkan, and the feature that each needs."""


@dataclass(frozen=True)
class Traced:
    """What rays hit, as the GPU says: (N,) arrays, `at` (N, 2). A miss has instance -1."""

    t: NDArray[np.float32]
    instance: NDArray[np.int64]
    primitive: NDArray[np.int64]
    at: NDArray[np.float32]
    back: NDArray[np.bool_]
    blocked: NDArray[np.bool_]

    @classmethod
    def of(cls, words: NDArray[np.uint32]) -> Traced:
        """Return the hits in (N, 8) words of RUN; each ray must have written its own."""
        assert (words[:, 7] == 1).all(), "not every ray ran"
        signed = words.view(np.int32).astype(np.int64)
        return cls(
            words[:, 0].copy().view(np.float32),
            signed[:, 1],
            np.where(signed[:, 1] < 0, -1, signed[:, 2]),
            words[:, 4:6].copy().view(np.float32).reshape(-1, 2),
            words[:, 3] == 1,
            words[:, 6] == 1,
        )


def write_shaders(folder: Path, way: str, accept: str = "") -> Path:
    """Write the shaders of a way into a folder, with the GLSL function `accept`; return the one that starts rays."""
    body = f'#include "rays/{way}.glsl"\n{RUN}'
    if accept and way == "query":
        body = f'#include "rays/ray.glsl"\n{accept}\n{body}'
    head, id_ = (
        ("layout(local_size_x = 64) in;\n", "gl_GlobalInvocationID")
        if way == "query"
        else ("", "gl_LaunchIDEXT")
    )
    file = folder / ("run.comp" if way == "query" else "run.rgen")
    file.write_text(f"{head}{body}\nvoid main() {{ run({id_}); }}\n")
    if accept:
        asked = f'#define RAYS_ATTRIBUTES 1\n#include "rays/payload.glsl"\n{accept}\n'
        asked += "void main() { if (!accept(found())) { ignoreIntersectionEXT; } }\n"
        (folder / "asked.rahit").write_text(asked)
    return file


class RayTraces:
    """The structures of a renderer's scene, and pipelines that trace through them."""

    def __init__(self, renderer: Any, package: str, folder: Path, **options: Any) -> None:
        self.renderer, self.api = renderer, renderer._api
        self.device, self._package, self._folder = self.api.device, package, folder
        self.scene: Scene = self.api.data._scene
        self.structures = import_module(f"{package}.rays.vulkan").RayStructures(
            self.api, self.scene, **options
        )
        self.commands = import_module(f"{package}.frames.vulkan_commands").Commands(self.device)
        self.groups = import_module(f"{package}.rays.groups")
        self.rays = import_module(f"{package}.pipelines.ray_description")
        self._compute = import_module(f"{package}.pipelines.compute_description").ComputeDescription

    def description(self, way: str, accept: str = "", **more: Any) -> Any:
        """Return the description of the pipeline of a way."""
        file = str(write_shaders(self._folder, way, accept))
        defines = (*PLACED, *((("NON_OPAQUE", 1),) if accept else ()))
        if way == "query":
            return self._compute(file, defines, **more)
        hits = (self.rays.HitGroup(self.groups.CLOSEST, str(self._folder / "asked.rahit") if accept else ""),)
        return self.rays.RayDescription(file, self.groups.MISSES, hits, defines=defines, **more)

    def pipeline(self, described: Any) -> Any:
        """Return the pipeline of a description, with the set of the structures."""
        pipeline = self.api.pipelines.get([described])[0]
        self.structures.make_sets([pipeline], PLACED[0][1])
        return pipeline

    def build(self, slot: int = 0, time: float = 0.0, deformed: bool = False) -> int:
        """Record and run what a frame at `time` builds; return the bytes that the CPU wrote."""
        written: int = self.structures.prepare(slot, self.renderer._pose(time), deformed)
        with submit_once(self.device) as handle:
            self.commands.begin(SimpleNamespace(commands=handle, index=slot))
            self.structures.record(self.commands, slot)
        return written

    def trace(
        self,
        pipeline: Any,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        t_min: float = 0.0,
        t_max: float = 1e4,
        mask: int = 0xFF,
        build: int | None = None,
        sides: int = 0,
    ) -> Traced:
        """Return what rays (N, 3) hit; with `build`, the slot, structures are built in the same submission.

        `sides` are bits of rays/ray.glsl: of surfaces with one side rays skip backs, fronts or nothing.
        """
        count = len(origins)
        jobs = np.zeros((count, 8), np.float32)
        jobs[:, 0:3], jobs[:, 3], jobs[:, 4:7], jobs[:, 7] = origins, t_min, directions, t_max
        return Traced.of(self.words(pipeline, jobs, (count,), mask, build, sides))

    def words(
        self,
        pipeline: Any,
        jobs: NDArray[np.float32],
        extent: Sequence[int],
        mask: int = 0xFF,
        build: int | None = None,
        sides: int = 0,
    ) -> NDArray[np.uint32]:
        """Return the (N, 8) words that a trace over `extent` writes, from (N, 8) words of its input."""
        count = len(jobs)
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        given = create_buffer(self.device, max(jobs.nbytes, 4), usage, "upload", "rays of a test")
        found = create_buffer(self.device, max(jobs.nbytes, 4), usage, "readback", "hits of a test")
        given.view(np.float32)[: jobs.size] = jobs.reshape(-1)
        found.mapped[:] = 0xAB
        sets = self.api.descriptors.create([(pipeline.sets[0], {0: given, 1: found}, "test")])
        push = np.array([count, mask, sides, 0], np.uint32)
        try:
            with submit_once(self.device) as handle:
                self.commands.begin(SimpleNamespace(commands=handle, index=build or 0))
                if build is not None:
                    self.structures.record(self.commands, build)
                self.commands.bind_compute(pipeline)
                self.commands.bind_compute_set(pipeline, 0, vk.array("VkDescriptorSet", sets.handles))
                self.structures.bind(self.commands, pipeline)
                self.commands.push(pipeline, push)
                self.commands.trace(pipeline, extent)
                self.device.fn.vkCmdPipelineBarrier2(handle, barriers(memory=_RAYS_TO_HOST))
            self.device.memory.invalidate(found.allocation)
            return found.view(np.uint32)[: 8 * count].reshape(-1, 8).copy()
        finally:
            self.api.descriptors.destroy(sets)
            destroy_buffer(self.device, given)
            destroy_buffer(self.device, found)

    def close(self) -> None:
        """Free the structures; no frame is in flight."""
        self.device.wait_idle()
        self.structures.close()


_ALL = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
_RAYS_TO_HOST = (_ALL, TO_HOST[1], TO_HOST[2], TO_HOST[3])


@contextmanager
def traces_of(
    chapter: Any, package: str, scene: Scene, folder: Path, frames: int = 1, **options: Any
) -> Iterator[RayTraces]:
    """Yield the structures of a scene in a chapter's renderer, which has drawn some frames; built."""
    with chapter.open(scene, (8, 8)) as renderer:
        for _ in range(frames):
            renderer.render(facing(), 0.0).image("color")
        traces = RayTraces(renderer, package, folder, **options)
        try:
            traces.build()
            yield traces
        finally:
            traces.close()


def ways_of(device: Any) -> Sequence[str]:
    """Return the ways that a device has."""
    return [way for way, feature in WAYS.items() if device.has(feature)]
