"""One start of a chapter, timed step by step: `python -m tools.bench.start N SCENE WxH BEGAN` prints JSON.

`bench` runs it twice in new processes with caches of their own, empty and then filled. BEGAN is the time (seconds since
the epoch) at which the process was asked for, so that starting Python counts too.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import chapters
from backends.selftest import verdicts
from common.errors import DeviceError
from common.paths import ROOT

_ENTERED = time.time()
"""By now Python runs; whatever is large is imported later, in the step "import"."""


def steps(
    chapter: chapters.Whole, backend: str, scene: str, size: tuple[int, int], began: float
) -> dict[str, float]:
    """Go from nothing to a picture on the CPU; return the seconds of each step and "total"."""
    from backends.vulkan.shaders import compiler
    from chapters import scenes
    from common.settings import preset

    times = {"python": _ENTERED - began}
    last = _ENTERED

    def step(name: str) -> None:
        nonlocal last
        now = time.time()
        times[name], last = now - last, now

    import_module(f"{chapters.package_of(chapter)}.renderer")
    settings: Any = preset(chapters.settings_class(chapter), "medium")
    step("import")
    loaded = scenes.load(scene)
    step("load")
    with chapters.open(chapter, backend, scene=loaded, size=size, settings=settings) as renderer:
        step("create")
        renderer.render(chapters.view_of(renderer)).image("color")
        step("first frame")
    times["total"] = sum(times.values())
    times["shaders_compiled"] = compiler.shared().counters.compiled
    return {name: round(value, 4) for name, value in times.items()}


def cold_and_warm(
    chapter: chapters.Whole, backend: str, scene: str, size: tuple[int, int], repetitions: int = 1
) -> dict[str, dict[str, float]]:
    """Return the steps of the fastest start with empty caches and of the fastest with full ones, in seconds.

    The caches of Strata and of Mesa are empty; what the system keeps of files in memory is not touched.
    """
    found: dict[str, list[dict[str, float]]] = {"cold": [], "warm": []}
    for _ in range(repetitions):
        with tempfile.TemporaryDirectory(prefix="strata-bench-") as folder:
            environment = {
                **os.environ,
                **verdicts.variables(),
                "STRATA_CACHE": str(Path(folder) / "strata"),
                "MESA_SHADER_CACHE_DIR": str(Path(folder) / "driver"),
            }
            for state in ("cold", "warm"):
                which = str(chapter if isinstance(chapter, int) else chapter.path)
                words = [which, backend, scene, f"{size[0]}x{size[1]}", repr(time.time())]
                run = subprocess.run(
                    [sys.executable, "-m", "tools.bench.start", *words],
                    env=environment,
                    cwd=ROOT,
                    capture_output=True,
                    text=True,
                )
                if run.returncode:
                    last = (run.stderr.strip().splitlines() or ["no message"])[-1]
                    raise DeviceError(f"A start of {chapter} in a process of its own failed: {last}")
                found[state].append(json.loads(run.stdout))
    return {state: min(times, key=lambda one: one["total"]) for state, times in found.items()}


def main() -> None:
    """Time this process's start."""
    chapter, backend, scene, size, began = sys.argv[1:]
    width, _, height = size.partition("x")
    which = chapters.parse_chapter(chapter)
    print(json.dumps(steps(which, backend, scene, (int(width), int(height)), float(began))))


if __name__ == "__main__":
    main()
