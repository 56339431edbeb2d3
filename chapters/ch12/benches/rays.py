"""Rays a second of the three ways and of Embree, and what builds cost: `strata bench 12 --only rays`.

The ways are those of the setting `ray_way`: a ray-tracing pipeline and ray queries over the structures of the driver,
and our BVH in compute, which OpenGL has, too. All trace the same rays: those of a camera, whose neighbours go the same
way, and rays chosen by lot, which do not. Embree (package embreex, of the extra `reference`) traces them on one core of
the processor; without the package there is neither its speed nor the agreement.

Times are those of the clock, around submissions that are waited for, less that of an empty one: a software driver's
timestamps do not wait for its work. Each way first traces some rays that are not timed; then all ways take turns. A
submission is cut so that it takes a quarter of a second at most.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from common.reports.benches import Effort, Subject, middle
from common.settings import knobs

from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Described
from ..rays.bvh import model, pack
from ..rays.bvh.fast import Rebuilt
from ..rays.groups import ray_description
from ..rays.picture import BVH, DEFINES, PIPELINE
from . import rays_scenes as scenes
from .pass_times import is_software
from .rays_results import EMBREE, plot, sentences, show
from .rays_scenes import Geometry, Hits

__all__ = ["EMBREE", "measure", "plot", "sentences", "show"]

KNOB = "ray_way"
"""The setting; a chapter without it traces no rays."""

SCENES, QUICK_SCENES = ("atrium:small", "market"), ("atrium:small",)
"""The project's scenes that are traced, beside the sphere."""

SPHERE, QUICK_SPHERE = (250, 201), (60, 41)
"""Segments and rings of the sphere: of 100,000 triangles."""

RAYS, SLOW_RAYS, QUICK_RAYS = 1 << 20, 1 << 18, 1 << 14
"""Rays of a kind: on a GPU, on a software driver, and for a quick look."""

KINDS: dict[str, Callable[[Geometry, int], scenes.Floats]] = {
    "camera": scenes.camera_rays,
    "random": scenes.random_rays,
}

PROBE, LONGEST_S = 4096, 0.25
"""Rays by which the speed of a way is found out, and the seconds that a submission takes at most."""

LEAST_ROUNDS = 3

MOST_TIMES = 64
"""How often short work is repeated in one submission."""

REFIT_SCENE = "sphere"

AGREEMENT = ("edges", "equal", "ties", "differ", "t_error", "t_within", "t_of_size")
"""Figures of `rays_scenes.agreement` that a row has; None without Embree, and for Embree itself."""

Step = Callable[[str, float], None]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without rays.

    A row has the speed of a way on the rays of a kind in a scene, in millions of rays a second, and its agreement with
    Embree (`rays_scenes.agreement`). `builds` and `refits` are times in ms; `bytes` of a build is the memory of what
    rays traverse, None where it is not known. `missing` says what was left out, and why.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    software, missing = is_software(subject), []
    count = (SLOW_RAYS if software else RAYS) if effort.everything else QUICK_RAYS
    backend = subject.device.capabilities.backend  # that of the subject may be "auto"
    opened, driver = _parts(backend)
    gpu = opened(subject.device)
    if not gpu.ways:
        missing.append("pipeline and query, which this device does not have")
    record: dict[str, Any] = {"rows": [], "builds": [], "refits": []}
    try:
        names = SCENES if effort.everything else QUICK_SCENES
        for place, name in enumerate((*names, REFIT_SCENE)):
            begun, part = 0.9 * place / (1 + len(names)), 0.9 / (1 + len(names))

            def within(
                what: str, done: float, name: str = name, begun: float = begun, part: float = part
            ) -> None:
                step(f"{name}, {what}", begun + done * part)

            size = SPHERE if effort.everything else QUICK_SPHERE
            within("geometry", 0.0)
            geometry = (
                scenes.sphere(*size) if name == REFIT_SCENE else scenes.geometry_of(subject.load(name), name)
            )
            one = _Scene(gpu, driver, geometry, effort)
            try:
                record["builds"] += one.builds(within)
                record["rows"] += one.rows(count, within)
                if name == REFIT_SCENE:
                    record["refits"] += one.refits(within)
            finally:
                one.close()
    finally:
        gpu.close()
    if not any(row["way"] == EMBREE for row in record["rows"]):
        missing.append("embree, since the package embreex is not installed (extra: reference)")
    return {"software": software, "backend": backend, "missing": missing, **record}


def _parts(backend: str) -> tuple[Any, Any]:
    """Return the classes that run kernels on a graphics API and that hold the driver's structures."""
    if backend == "vulkan":
        from . import vulkan_rays

        return vulkan_rays.Gpu, vulkan_rays.Driver
    from . import gl_rays

    return gl_rays.Gpu, gl_rays.Driver


class _Scene:
    """One geometry with all structures over it."""

    def __init__(self, gpu: Any, driver: Any, geometry: Geometry, effort: Effort) -> None:
        self._gpu, self._make_driver, self._geometry = gpu, driver, geometry
        self._rounds = max(effort.rounds, LEAST_ROUNDS)
        self._driver: Any = None
        self._embree: scenes.Embree | None = None
        self._empty_s = min(gpu.seconds([]) for _ in range(5))

    def close(self) -> None:
        """Free the structures of the driver."""
        if self._driver is not None:
            self._driver.close()
            self._driver = None

    # --- builds ---

    def builds(self, step: Step) -> list[dict[str, Any]]:
        """Build every structure some times, keep the last ones, and return a row for each kind."""
        geometry = self._geometry
        times: dict[str, list[float]] = {}
        rounds = min(self._rounds, 3)
        ours: list[float] = []
        for number in range(rounds):
            step("builds", 0.3 * number / rounds)
            began = clock.perf_counter()
            trees = pack.mesh_trees([(positions, indices) for indices, positions in geometry.meshes])
            self._buffers = pack.buffers(trees, geometry.matrices, geometry.mesh_of)
            ours.append(1e3 * (clock.perf_counter() - began))
            if self._gpu.ways:
                self.close()
                self._driver = self._make_driver(self._gpu, geometry)
                times.setdefault("driver", []).append(self._driver.build_ms)
            try:
                self._embree = scenes.Embree(geometry)
            except ImportError:
                continue
            times.setdefault(EMBREE, []).append(self._embree.build_ms)
        size = sum(
            it.nbytes for it in (self._buffers.nodes, self._buffers.triangles, self._buffers.instances)
        )
        sizes = {BVH: size, "driver": self._driver.bytes if self._driver else None}
        return [
            {
                **self._named(kind),
                "triangles": geometry.triangles,
                "instances": len(geometry.mesh_of),
                **_timed(values),
                "bytes": sizes.get(kind),
            }
            for kind, values in {BVH: ours, **times}.items()
        ]

    def _named(self, way: str, **more: Any) -> dict[str, Any]:
        return {"scene": self._geometry.name, "way": way, **more}

    # --- rays ---

    def rows(self, count: int, step: Step) -> list[dict[str, Any]]:
        """Return the rows of all ways for each kind of rays."""
        gpu, found = self._gpu, []
        held = {
            number: gpu.buffer(part.view(np.uint32), "our BVH")
            for number, part in enumerate(
                (self._buffers.nodes, self._buffers.triangles, self._buffers.instances)
            )
        }
        low, high = self._geometry.box()
        size = float(np.linalg.norm(high - low))
        for number, (kind, make) in enumerate(KINDS.items()):
            rays = make(self._geometry, count)
            jobs, hits = gpu.buffer(rays, "rays"), gpu.buffer(np.zeros((len(rays), 8), np.uint32), "hits")
            runs: dict[str, _Run] = {}
            for way in (*gpu.ways, BVH):
                step(f"{kind} rays, {way}", 0.3 + 0.35 * number)
                own = held if way == BVH else {0: self._driver.world, 1: self._driver.orders}
                kernel = gpu.kernel(description(way))
                runs[way] = _Run(
                    gpu, kernel, gpu.bound(kernel, {**own, 3: jobs, 4: hits}), len(rays), self._empty_s
                )
            times: dict[str, list[float]] = {way: [] for way in runs}
            answers: dict[str, Hits] = {}
            for _ in range(self._rounds):
                for way, run in runs.items():
                    times[way].append(1e3 * run.seconds())
                    if way not in answers:
                        answers[way] = Hits.of_words(gpu.read(hits, np.uint32).reshape(-1, 8))
                if self._embree is not None:
                    answers[EMBREE], took = self._embree.trace(rays)
                    times.setdefault(EMBREE, []).append(1e3 * took)
            for way, values in times.items():
                row = self._named(way, rays=kind, count=len(rays), **_timed(values))
                row["mrays"], row["mrays_noise"] = middle([1e-3 * len(rays) / ms for ms in values])
                row["hits"] = float(answers[way].hit.mean())
                truth = answers.get(EMBREE)
                known = truth is not None and way != EMBREE
                agree = scenes.agreement(answers[way], truth, size) if known and truth is not None else {}
                row |= {name: agree.get(name) for name in AGREEMENT}
                found.append(row)
        return found

    # --- refits ---

    def refits(self, step: Step) -> list[dict[str, Any]]:
        """Return the times of what follows a mesh that deforms: of our BVH and of the driver."""
        step("refits", 0.95)
        rows, (indices, positions) = [], self._geometry.meshes[0]
        works = _Bends(self._gpu, indices, positions)
        for what, calls in works.calls().items():
            self._gpu.seconds(calls)  # drivers compile at the first dispatch
            times = [max(self._gpu.seconds(calls) - self._empty_s, 0.0) for _ in range(max(self._rounds, 3))]
            rows.append(
                self._named(BVH, what=what, dispatches=len(calls), **_timed([1e3 * it for it in times]))
            )
        if self._gpu.ways:
            built = self._make_driver(self._gpu, self._geometry, refits=True)
            try:
                for what, run in (("refit", built.refit_seconds), ("upper level", built.top_seconds)):
                    run()
                    times = [max(run() - self._empty_s, 0.0) for _ in range(max(self._rounds, 3))]
                    rows.append(
                        self._named("driver", what=what, dispatches=0, **_timed([1e3 * it for it in times]))
                    )
            finally:
                built.close()
        return rows


def _timed(values: Sequence[float]) -> dict[str, float]:
    middle_ms, noise = middle(values)
    return {"ms": middle_ms, "noise_ms": noise, "least_ms": min(values)}


def description(way: str) -> Described:
    """Return the pipeline by which a way traces the rays of the bench."""
    defines = (
        *(it for it in DEFINES[way] if not it[0].startswith("RAYS_S")),
        ("RAYS_SET", 0),
        ("RAYS_SLOT", 0),
    )
    if way == PIPELINE:
        # Its groups say themselves that they are of a pipeline.
        defines = tuple(it for it in defines if it[0] != "RAYS_PIPELINE")
        return ray_description("benches/trace.rgen", defines, name="rays of the bench")
    return ComputeDescription("benches/trace.comp", defines, name=f"rays of the bench, {way}")


class _Run:
    """All rays by one way, cut so that no submission takes long."""

    def __init__(self, gpu: Any, kernel: Any, bound: Any, count: int, empty_s: float) -> None:
        self._gpu, self._kernel, self._bound, self._empty_s = gpu, kernel, bound, empty_s
        probe = min(PROBE, count)
        self._run(0, probe)  # drivers compile at the first dispatch
        # Rays at other places may take longer, so this is some way from half a second.
        seconds = min(max(self._run(0, probe) - empty_s, 1e-7) for _ in range(3)) / probe
        self._tile = max(min(count, int(LONGEST_S / seconds)), 1)
        self._count = count
        whole = sum(self._run(first, min(self._tile, count - first)) for first in range(0, count, self._tile))
        times = int(LONGEST_S / max(whole - empty_s, 1e-6)) if self._tile == count else 1
        self._times = max(min(times, MOST_TIMES), 1)

    def _run(self, first: int, count: int, times: int = 1) -> float:
        seconds: float = self._gpu.seconds([(self._kernel, self._bound, count, (first, count, 0, 0))], times)
        return seconds

    def seconds(self) -> float:
        """Return the seconds in which all rays are traced."""
        total = 0.0
        for first in range(0, self._count, self._tile):
            took = self._run(first, min(self._tile, self._count - first), self._times)
            total += max(took - self._empty_s / self._times, 1e-9)
        return total


class _Bends:
    """The dispatches by which our BVH of one mesh follows its vertices: a refit, and a build on the GPU."""

    def __init__(self, gpu: Any, indices: Any, positions: Any) -> None:
        tree = pack.mesh_tree(positions, indices, mesh=0, deforming=True)
        buffers = pack.buffers([tree], np.eye(4)[None], [0])
        root, first = int(buffers.roots[0]), int(buffers.firsts[0])
        self._gpu, self._first, self._count = gpu, first, len(tree.triangles)
        self._mesh = Rebuilt(root, first, self._count)
        self._levels = pack.refit_lists([(root, tree.levels)])
        table = np.zeros(8, np.uint32)
        table[6] = positions.size  # the word behind all positions, where indices begin
        content = {
            "nodes": buffers.nodes.view(np.uint32),
            "triangles": buffers.triangles.view(np.uint32),
            "instances": buffers.instances,
            "meshes": table,
            "words": np.concatenate([positions.reshape(-1).view(np.uint32), indices.reshape(-1)]),
            "list": np.concatenate(self._levels),
        }
        for name, size in self._mesh.sizes.items():
            content[name] = np.zeros(size // 4, np.uint32)
        content["other"] = np.zeros(self._mesh.sizes["pairs"] // 4, np.uint32)
        self._buffers = {name: gpu.buffer(array, name) for name, array in content.items()}

    def calls(self) -> dict[str, list[tuple[Any, Any, int, Sequence[int]]]]:
        """Return the dispatches of a refit and of a build on the GPU, which refits in the end."""
        corners = ("nodes", "triangles", "instances", "meshes", "words")
        fit = [self._call("refit.comp", "TRIANGLES", corners, self._count, (self._first, self._count, 0, 0))]
        begun = 0
        for level in self._levels:
            boxes = ("nodes", "triangles", "instances", "list")
            fit.append(self._call("refit.comp", "", boxes, len(level), (begun, len(level), 0, 0)))
            begun += len(level)
        rebuilt = []
        for step in self._mesh.rebuild():
            names: tuple[str, ...] = ("nodes", "triangles", "instances", "pairs", "halves")
            if step.file == "sort.comp":
                names = ("other", "pairs", "counts") if step.sorts else ("pairs", "other", "counts")
            elif step.file == "refit.comp":
                names = corners
            rebuilt.append(self._call(step.file, step.part, names, step.invocations, step.push))
        return {"refit": fit, "build on the GPU": rebuilt}

    def _call(
        self, file: str, part: str, names: Sequence[str], invocations: int, push: Sequence[int]
    ) -> tuple[Any, Any, int, Sequence[int]]:
        defines = (*model.CONSTANTS.items(), *(((part, 1),) if part else ()))
        kernel = self._gpu.kernel(ComputeDescription(f"rays/bvh/{file}", defines, name=f"{file} {part}"))
        held = {binding: self._buffers[name] for binding, name in enumerate(names)}
        return kernel, self._gpu.bound(kernel, held), invocations, push
