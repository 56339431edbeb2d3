"""What loading a scene takes: from its file, from its cache, and for the frames that are drawn meanwhile.

Each load is a process of its own (`load.py`), with what the system keeps of files and what was
compiled before warm. The ways:

    plain      decoded from the file; nothing is kept
    write      the same, and the cache is written
    cached     from that cache: mapped, nothing is decoded
    compress   decoded, compressed in blocks, written
    blocks     from that cache
    least      the same, with textures of a few texels in the place of its own: what no cache spares
    stream     frames are drawn while textures arrive from the file
    overlap    the same, with a stamp on the GPU before and after every submission (Vulkan)

A load ends with the last byte on the device. Its time is that of opening the scene and uploading it, with everything
that takes but starting Python, opening a device, and what is no scene's own: pipelines are built during each load, and
their time is taken in that load and shown apart, as is that of a renderer without a scene (`load.py`).
Memory is what the process grew by at its peak, over a process that has opened the device and the same scene with tiny
textures.

Beside them, `pillow` is what a program takes that reads the document with pygltflib and decodes the images with Pillow
on as many threads, and uploads nothing; `read` is that work done by our own reader, which also makes geometry, and
decodes no picture that nothing drawn has.
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
    """Return a record for each scene of `names`; `find` gives a scene's file, or None where it is not here."""
    found = []
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
                found.append({"scene": name, "ways": {}})
            else:
                found.append(_measure(name, partial(run, path), effort, within))
    return found


def _measure(name: str, run: Run, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any]:
    turns = max(effort.starts, 3)
    runs: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory(prefix="strata-bench-") as folder:
        pictures = {way: Path(folder) / f"{way}.npz" for way in ("plain", "cached", "blocks")}
        cache = Path(folder) / "strata"
        step("shaders", 0.0)
        run("plain", cache, pictures["plain"])  # what is compiled here, later starts find
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
        "ways": {way: _middle(found) for way, found in runs.items()},
        "times_faster": {
            way: _median(runs["plain"], "load_s") / _median(runs[way], "load_s")
            for way in ("cached", "blocks", "least")
        },
        "errors": apart,
        "overlap": overlap,
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
            ">renderer apart",
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
                f"{found['renderer_s']:.3f}" if "renderer_s" in found else "",
                f"{peak:.2f}" if peak else "",
            )
        to.print(shown)
        for line in sentences(one):
            to.print(line, soft_wrap=True)


def sentences(one: dict[str, Any]) -> list[str]:
    """Return what the figures of a scene say."""
    faster, apart = one["times_faster"], one["errors"]
    said = [
        f"From the cache it is there {faster['cached']:.1f} times as fast, "
        f"from that of blocks {faster['blocks']:.1f} times. Without its texels it is there {faster['least']:.1f} times "
        "as fast: about the most that a cache of textures can bring.",
    ]
    if apart["cached"]["pixels_differ"]:
        said.append(f"Its picture differs by up to {apart['cached']['max_abs']:.2g}.")
    else:
        said.append("Its picture is the same to the bit.")
    blocks = apart["blocks"]
    flip = "" if blocks["flip"] is None else f", FLIP {blocks['flip']:.4f}"
    said.append(f"With blocks the picture's relative MSE is {blocks['relative_mse']:.2g}{flip}.")
    stream = one["ways"]["stream"]
    said.append(
        f"Streamed, the first frame is there after {stream['first_frame_s']:.2f} s and the last texture after "
        f"{stream['complete_s']:.2f} s and {stream['frames']:.0f} frames; the renderer's own time in the longest of "
        f"them was {stream['longest_ms']:.1f} ms, {stream['after_ms']:.1f} ms afterwards."
    )
    overlap = one["overlap"]
    if overlap and "transfer" in overlap["queues"]:
        said.append(
            f"Copies took {overlap['copies_ms']:.1f} ms on a queue of their own, {overlap['beside_drawing_ms']:.1f} ms "
            "of that while the other queue drew."
        )
    elif overlap:
        said.append("Copies and drawing share the device's one queue: nothing overlaps on the GPU.")
    return said


def plot(axes: Any, made: list[dict[str, Any]]) -> None:
    """Draw the seconds of each way as bars, scene beside scene."""
    drawn = [one for one in made if one["ways"]]
    ways = [way for way in WAYS if way != "stream" and all(way in one["ways"] for one in drawn)]
    width = 0.8 / len(ways)
    for number, way in enumerate(ways):
        places = [place + (number - (len(ways) - 1) / 2) * width for place in range(len(drawn))]
        axes.bar(places, [one["ways"][way]["load_s"] for one in drawn], width, label=WAYS[way])
    axes.set_xticks(range(len(drawn)), [one["scene"] for one in drawn])
    axes.set_yscale("log")
    axes.set_ylabel("s to the last byte on the device")
    axes.set_title("Loading", fontsize=10)
    axes.legend(fontsize=7)
