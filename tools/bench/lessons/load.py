"""Measures one load: `python -m tools.bench.lessons.load WHICH BACKEND SCENE WxH WAY [FILE.npz]` prints JSON.

A bench runs several (see `tools.bench.lessons.loads`, which says what the ways are), each in a process of its own.

What counts as loading: opening the scene's file or cache, all that is made of it on the CPU, its buffers, images and
descriptors, every copy, until the last byte is on the device. What does not, of a plain load as little as of a cached
one: Python, imports and the device, which are there; shaders, which are warm (`_building` takes out the time in which
pipelines are built, from the text of a shader to the driver's object, during this very load); what a driver does at
the first use of a format in a process, which `_warm_up` has it do before; and what a renderer makes for any scene, as
its targets (`_alone`).
"""

from __future__ import annotations

import io
import json
import os
import statistics
import sys
import time as clock
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from backends.vulkan.device import Device
from backends.vulkan.upload import MipPipeline
from common.errors import DeviceError
from common.gltf import load_scene
from common.scene import Material, Scene
from common.scene.crowds import crowd
from common.scene.images import Chain, Image
from common.settings import preset
from tools.bench.lessons import overlap as bench_overlap
from tools.bench.lessons.overlap import Stamps, can_stamp
from tools.run.opening import open_scene
from tools.run.run import open_device

ONCE = ("write", "compress")
"""Ways that are no second time the same: there is a cache after them."""

OUTPUTS = frozenset({"color", "color_linear"})

AFTER = 20
"""Frames that are drawn when everything has arrived: what the longest frame before is compared with."""

MOST_FRAMES = 100_000


def once(
    which: chapters.Whole,
    backend: str,
    path: Path,
    size: tuple[int, int],
    way: str,
    picture: Path | None = None,
) -> dict[str, Any]:
    """Load a scene in one of the WAYS; return seconds and bytes. `picture` is an .npz that gets what is seen."""
    if way in ("pillow", "read"):
        return _with_pillow(path) if way == "pillow" else _read(path)
    settings: Any = preset(chapters.settings_class(which), "medium")
    streams = way in ("stream", "overlap")
    settings = replace(settings, loading="stream" if streams else "wait")
    if way == "overlap":
        from tools.bench.points import recorded_anew

        settings = recorded_anew(settings)  # stamps are part of what is recorded: each frame has its own
    load = _Load(which, backend, path, size, settings, way)
    with ExitStack() as stack:
        device = open_device(stack, backend)
        stamps: Stamps | None = None
        if way == "overlap" and isinstance(device, Device) and can_stamp(device):
            stamps = Stamps(device)
            stack.callback(stamps.close)
        _warm_up(load, device)
        building = stack.enter_context(_building(which, backend))
        made = _measured(load, device, building, stamps, picture)
        # Only now: two renderers at once need memory that one alone, and the load before, find there.
        alone = _alone(load, device, building) if not streams else 0.0
    return made | {
        "load_s": max(made["total_s"] - made["pipelines_s"] - alone, 1e-6),
        "renderer_s": alone,
    }


@dataclass(frozen=True)
class _Load:
    """What is loaded, how, and into what."""

    which: chapters.Whole
    backend: str
    path: Path
    size: tuple[int, int]
    settings: Any
    way: str

    @property
    def in_blocks(self) -> bool:
        """Whether textures come as blocks."""
        return self.way in ("compress", "blocks", "least")

    def renderer(self, scene: Scene, device: Any) -> Any:
        """Return a renderer of a scene, to be closed."""
        return chapters.open(
            self.which,
            self.backend,
            scene=scene,
            size=self.size,
            settings=self.settings,
            outputs=OUTPUTS,
            device=device,
        )


def _measured(
    load: _Load, device: Any, building: list[float], stamps: Stamps | None, picture: Path | None
) -> dict[str, Any]:
    """Return the figures of the load itself, after which scene and renderer are closed."""
    streams, way = load.settings.loading == "stream", load.way
    small = _small_images(load, load_scene(load.path, decode=False)) if way == "least" else []
    with ExitStack() as stack:
        before = _peak_bytes()
        began = clock.perf_counter()
        cached = way != "plain" and not streams
        opening = stack.enter_context(
            open_scene(load.which, str(load.path), cached=cached, compressed=load.in_blocks)
        )
        scene = replace(opening.scene, images=small) if way == "least" else opening.scene
        opened = clock.perf_counter()
        renderer = stack.enter_context(load.renderer(scene, device))
        made, pipelines = clock.perf_counter(), sum(building)
        frames = _frames(renderer, way == "stream") if streams else {}
        if way in ONCE:
            opening.finish()
        overlap = None if stamps is None else bench_overlap.record(stamps.timeline())
        done = clock.perf_counter()
        grown = _peak_bytes() - before
        if picture is not None:
            frame = renderer.render(chapters.view_of(renderer))
            np.savez(picture, **{name: frame.image(name) for name in OUTPUTS})
        decoded = sum(image.width * image.height * 4 * image.dtype.itemsize for image in scene.images)
        arrays = (scene.positions, scene.normals, scene.tangents, scene.uv0, scene.indices)
        return {
            "scene_s": opened - began,
            "open_s": made - opened,
            "total_s": done - began,
            "pipelines_s": pipelines,
            "peak_bytes": grown,
            "textures": len(scene.images),
            "decoded_bytes": decoded,
            "bytes": decoded + sum(array.nbytes for array in arrays),
            "overlap": overlap,
            **frames,
        }


def _warm_up(load: _Load, device: Any) -> None:
    """Open the scene once with textures of a few texels, always from its file: what the first of all costs goes here.

    Textures are stored as the measured load will store them, since a driver may compile code for each format. Nothing
    of a cache is touched, and no texture of the file is decoded.
    """
    import_module(f"{chapters.package_of(load.which)}.scene_cache.cache")
    opened = load_scene(load.path, decode=False)
    with load.renderer(replace(opened, images=_small_images(load, opened)), device) as renderer:
        renderer.render(chapters.view_of(renderer)).image("color")


def _small_images(load: _Load, scene: Scene) -> list[Image]:
    """Return pictures of a few texels in the place of a scene's, which are stored as those would be."""
    cached = import_module(f"{chapters.package_of(load.which)}.scene_cache.images")
    uses = cached.image_uses(scene)
    small: list[Image] = []
    for number, image in enumerate(scene.images):
        pixels = np.full((4, 4, 4), 255, image.dtype)
        compressed = load.in_blocks and cached.is_compressible(image)
        chains = {use: cached.compress(pixels, use) for use in uses.get(number, ()) if compressed}
        small.append(_Small(image.name, pixels, chains))
    return small


def _alone(load: _Load, device: Any, building: list[float]) -> float:
    """Return the seconds that a renderer takes to open for one square without a texture, but for its pipelines."""
    scene = replace(crowd(1, 1), materials=[Material()], images=[])
    took = []
    for _ in range(3):
        building.clear()
        began = clock.perf_counter()
        with load.renderer(scene, device):
            took.append(clock.perf_counter() - began - sum(building))
    return min(took)


@dataclass(frozen=True)
class _Small(Image):
    """A few texels in the place of a picture, with `chains` of blocks by use."""

    chains: Mapping[tuple[bool, bool, str], Chain] = field(default_factory=dict)

    def chain(self, srgb: bool, mipmapped: bool, channels: str) -> Chain | None:
        """Return the blocks."""
        return self.chains.get((srgb, mipmapped, channels))


@contextmanager
def _building(which: chapters.Whole, backend: str) -> Iterator[list[float]]:
    """Yield a list that gets the seconds of each call that builds pipelines: texts, SPIR-V, reflection, driver."""
    pipelines = import_module(f"{chapters.package_of(which)}.pipelines.{backend}").Pipelines
    took: list[float] = []

    def timed(call: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **more: Any) -> Any:
            began = clock.perf_counter()
            try:
                return call(*arguments, **more)
            finally:
                took.append(clock.perf_counter() - began)

        return run

    before = [
        (owner, name, getattr(owner, name)) for owner, name in ((pipelines, "get"), (MipPipeline, "build"))
    ]
    for owner, name, call in before:
        setattr(owner, name, timed(call))
    try:
        yield took
    finally:
        for owner, name, call in before:
            setattr(owner, name, call)


def _frames(renderer: Any, waits: bool) -> dict[str, Any]:
    """Draw until all textures have arrived, and some frames more; return how many that took, and the longest.

    If it `waits` for the GPU behind each frame, what a frame takes is the renderer's own thread, without drawing. Else
    frames follow each other as in a window, and the GPU has always something to draw.
    """
    view = chapters.view_of(renderer)
    meanwhile: list[float] = []
    whole: list[float] = []
    after: list[tuple[float, float]] = []
    first = complete = 0.0
    began = clock.perf_counter()
    while len(after) < AFTER:
        start = clock.perf_counter()
        frame = renderer.render(view)
        if waits:
            sum(frame.timings.values())
        end = clock.perf_counter()
        first = first or end - began
        if frame.work["textures_waiting"]:
            meanwhile.append(frame.cpu_ms)
            whole.append((end - start) * 1e3)
            if len(meanwhile) > MOST_FRAMES:
                raise DeviceError(f"{frame.work['textures_waiting']} textures never arrived.")
        else:
            complete = complete or end - began
            after.append((frame.cpu_ms, (end - start) * 1e3))
    steady = sorted(after[2:])
    return {
        "first_frame_s": first,
        "complete_s": complete,
        "frames": len(meanwhile),
        "longest_ms": max(meanwhile, default=0.0),
        "longest_frame_ms": max(whole, default=0.0),
        "after_ms": statistics.median(own for own, _ in steady),
        "after_frame_ms": statistics.median(frame for _, frame in steady),
    }


def _with_pillow(path: Path) -> dict[str, Any]:
    """Read a document with pygltflib and decode its images with Pillow, on the threads that loading takes."""
    from PIL import Image as Pillow
    from pygltflib import GLTF2

    began = clock.perf_counter()
    document: Any = GLTF2().load(str(path))

    def decode(image: Any) -> np.ndarray:
        if image.uri:
            raw = (path.parent / image.uri).read_bytes()
        else:
            view = document.bufferViews[image.bufferView]
            start = view.byteOffset or 0
            raw = document.binary_blob()[start : start + view.byteLength]
        with Pillow.open(io.BytesIO(raw)) as picture:
            return np.asarray(picture.convert("RGBA"))

    for buffer in document.buffers or []:
        if buffer.uri:
            (path.parent / buffer.uri).read_bytes()
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        decoded = list(pool.map(decode, document.images or []))
    took = clock.perf_counter() - began
    return {"load_s": took, "total_s": took, "decoded_bytes": sum(one.nbytes for one in decoded)}


def _read(path: Path) -> dict[str, Any]:
    """Do what `_with_pillow` does with this project's own reader, which makes a whole scene of it."""
    began = clock.perf_counter()
    scene = load_scene(path)
    took = clock.perf_counter() - began
    return {"load_s": took, "total_s": took, "decoded_bytes": sum(one.pixels.nbytes for one in scene.images)}


def _peak_bytes() -> int:
    """Return the most memory that this process had so far; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def main() -> None:
    """Measure this process."""
    chapter, backend, path, size, way, *picture = sys.argv[1:]
    width, _, height = size.partition("x")
    which = chapters.parse_chapter(chapter)
    made = once(which, backend, Path(path), (int(width), int(height)), way, *map(Path, picture))
    print(json.dumps(made))


if __name__ == "__main__":
    main()
