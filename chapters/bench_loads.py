"""What loading a scene takes: from its file, from its cache, and for the frames that are drawn meanwhile.

`python -m chapters.bench_loads WHICH BACKEND SCENE WxH WAY` is one load, measured; a bench runs several, each in a
process of its own, with what the system keeps of files and what was compiled before warm. The ways:

    plain      decoded from the file; nothing is kept
    write      the same, and the cache is written
    cached     from that cache: mapped, nothing is decoded
    compress   decoded, compressed in blocks, written
    blocks     from that cache
    stream     frames are drawn while textures arrive from the file

A load ends with the last byte on the device. Its time is that of opening the scene and uploading it, without what is
the same for every scene: starting Python, opening a device, building pipelines (which are built for each, and measured
apart). Memory is what the process grew by at its peak, over a process that has opened the device.

Beside them, `pillow` is what a program takes that reads the document with pygltflib and decodes the images with Pillow
on as many threads, and uploads nothing.
"""

from __future__ import annotations

import io
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import chapters
from chapters import bench_points, scenes
from chapters.bench_points import Effort
from chapters.run import open_device
from chapters.tables import table
from common.errors import DeviceError, UserError
from common.paths import ROOT, asset_dir
from common.settings import preset

WAYS = {
    "plain": "from the file",
    "write": "and writing the cache",
    "cached": "from the cache",
    "compress": "and compressing it",
    "blocks": "from the cache of blocks",
    "stream": "while frames are drawn",
    "pillow": "pygltflib and Pillow, no upload",
}

ONCE = ("write", "compress")
"""Ways that are no second time the same: there is a cache after them."""

OUTPUTS = frozenset({"color", "color_linear"})

AFTER = 20
"""Frames that are drawn when everything has arrived: what the longest frame before is compared with."""

MOST_FRAMES = 100_000


def find(name: str) -> Path | None:
    """Return the file of a scene of our own, or of a model among the tests' assets; None where it is not here."""
    models = asset_dir()
    model = None if models is None else models / "models" / name / f"{name}.gltf"
    if model is not None and model.is_file():
        return model
    try:
        return scenes.find(name)
    except UserError:
        return None


def measure(
    which: chapters.Whole,
    backend: str,
    size: tuple[int, int],
    effort: Effort,
    step: Callable[[str, float], None],
    names: Sequence[str] | None = None,
) -> list[dict[str, Any]]:
    """Return a record for each scene of `names`, by default those of `Settings.LOADS`; [] where there are none."""
    wanted = getattr(chapters.settings_class(which), "LOADS", ()) if names is None else names
    found = []
    for number, name in enumerate(wanted):
        path = find(name)
        if path is None:
            found.append({"scene": name, "ways": {}})
            continue

        def within(what: str, part: float, number: int = number, name: str = name) -> None:
            step(f"{name}, {what}", (number + part) / len(wanted))

        found.append(_measure(which, backend, name, path, size, effort, within))
    return found


def _measure(
    which: chapters.Whole,
    backend: str,
    name: str,
    path: Path,
    size: tuple[int, int],
    effort: Effort,
    step: Callable[[str, float], None],
) -> dict[str, Any]:
    turns = max(effort.starts, 3)
    runs: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory(prefix="strata-bench-") as folder:
        pictures = {way: Path(folder) / f"{way}.npz" for way in ("plain", "cached", "blocks")}
        environment = {**os.environ, "STRATA_CACHE": str(Path(folder) / "strata")}

        def run(way: str, picture: Path | None = None) -> dict[str, Any]:
            words = [str(which if isinstance(which, int) else which.path), backend, str(path)]
            words += [f"{size[0]}x{size[1]}", way, *([str(picture)] if picture else [])]
            done = subprocess.run(
                [sys.executable, "-m", "chapters.bench_loads", *words],
                env=environment,
                cwd=ROOT,
                capture_output=True,
                text=True,
            )
            if done.returncode:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                raise DeviceError(f"Loading {name} in a process of its own failed: {last}")
            made: dict[str, Any] = json.loads(done.stdout)
            return made

        step("shaders", 0.0)
        run("plain", pictures["plain"])  # what is compiled here, later starts find
        for number, way in enumerate(WAYS):
            step(WAYS[way], (number + 1) / (len(WAYS) + 1))
            runs[way] = [run(way) for _ in range(1 if way in ONCE else turns)]
        for way in ("cached", "blocks"):
            run(way, pictures[way])
        shown = {way: _read(path) for way, path in pictures.items()}
        errors = {
            way: {
                **bench_points.errors(shown[way], shown["plain"]),
                **bench_points.difference(shown[way][0], shown["plain"][0]),
            }
            for way in ("cached", "blocks")
        }
    return {
        "scene": name,
        "textures": runs["plain"][0]["textures"],
        "decoded_bytes": runs["plain"][0]["decoded_bytes"],
        "bytes": runs["plain"][0]["bytes"],
        "turns": turns,
        "ways": {way: _middle(found) for way, found in runs.items()},
        "times_faster": {
            way: _median(runs["plain"], "load_s") / _median(runs[way], "load_s")
            for way in ("cached", "blocks")
        },
        "errors": errors,
    }


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture's linear light and what is shown of it."""
    with np.load(path) as held:
        return held["color_linear"], held["color"]


def _median(found: list[dict[str, Any]], name: str) -> float:
    return statistics.median(float(one[name]) for one in found)


def _middle(found: list[dict[str, Any]]) -> dict[str, float]:
    """Return the median of every figure."""
    numbers = {name for name, value in found[0].items() if isinstance(value, int | float)}
    return {name: _median(found, name) for name in sorted(numbers)}


# --- in the process of its own ----------------------------------------------------------------------------------------


def once(
    which: chapters.Whole,
    backend: str,
    path: Path,
    size: tuple[int, int],
    way: str,
    picture: Path | None = None,
) -> dict[str, Any]:
    """Load a scene in one of the WAYS; return seconds and bytes. `picture` is an .npz that gets what is seen."""
    if way == "pillow":
        return _with_pillow(path)
    from chapters.opening import open_scene

    settings: Any = preset(chapters.settings_class(which), "medium")
    settings = replace(settings, loading="stream" if way == "stream" else "wait")
    kept = way not in ("plain", "stream")
    with ExitStack() as stack:
        device = open_device(stack, backend)
        before = _peak_bytes()
        began = clock.perf_counter()
        opening = stack.enter_context(
            open_scene(which, str(path), cached=kept, compressed=way in ("compress", "blocks"))
        )
        opened = clock.perf_counter()
        renderer: Any = stack.enter_context(
            chapters.open(
                which,
                backend,
                scene=opening.scene,
                size=size,
                settings=settings,
                outputs=OUTPUTS,
                device=device,
            )
        )
        made = clock.perf_counter()
        frames = _frames(renderer) if way == "stream" else {}
        if way in ONCE:
            opening.finish()
        done = clock.perf_counter()
        grown = _peak_bytes() - before
        if picture is not None:
            frame = renderer.render(chapters.view_of(renderer))
            np.savez(picture, **{name: frame.image(name) for name in OUTPUTS})
        pipelines = _again(which, backend, opening.scene, size, settings, device) if way != "stream" else 0.0
        scene = opening.scene
        decoded = sum(image.width * image.height * 4 * image.dtype.itemsize for image in scene.images)
        arrays = (scene.positions, scene.normals, scene.tangents, scene.uv0, scene.indices)
        return {
            "scene_s": opened - began,
            "open_s": made - opened,
            "total_s": done - began,
            "load_s": max(done - began - pipelines, 1e-6),
            "pipelines_s": pipelines,
            "peak_bytes": grown,
            "textures": len(scene.images),
            "decoded_bytes": decoded,
            "bytes": decoded + sum(array.nbytes for array in arrays),
            **frames,
        }


def _again(
    which: chapters.Whole, backend: str, scene: Any, size: tuple[int, int], settings: Any, device: Any
) -> float:
    """Return the seconds that opening takes of all that is no load: textures of one texel, the same pipelines."""
    from common.scene import Image

    pixel = np.full((1, 1, 4), 255, np.uint8)
    small = replace(scene, images=[Image(image.name, pixel) for image in scene.images])
    took = []
    for _ in range(2):
        began = clock.perf_counter()
        with chapters.open(
            which,
            backend,
            scene=small,
            size=size,
            settings=settings,
            outputs=OUTPUTS,
            device=device,
        ):
            took.append(clock.perf_counter() - began)
    return min(took)


def _frames(renderer: Any) -> dict[str, Any]:
    """Draw until all textures have arrived, and some frames more; return how many that took, and the longest.

    The GPU is waited for behind each frame: what a frame takes is then the renderer's own thread, without drawing.
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


def _peak_bytes() -> int:
    """Return the most memory that this process had so far; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


# --- what came out ----------------------------------------------------------------------------------------------------


def show(made: list[dict[str, Any]], to: Console) -> None:
    """Print a table for each scene."""
    for one in made:
        if not one["ways"]:
            to.print(
                f"Loading {one['scene']}: not measured, since the scene is not on this machine.",
                soft_wrap=True,
            )
            continue
        shown = table(
            f"Loading {one['scene']}: {one['textures']} textures, {one['bytes'] / 1e6:.0f} MB",
            "way",
            ">s",
            ">of it, scene",
            ">pipelines apart",
            ">peak / scene",
        )
        for way, found in one["ways"].items():
            if way == "stream":
                continue
            peak = found.get("peak_bytes", 0) / one["bytes"]
            shown.add_row(
                WAYS[way],
                f"{found['load_s']:.3f}",
                f"{found['scene_s']:.3f}" if "scene_s" in found else "",
                f"{found['pipelines_s']:.3f}" if "pipelines_s" in found else "",
                f"{peak:.2f}" if peak else "",
            )
        to.print(shown)
        for line in sentences(one):
            to.print(line, soft_wrap=True)


def sentences(one: dict[str, Any]) -> list[str]:
    """Return what the figures of a scene say."""
    faster, errors = one["times_faster"], one["errors"]
    said = [
        f"From the cache it is there {faster['cached']:.1f} times as fast, "
        f"from that of blocks {faster['blocks']:.1f} times."
    ]
    if errors["cached"]["pixels_differ"]:
        said.append(f"Its picture differs by up to {errors['cached']['max_abs']:.2g}.")
    else:
        said.append("Its picture is the same to the bit.")
    blocks = errors["blocks"]
    flip = "" if blocks["flip"] is None else f", FLIP {blocks['flip']:.4f}"
    said.append(f"With blocks the picture's relative MSE is {blocks['relative_mse']:.2g}{flip}.")
    stream = one["ways"]["stream"]
    said.append(
        f"Streamed, the first frame is there after {stream['first_frame_s']:.2f} s and the last texture after "
        f"{stream['complete_s']:.2f} s and {stream['frames']:.0f} frames; the renderer's own time in the longest of "
        f"them was {stream['longest_ms']:.1f} ms, {stream['after_ms']:.1f} ms afterwards."
    )
    return said


def plot(axes: Any, made: list[dict[str, Any]]) -> None:
    """Draw the seconds of each way as bars, scene beside scene."""
    drawn = [one for one in made if one["ways"]]
    ways = [way for way in WAYS if way != "stream"]
    width = 0.8 / len(ways)
    for number, way in enumerate(ways):
        places = [place + (number - (len(ways) - 1) / 2) * width for place in range(len(drawn))]
        axes.bar(places, [one["ways"][way]["load_s"] for one in drawn], width, label=WAYS[way])
    axes.set_xticks(range(len(drawn)), [one["scene"] for one in drawn])
    axes.set_yscale("log")
    axes.set_ylabel("s to the last byte on the device")
    axes.set_title("Loading", fontsize=10)
    axes.legend(fontsize=7)


def main() -> None:
    """Measure this process."""
    chapter, backend, path, size, way, *picture = sys.argv[1:]
    width, _, height = size.partition("x")
    which = chapters.parse_chapter(chapter)
    made = once(which, backend, Path(path), (int(width), int(height)), way, *map(Path, picture))
    print(json.dumps(made))


if __name__ == "__main__":
    main()
