"""One load, measured in a process of its own; `loads.py` lists the ways and runs several.

A load begins when the scene's file or cache is opened, and ends when the last byte is on the device. It contains all
work on the CPU, the scene's buffers, images and descriptors, and every copy. Plain and cached loads leave out the same:

- Python, imports and the device, which exist already;
- shaders, which are warm: `_building` measures the time in which pipelines are built during the load, from the text of
  a shader to the driver's object;
- a driver's work at the first use of a format in a process, which `_warm_up` causes before;
- objects that a renderer makes for any scene, such as its targets (`_alone`).
"""

from __future__ import annotations

import io
import os
import statistics
import sys
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from backends.vulkan.device import Device
from backends.vulkan.stamps import Interval, Stamps, can_stamp, common_ms, merged
from backends.vulkan.upload import MipPipeline
from common.errors import DeviceError
from common.gltf import load_scene
from common.reports.benches import Subject, recorded_anew
from common.scene import Material, Scene
from common.scene.crowds import crowd
from common.scene.images import Chain, Image
from common.settings import flat, preset, replaced

ONCE = ("write", "compress")
"""Ways that run once: they leave a cache, so a second run would differ."""

DECODED = ("read", "pillow")
"""Ways that upload nothing, and need no device."""

KEPT = 400
"""Submissions in a record, the first ones: enough to look at."""

OUTPUTS = frozenset({"color", "color_linear"})

AFTER = 20
"""Frames that are drawn after everything has arrived, to compare the longest earlier frame with."""

MOST_FRAMES = 100_000


def decoded(path: Path, way: str) -> dict[str, Any]:
    """Read a scene in one of the ways `DECODED`; return seconds and bytes."""
    return _with_pillow(path) if way == "pillow" else _read(path)


def once(subject: Subject, path: Path, way: str, picture: Path | None = None) -> dict[str, Any]:
    """Load a scene in one of the other WAYS; return seconds and bytes. `picture` is an .npz file for the picture."""
    settings: Any = preset(subject.settings_class, "medium")
    streams = way in ("stream", "overlap")
    settings = replaced(settings, loading="stream" if streams else "wait")
    if way == "overlap":
        settings = recorded_anew(settings)  # stamps are part of a recording: each frame needs its own
    load = _Load(subject, path, settings, way)
    with ExitStack() as stack:
        device = subject.device
        stamps: Stamps | None = None
        if way == "overlap" and isinstance(device, Device) and can_stamp(device):
            stamps = Stamps(device)
            stack.callback(stamps.close)
        _warm_up(load)
        building = stack.enter_context(_building(subject))
        figures = _measured(load, building, stamps, picture)
        # After the load: a second renderer takes memory that the measured load would have to do without.
        alone = _alone(load, building) if not streams else 0.0
    return figures | {
        "load_s": max(figures["total_s"] - figures["pipelines_s"] - alone, 1e-6),
        "renderer_s": alone,
    }


@dataclass(frozen=True)
class _Load:
    """The subject, file, settings and way of a load."""

    subject: Subject
    path: Path
    settings: Any
    way: str

    @property
    def in_blocks(self) -> bool:
        """Whether textures are compressed in blocks."""
        return self.way in ("compress", "blocks", "least")

    def renderer(self, scene: Scene) -> AbstractContextManager[Any]:
        """Return a renderer of a scene, to be closed."""
        return self.subject.on(scene).open(self.settings, {*OUTPUTS})


def _measured(
    load: _Load, building: list[float], stamps: Stamps | None, picture: Path | None
) -> dict[str, Any]:
    """Return the figures of the load itself, after which scene and renderer are closed."""
    streams, way = flat(load.settings)["loading"] == "stream", load.way
    small = _small_images(load, load_scene(load.path, decode=False)) if way == "least" else []
    with ExitStack() as stack:
        before = _peak_bytes()
        began = clock.perf_counter()
        cached = way != "plain" and not streams
        opening = load.subject.module("scene_cache.cache").open_scene(load.path, None, cached, load.in_blocks)
        if opening.writer is not None:
            stack.callback(opening.writer.stop)
        scene = replace(opening.scene, images=small) if way == "least" else opening.scene
        opened = clock.perf_counter()
        renderer = stack.enter_context(load.renderer(scene))
        created, pipelines = clock.perf_counter(), sum(building)
        frames = _frames(load.subject, renderer, way == "stream") if streams else {}
        if way in ONCE and opening.writer is not None:
            opening.writer.finish(None)
        overlap = None if stamps is None else record(stamps.timeline())
        done = clock.perf_counter()
        grown = _peak_bytes() - before
        if picture is not None:
            frame = renderer.render(load.subject.view(renderer))
            np.savez(picture, **{name: frame.image(name) for name in OUTPUTS})
        decoded = sum(image.width * image.height * 4 * image.dtype.itemsize for image in scene.images)
        arrays = (scene.positions, scene.normals, scene.tangents, scene.uv0, scene.indices)
        return {
            "scene_s": opened - began,
            "open_s": created - opened,
            "total_s": done - began,
            "pipelines_s": pipelines,
            "peak_bytes": grown,
            "textures": len(scene.images),
            "decoded_bytes": decoded,
            "bytes": decoded + sum(array.nbytes for array in arrays),
            "overlap": overlap,
            **frames,
        }


def _warm_up(load: _Load) -> None:
    """Open the scene once with textures of a few texels, always from its file: it bears the costs of a first use.

    Textures are stored as in the measured load, since a driver may compile code for each format. Nothing of a cache is
    touched, and no texture of the file is decoded.
    """
    load.subject.module("scene_cache.cache")
    opened = load_scene(load.path, decode=False)
    with load.renderer(replace(opened, images=_small_images(load, opened))) as renderer:
        renderer.render(load.subject.view(renderer)).image("color")


def _small_images(load: _Load, scene: Scene) -> list[Image]:
    """Return images of a few texels in place of a scene's, stored in the same formats."""
    cached = load.subject.module("scene_cache.images")
    uses = cached.image_uses(scene)
    small: list[Image] = []
    for number, image in enumerate(scene.images):
        pixels = np.full((4, 4, 4), 255, image.dtype)
        compressed = load.in_blocks and cached.is_compressible(image)
        chains = {use: cached.compress(pixels, use) for use in uses.get(number, ()) if compressed}
        small.append(_Small(image.name, pixels, chains))
    return small


def _alone(load: _Load, building: list[float]) -> float:
    """Return the seconds to open a renderer for one square without a texture, less those of its pipelines."""
    scene = replace(crowd(1, 1), materials=[Material()], images=[])
    took = []
    for _ in range(3):
        building.clear()
        began = clock.perf_counter()
        with load.renderer(scene):
            took.append(clock.perf_counter() - began - sum(building))
    return min(took)


@dataclass(frozen=True)
class _Small(Image):
    """A few texels in place of an image, with `chains` of blocks by use."""

    chains: Mapping[tuple[bool, bool, str], Chain] = field(default_factory=dict)

    def chain(self, srgb: bool, mipmapped: bool, channels: str) -> Chain | None:
        """Return the blocks for a use, or None."""
        return self.chains.get((srgb, mipmapped, channels))


@contextmanager
def _building(subject: Subject) -> Iterator[list[float]]:
    """Yield a list of the seconds of each call that builds pipelines: texts, SPIR-V, reflection, driver."""
    pipelines = subject.module(f"pipelines.{subject.device.capabilities.backend}").Pipelines
    took: list[float] = []

    def timed(call: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **keywords: Any) -> Any:
            began = clock.perf_counter()
            try:
                return call(*arguments, **keywords)
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


def _frames(subject: Subject, renderer: Any, waits: bool) -> dict[str, Any]:
    """Draw until all textures have arrived, and some frames more; return counts and times of both.

    If `waits`, it waits for the GPU after each frame; the time of a frame is then the renderer's own thread, without
    drawing. Otherwise frames follow each other as in a window, and the GPU always has something to draw.
    """
    view = subject.view(renderer)
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
    """Read a document with pygltflib and decode its images with Pillow, on as many threads as loading."""
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
    return {"load_s": took, "total_s": took, "decoded_bytes": sum(pixels.nbytes for pixels in decoded)}


def _read(path: Path) -> dict[str, Any]:
    """Do the work of `_with_pillow` with this project's own reader, which makes a whole scene of it."""
    began = clock.perf_counter()
    scene = load_scene(path)
    took = clock.perf_counter() - began
    return {
        "load_s": took,
        "total_s": took,
        "decoded_bytes": sum(image.pixels.nbytes for image in scene.images),
    }


def _peak_bytes() -> int:
    """Return the peak memory of this process so far; 0 where the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def record(timeline: Mapping[str, Sequence[Interval]]) -> dict[str, Any]:
    """Return the figures of copies: their time on their own queue, how much of it beside drawing, and when."""
    copies, drawing = timeline.get("transfer", []), timeline.get("graphics", [])
    return {
        "queues": sorted(timeline),
        "copies": len(copies),
        "copies_ms": sum(end - begin for begin, end in merged(copies)),
        "beside_drawing_ms": common_ms(copies, drawing),
        "timeline": {
            queue: [[round(begin, 4), round(end, 4)] for begin, end in intervals[:KEPT]]
            for queue, intervals in timeline.items()
        },
    }
