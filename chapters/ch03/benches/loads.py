"""The time of loading a scene: from its file, from its cache, and while frames are drawn.

Each load is a process of its own (`load.py`); the system's copies of files and the compiled shaders are warm. The ways:

    plain      decoded from the file; nothing is kept
    write      the same, and the cache is written
    cached     from that cache: mapped, nothing is decoded
    compress   decoded, compressed in blocks, written
    blocks     from that cache
    least      the same, with textures of a few texels in place of its own: the part that no cache saves
    stream     frames are drawn while textures arrive from the file
    overlap    the same, with a stamp on the GPU before and after every submission (Vulkan)

A load ends with the last byte on the device. Its time contains opening the scene and uploading it. It does not contain
starting Python, opening a device, or work that belongs to no scene. Pipelines are built during each load; their time is
subtracted and shown apart, as is that of a renderer without a scene (`load.py`). Memory is the growth of the process at
its peak, over a process that has opened the device and the same scene with tiny textures.

For comparison, `pillow` reads the document with pygltflib, decodes the images with Pillow on as many threads, and
uploads nothing. `read` is the same work by our own reader, which also makes geometry. It decodes only images of
materials that are drawn.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, difference, errors
from common.reports.tables import table

from . import scene
from .load import ONCE

WAYS = {
    "plain": "from the file",
    "write": "and writing the cache",
    "cached": "from the cache",
    "compress": "and compressing it",
    "blocks": "from the cache of blocks",
    "least": "the same without texels",
    "stream": "while frames are drawn",
    "read": "read and decoded, no upload",
    "pillow": "the same, pygltflib and Pillow",
}


GENERATED = "generated"
"""The scene of `scene.py`, 0.5 GB of textures, which is written for the bench and removed after it."""


Run = Callable[..., dict[str, Any]]
"""Measures one load in a process of its own: `run(scene, way, cache, picture)`, where the cache is a folder."""


def measure(
    names: Sequence[str],
    find: Callable[[str], Path | None],
    run: Run,
    effort: Effort,
    step: Callable[[str, float], None],
) -> list[dict[str, Any]]:
    """Return a record for each scene of `names`; `find` returns a scene's file, or None if it is missing."""
    records = []
    for number, name in enumerate(names):

        def within(what: str, part: float, number: int = number, name: str = name) -> None:
            step(f"{name}, {what}", (number + part) / len(names))

        with ExitStack() as stack:
            if name == GENERATED:
                within("writing it", 0.0)
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="strata-bench-"))
                path: Path | None = scene.write(Path(folder))
            else:
                path = find(name)
            if path is None:
                records.append({"scene": name, "ways": {}})
            else:
                records.append(_measure(name, partial(run, path), effort, within))
    return records


def _measure(name: str, run: Run, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any]:
    turns = max(effort.starts, 3)
    runs: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory(prefix="strata-bench-") as folder:
        pictures = {way: Path(folder) / f"{way}.npz" for way in ("plain", "cached", "blocks")}
        cache = Path(folder) / "strata"
        step("shaders", 0.0)
        run("plain", cache, pictures["plain"])  # compiles the shaders for later starts
        for number, way in enumerate(WAYS):
            step(WAYS[way], (number + 1) / (len(WAYS) + 1))
            runs[way] = [run(way, cache) for _ in range(1 if way in ONCE else turns)]
        for way in ("cached", "blocks"):
            run(way, cache, pictures[way])
        overlap = run("overlap", cache)["overlap"]
        shown = {way: _read(path) for way, path in pictures.items()}
        apart = {
            way: {**errors(shown[way], shown["plain"]), **difference(shown[way][0], shown["plain"][0])}
            for way in ("cached", "blocks")
        }
    return {
        "scene": name,
        "textures": runs["plain"][0]["textures"],
        "decoded_bytes": runs["plain"][0]["decoded_bytes"],
        "bytes": runs["plain"][0]["bytes"],
        "turns": turns,
        "ways": {way: _middle(figures) for way, figures in runs.items()},
        "times_faster": {
            way: _median(runs["plain"], "load_s") / _median(runs[way], "load_s")
            for way in ("cached", "blocks", "least")
        },
        "errors": apart,
        "overlap": overlap,
    }


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear light of a picture, and the shown picture."""
    with np.load(path) as arrays:
        return arrays["color_linear"], arrays["color"]


def _median(figures: list[dict[str, Any]], name: str) -> float:
    return statistics.median(float(turn[name]) for turn in figures)


def _middle(figures: list[dict[str, Any]]) -> dict[str, float]:
    """Return the median of every figure."""
    numbers = {name for name, value in figures[0].items() if isinstance(value, int | float)}
    return {name: _median(figures, name) for name in sorted(numbers)}


# --- results ----------------------------------------------------------------------------------------------------------


def show(records: list[dict[str, Any]], to: Console) -> None:
    """Print a table for each scene."""
    for record in records:
        if not record["ways"]:
            to.print(
                f"Loading {record['scene']}: not measured, since the scene is not on this machine.",
                soft_wrap=True,
            )
            continue
        shown = table(
            f"Loading {record['scene']}: {record['textures']} textures, {record['bytes'] / 1e6:.0f} MB",
            "way",
            ">s",
            ">of it, scene",
            ">pipelines apart",
            ">renderer apart",
            ">peak / scene",
        )
        for way, figures in record["ways"].items():
            if way == "stream":
                continue
            peak = figures.get("peak_bytes", 0) / record["bytes"]
            shown.add_row(
                WAYS[way],
                f"{figures['load_s']:.3f}",
                f"{figures['scene_s']:.3f}" if "scene_s" in figures else "",
                f"{figures['pipelines_s']:.3f}" if "pipelines_s" in figures else "",
                f"{figures['renderer_s']:.3f}" if "renderer_s" in figures else "",
                f"{peak:.2f}" if peak else "",
            )
        to.print(shown)
        for line in sentences(record):
            to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results of a scene as sentences."""
    faster, apart = record["times_faster"], record["errors"]
    lines = [
        f"From the cache it is there {faster['cached']:.1f} times as fast, "
        f"from that of blocks {faster['blocks']:.1f} times. Without its texels it is there {faster['least']:.1f} times "
        "as fast: about the most that a cache of textures can bring.",
    ]
    if apart["cached"]["pixels_differ"]:
        lines.append(f"Its picture differs by up to {apart['cached']['max_abs']:.2g}.")
    else:
        lines.append("Its picture is the same to the bit.")
    blocks = apart["blocks"]
    flip = "" if blocks["flip"] is None else f", FLIP {blocks['flip']:.4f}"
    lines.append(f"With blocks the picture's relative MSE is {blocks['relative_mse']:.2g}{flip}.")
    stream = record["ways"]["stream"]
    lines.append(
        f"Streamed, the first frame is there after {stream['first_frame_s']:.2f} s and the last texture after "
        f"{stream['complete_s']:.2f} s and {stream['frames']:.0f} frames; the renderer's own time in the longest of "
        f"them was {stream['longest_ms']:.1f} ms, {stream['after_ms']:.1f} ms afterwards."
    )
    overlap = record["overlap"]
    if overlap and "transfer" in overlap["queues"]:
        lines.append(
            f"Copies took {overlap['copies_ms']:.1f} ms on a queue of their own, {overlap['beside_drawing_ms']:.1f} ms "
            "of that while the other queue drew."
        )
    elif overlap:
        lines.append("Copies and drawing share the device's one queue: nothing overlaps on the GPU.")
    return lines


def plot(axes: Any, records: list[dict[str, Any]]) -> None:
    """Draw the seconds of each way as bars, scene beside scene."""
    drawn = [record for record in records if record["ways"]]
    ways = [way for way in WAYS if way != "stream" and all(way in record["ways"] for record in drawn)]
    width = 0.8 / len(ways)
    for number, way in enumerate(ways):
        places = [place + (number - (len(ways) - 1) / 2) * width for place in range(len(drawn))]
        axes.bar(places, [record["ways"][way]["load_s"] for record in drawn], width, label=WAYS[way])
    axes.set_xticks(range(len(drawn)), [record["scene"] for record in drawn])
    axes.set_yscale("log")
    axes.set_ylabel("s to the last byte on the device")
    axes.set_title("Loading", fontsize=10)
    axes.legend(fontsize=7)
