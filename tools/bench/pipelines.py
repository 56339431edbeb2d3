"""What building pipelines takes: cold, from a cache in memory, and from one on disk.

`python -m tools.bench.pipelines N WxH` is one start, measured; a bench runs several.

Times are those of the driver's own calls (vkCreateGraphicsPipelines, vkCreateComputePipelines), without compiling GLSL
and without reading it. Each state is a process of its own, since drivers remember within one, and drivers' own caches
on disk are off and empty: else the first run would be the only cold one there ever is.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import chapters
from backends import verdicts
from backends.vulkan import api as vk
from common.errors import DeviceError
from common.paths import ROOT
from common.reports.benches import Effort, difference
from common.reports.tables import table
from tools.run.run import open_device

STATES = ("cold", "memory", "disk")
"""An empty cache; the same pipelines once more from the cache that holds them now; a new process with the file."""

SAID = {
    "cold": "cold",
    "memory": "warm, cache in memory",
    "disk": "warm, cache from disk",
}

LEAST_STARTS = 3
"""Of each state, also in a quick look: a start takes about a second, and one alone says nothing."""

HEADER_BYTES = 32
"""Of a cache that holds nothing (VkPipelineCacheHeaderVersionOne)."""


def measure(
    which: chapters.Whole, size: tuple[int, int], effort: Effort, step: Callable[[str, float], None]
) -> dict[str, Any] | None:
    """Return the record of building the pipelines of `Settings.PIPELINES`; None where a chapter names no such scene."""
    if not hasattr(chapters.settings_class(which), "PIPELINES"):
        return None
    starts = max(effort.starts, LEAST_STARTS)
    times: dict[str, list[float]] = {state: [] for state in STATES}
    with tempfile.TemporaryDirectory(prefix="strata-bench-") as text:
        folder = Path(text)
        step("shaders", 0.0)
        _start(which, size, folder)  # compiles them, and later starts find them
        pictures = []
        for turn in range(starts):
            shutil.rmtree(folder / "strata" / "pipelines", ignore_errors=True)
            step("cold", (turn + 0.1) / starts)
            cold = _start(which, size, folder)
            step("warm", (turn + 0.5) / starts)
            warm = _start(which, size, folder)
            for state, took in (("cold", cold["first"]), ("memory", cold["again"]), ("disk", warm["first"])):
                times[state].append(took)
        for state in (
            "cold",
            "warm",
        ):  # apart: where drivers compile as late as they can, a picture takes seconds
            step(f"picture, {state}", 0.9)
            if state == "cold":
                shutil.rmtree(folder / "strata" / "pipelines", ignore_errors=True)
            _start(which, size, folder, folder / f"{state}.npy")
            pictures.append(np.load(folder / f"{state}.npy"))
    states = {}
    for state, found in times.items():
        low, high = np.percentile(found, (25, 75))
        states[state] = {
            "ms": statistics.median(found),
            "noise_ms": float(high - low) / 2,
            "least_ms": min(found),
            "times_faster": statistics.median(times["cold"]) / statistics.median(found),
        }
    return {
        "pipelines": cold["pipelines"],
        "cache_bytes": cold["cache_bytes"],
        "loaded_bytes": warm["loaded_bytes"],
        "starts": starts,
        "driver_caches": "off, and in an empty folder",
        "states": states,
        "error": difference(*pictures),
    }


def _start(
    which: chapters.Whole, size: tuple[int, int], folder: Path, picture: Path | None = None
) -> dict[str, Any]:
    """Return what `once` says in a process of its own, whose caches lie in `folder`; the drivers' are empty."""
    driver = folder / "driver"
    shutil.rmtree(driver, ignore_errors=True)
    driver.mkdir()
    environment = {
        **os.environ,
        **verdicts.variables(),
        "STRATA_CACHE": str(folder / "strata"),
        "MESA_SHADER_CACHE_DISABLE": "true",
        "MESA_SHADER_CACHE_DIR": str(driver),
        "__GL_SHADER_DISK_CACHE": "0",  # NVIDIA's, for Vulkan too
        "__GL_SHADER_DISK_CACHE_PATH": str(driver),
    }
    words = [str(which if isinstance(which, int) else which.path), f"{size[0]}x{size[1]}"]
    words += [str(picture)] if picture else []
    run = subprocess.run(
        [sys.executable, "-m", "tools.bench.pipelines", *words],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if run.returncode:
        last = (run.stderr.strip().splitlines() or ["no message"])[-1]
        raise DeviceError(f"Building the pipelines of {which} in a process of its own failed: {last}")
    found: dict[str, Any] = json.loads(run.stdout)
    return found


# --- in the process of its own ----------------------------------------------------------------------------------------


def once(which: chapters.Whole, size: tuple[int, int], picture: Path | None = None) -> dict[str, Any]:
    """Open a chapter; return the ms that its pipelines take in the driver, "first" and "again", and the cache's bytes.

    "again" builds each pipeline a second time as soon as it is there: from the same cache, which holds it now. A frame
    is drawn only if a `picture` is wanted: its linear light (H, W, 3), written as .npy.
    """
    found: dict[str, Any] = {"first": 0.0, "again": 0.0, "pipelines": 0, "cache_bytes": 0, "loaded_bytes": 0}
    settings = chapters.settings_class(which)
    with ExitStack() as stack:
        device = open_device(stack, "vulkan")
        _watch(device, found)
        renderer = stack.enter_context(
            chapters.open(
                which,
                "vulkan",
                scene=settings.PIPELINES(),  # type: ignore[attr-defined]
                size=size,
                outputs={"color_linear"},
                device=device,
            )
        )
        if picture is not None:
            np.save(picture, renderer.render(chapters.view_of(renderer)).image("color_linear"))
    return found


def _watch(device: Any, found: dict[str, Any]) -> None:
    """Put watches in the place of the device's functions that build pipelines and read caches' files."""
    fn = device.fn

    def watched(call: Callable[..., int]) -> Callable[..., int]:
        def build(handle: Any, cache: Any, count: int, infos: Any, callbacks: Any, out: Any) -> int:
            code, took = _timed(call, handle, cache, count, infos, callbacks, out)
            spare = vk.ffi.new(f"VkPipeline[{count}]")
            repeated, again = _timed(call, handle, cache, count, infos, callbacks, spare)
            for one in spare if repeated == vk.VK_SUCCESS else ():
                fn.vkDestroyPipeline(handle, one, vk.NULL)
            found["first"] += took
            found["again"] += again
            found["pipelines"] += count
            size = vk.ffi.new("size_t *")
            if cache != vk.NULL and fn.vkGetPipelineCacheData(handle, cache, size, vk.NULL) == vk.VK_SUCCESS:
                found["cache_bytes"] = int(size[0])
            return code

        return build

    for name in ("vkCreateGraphicsPipelines", "vkCreateComputePipelines"):
        setattr(fn, name, watched(getattr(fn, name)))
    create = fn.vkCreatePipelineCache

    def create_cache(handle: Any, info: Any, callbacks: Any, out: Any) -> int:
        found["loaded_bytes"] = int(info.initialDataSize)
        code: int = create(handle, info, callbacks, out)
        return code

    fn.vkCreatePipelineCache = create_cache


def _timed(call: Callable[..., int], *arguments: Any) -> tuple[int, float]:
    """Return a call's result and the ms it took."""
    began = clock.perf_counter()
    code = call(*arguments)
    return code, (clock.perf_counter() - began) * 1e3


# --- what came out ----------------------------------------------------------------------------------------------------


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and what it says."""
    shown = table(
        f"Building {made['pipelines']} pipelines (median of {made['starts']} starts)",
        "state",
        ">ms",
        ">±",
        ">times faster",
    )
    for state in STATES:
        found = made["states"][state]
        shown.add_row(
            SAID[state],
            f"{found['ms']:.2f}",
            f"{found['noise_ms']:.2f}",
            f"{found['times_faster']:.2f}",
        )
    to.print(shown)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what the figures say, as sentences."""
    if made["cache_bytes"] <= HEADER_BYTES:
        said = [
            f"This driver keeps nothing in a pipeline cache: its {made['cache_bytes']} bytes are the header alone, and "
            "what differs between the states is noise."
        ]
    else:
        said = [
            f"The cache holds {made['cache_bytes']:,} bytes; pipelines from disk are built "
            f"{made['states']['disk']['times_faster']:.1f} times faster than cold ones."
        ]
    error = made["error"]
    same = "Cold or warm, the picture is the same to the bit."
    return [*said, f"Pictures differ by up to {error['max_abs']:.2g}." if error["pixels_differ"] else same]


def plot(axes: Any, made: dict[str, Any]) -> None:
    """Draw the times as bars."""
    found = [made["states"][state] for state in STATES]
    names = [SAID[state].replace(", ", ",\n") for state in STATES]
    bars = axes.bar(names, [one["ms"] for one in found], yerr=[one["noise_ms"] for one in found], capsize=3)
    axes.bar_label(bars, [f"{one['times_faster']:.1f}x" for one in found], padding=3)
    axes.margins(y=0.15)
    axes.set_ylabel("ms in the driver")
    axes.set_title(f"Building {made['pipelines']} pipelines", fontsize=10)


def main() -> None:
    """Measure this process."""
    chapter, size, *picture = sys.argv[1:]
    width, _, height = size.partition("x")
    which = chapters.parse_chapter(chapter)
    print(json.dumps(once(which, (int(width), int(height)), *map(Path, picture))))


if __name__ == "__main__":
    main()
