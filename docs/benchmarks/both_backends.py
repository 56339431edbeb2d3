"""Chapter 1 on both backends of one machine: time per pass, time on the CPU, and how far the pictures differ.

    python docs/benchmarks/both_backends.py OUT.json [scene ...]     a scene is a name or a file

Time is the median over many frames after a warm-up, in one process per run of this file. Differences are those of
single-precision targets: depth in units of the last place, light relative to max(1, |light|), instance ids in pixels.
"""

from __future__ import annotations

import json
import platform
import statistics
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import chapters  # noqa: E402
from backends.gl.context import Context  # noqa: E402
from backends.vulkan.device import Device  # noqa: E402
from backends.vulkan.instance import Instance  # noqa: E402
from chapters import scenes  # noqa: E402
from common.scene import Scene  # noqa: E402
from tools.bench.bench import commit  # noqa: E402

SIZES = ((640, 360), (1920, 1080))
WARM_UP, FRAMES = 20, 100
IN_SOFTWARE = 5, 20
"""Warm-up and frames where the processor draws, at the first size alone: a frame takes far longer there."""
OUTPUTS = ("color", "color_linear", "depth", "instance_id")


def main(out: str, names: list[str]) -> None:
    """Measure every scene on both backends and write the record."""
    settings = chapters.settings_class(1)
    with Instance() as instance, Device(instance) as device, Context() as context:
        devices = {"vulkan": device, "gl": context}
        software = any(one.capabilities.is_software for one in devices.values())
        warm_up, count = IN_SOFTWARE if software else (WARM_UP, FRAMES)
        record: dict[str, Any] = {
            "chapter": 1,
            "commit": commit(),
            "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
            "devices": {
                name: f"{one.capabilities.device}, {one.capabilities.driver}" for name, one in devices.items()
            },
            "frames": count,
            "warm_up": warm_up,
            "scenes": [],
        }
        for name in names or ["atrium", "spheres", "cornell"]:
            scene = scenes.load(name)
            row: dict[str, Any] = {"scene": scene.name, "instances": len(scene.instances), "sizes": []}
            for size in SIZES[:1] if software else SIZES:
                measured = {b: measure(b, d, scene, size, warm_up, count) for b, d in devices.items()}
                row["sizes"].append({"size": size, **measured})
            row["differences"] = differences(devices, scene, settings(color_format="rgba32f"))
            record["scenes"].append(row)
            print(json.dumps(row))
    Path(out).write_text(json.dumps(record, indent=1) + "\n", "utf-8")


def measure(
    backend: str, device: Any, scene: Scene, size: tuple[int, int], warm_up: int, count: int
) -> dict[str, Any]:
    """Return medians of GPU milliseconds by pass and of the CPU's, and what a frame is made of."""
    with chapters.open(
        1, backend, scene=scene, size=size, device=device, outputs=(), presents=True
    ) as renderer:
        view = chapters.view_of(renderer)
        frames = []
        for index in range(warm_up + count):
            # Two are in flight, as in a window: a frame's figures are read when the next but one is due.
            frames.append(renderer.render(view, index / 60.0))
            if index >= 1:
                frames[index - 1].timings  # noqa: B018
        frames[-1].timings  # noqa: B018
        kept = frames[warm_up:]
        passes = {n: statistics.median(f.timings[n] for f in kept) for n in kept[0].timings}
        return {
            "gpu_ms": round(sum(passes.values()), 4),
            "passes_ms": {name: round(value, 4) for name, value in passes.items()},
            "cpu_ms": round(statistics.median(f.cpu_ms for f in kept), 4),
            "work": kept[-1].work,
        }


def differences(devices: dict[str, Any], scene: Scene, settings: Any) -> dict[str, Any]:
    """Return how far the two pictures of one frame are from each other."""
    frames = {}
    for backend, device in devices.items():
        with chapters.open(
            1, backend, scene=scene, size=SIZES[0], settings=settings, device=device, outputs=OUTPUTS
        ) as renderer:
            frame = renderer.render(chapters.view_of(renderer), 0.0)
            frames[backend] = {name: frame.image(name) for name in OUTPUTS}
    a, b = frames["vulkan"], frames["gl"]
    inside = a["instance_id"] == b["instance_id"]
    light = np.abs(a["color_linear"].astype(np.float64) - b["color_linear"])
    light /= np.maximum(1.0, np.abs(a["color_linear"]))
    worst = light.max(axis=-1)[inside]
    steps = np.abs(a["depth"].view(np.int32).astype(np.int64) - b["depth"].view(np.int32))[inside]
    codes = np.abs(a["color"].astype(int) - b["color"]).max(axis=-1)
    return {
        "pixels": int(inside.size),
        "ids_that_differ": int((~inside).sum()),
        "depth_bits_that_differ": int((steps > 0).sum()),
        "depth_worst_ulps": int(steps.max()),
        "light_worst": float(worst.max()),
        "light_99_9_percent": float(np.quantile(worst, 0.999)),
        "codes_above_1": int((codes > 1).sum()),
    }


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
