"""Drawing the maps of 1 to 256 lights, with culling and without: `strata bench 8 --only casters`.

All lamps of the market move a little in each frame, so all of their maps are drawn in each. The lists of casters that
the GPU makes for each light and face are compared with drawing everything into all six faces of every light. Maps have
one size on both sides. A camera above the market sees all lamps; `shadow_lights` says how many of them have maps.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any

from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs
from common.view.camera import View

from .shadow_scenes import (
    FEW_FRAMES,
    KNOB,
    LAMPS,
    SHADED,
    is_software,
    move_lights,
    picture_size,
    scene_with,
    settings_of,
    view_at,
    with_loose_lights,
)

SCENE, CAMERA = "market:lights=256", "far"

COUNTS, QUICK_COUNTS = (1, 4, 16, 64, 256), (1, 4)
"""Lights with maps."""

SOFTWARE_MOST = 64
"""Lights for which a software driver draws everything: with 256 a frame takes half a minute."""

TEXELS, SOFTWARE_TEXELS = 256, 128
"""Along each face."""

STEP = 1e-4
"""How far lamps move, in length scales."""

SLOW_MS, SLOWEST_MS = 300.0, 5000.0
"""A frame that takes longer is measured FEW_FRAMES times, or once."""

EVERYTHING = {f"shadow_cull_{what}": False for what in ("instances", "meshlets", "cones", "faces")}
"""The settings that draw every caster into every face."""

WAYS: dict[str, dict[str, Any]] = {"lists": {}, "everything": EVERYTHING}


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return a row for each number of lights and each way; None for a chapter without shadow maps.

    `ms` is the time of the pass by timestamps. `frame_ms` is how much longer a frame takes that draws all maps than one
    that draws none, by the clock: timestamps of software drivers do not wait for dispatches. `light_ms` is the time of
    the passes that ask maps. `times` compares everything with lists, by the first where timestamps can be trusted.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    scene = with_loose_lights(scene_with(subject.load(SCENE), LAMPS))
    software, size = is_software(subject), picture_size(subject)
    drawn = subject.on(scene, size)
    camera = CAMERA if any(it.name == CAMERA for it in scene.cameras) else None
    view = view_at(scene, camera, size)
    counts = [it for it in (COUNTS if effort.everything else QUICK_COUNTS) if it <= len(scene.lights)]
    texels = SOFTWARE_TEXELS if software else TEXELS
    rows: list[dict[str, Any]] = []
    ways = [
        (count, way)
        for count in counts
        for way in WAYS
        if way == "lists" or not software or count <= SOFTWARE_MOST
    ]
    for number, (count, way) in enumerate(ways):
        step(f"{count} lights, {way}", number / len(ways))
        sizes = {"shadow_memory": "full", "shadow_size": texels, "shadow_lights": count, "shadow_pool": 1024}
        settings = settings_of(drawn, color_format="rgba16f", **sizes, **WAYS[way])
        with drawn.open(settings, {"color"}) as renderer:
            row = _measured(renderer, view, scene, FEW_FRAMES if software else effort.frames)
        rows.append({"way": way, "times": None, **row})
        if way == "everything":
            key = "frame_ms" if software else "ms"
            rows[-1]["times"] = rows[-1][key] / max(rows[-2][key], 1e-6)
    return {"scene": SCENE, "size": list(size), "texels": texels, "rows": rows}


def _measured(renderer: Any, view: View, scene: Scene, frames: int) -> dict[str, Any]:
    """Return the times of frames that draw all maps."""
    for _ in range(2):
        len(renderer.render(view).timings)  # waits for the frame
    still = [_frame(renderer, view) for _ in range(frames)]
    moving: list[tuple[float, dict[str, float]]] = []
    wanted = 1 + frames
    while len(moving) < wanted:
        way = STEP * scene.length_scale * (1 if len(moving) % 2 else -1)
        move_lights(scene, range(len(scene.lights)), (way, 0.0, 0.0))
        wall, passes, work = _frame(renderer, view)
        moving.append((wall, passes))
        if wall > SLOW_MS:
            wanted = min(wanted, 1 + FEW_FRAMES if wall < SLOWEST_MS else 2)
    rest = middle([wall for wall, *_ in still])[0]
    measured = moving[1:]  # the first one is recorded and compiled
    ms, noise = middle([_sum(passes, "shadows") for _, passes in measured])
    frame, frame_noise = middle([wall - rest for wall, _ in measured])
    light, light_noise = middle([_sum(passes, SHADED) for _, passes, _ in still])
    return {
        "lights": int(work["shadow_lights"]),
        "faces": int(work["shadow_faces_drawn"]),
        "ms": ms,
        "noise_ms": noise,
        "frame_ms": frame,
        "frame_noise_ms": frame_noise,
        "light_ms": light,
        "light_noise_ms": light_noise,
    }


def _frame(renderer: Any, view: View) -> tuple[float, dict[str, float], dict[str, int]]:
    """Return the ms of a frame by the clock, of its passes by timestamps, and its counters."""
    began = clock.perf_counter()
    frame = renderer.render(view)
    passes = dict(frame.timings)
    return (clock.perf_counter() - began) * 1e3, passes, dict(frame.work)


def _sum(passes: dict[str, float], beginnings: str | tuple[str, ...]) -> float:
    return sum(took for name, took in passes.items() if name.startswith(beginnings))


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the rows as a table, and the largest number of lights as a sentence."""
    width, height = record["size"]
    shown = table(
        f"Maps of {record['texels']} texels, all drawn in each frame, {record['scene']}, {width}x{height}",
        *(">lights", ">faces", "casters", ">GPU ms", ">wall ms", ">±", ">times", ">light ms"),
    )
    for row in record["rows"]:
        shown.add_row(
            str(row["lights"]),
            str(row["faces"]),
            row["way"],
            *(f"{row[name]:.2f}" for name in ("ms", "frame_ms", "frame_noise_ms")),
            "" if row["times"] is None else f"{row['times']:.1f}",
            f"{row['light_ms']:.2f}",
        )
    to.print(shown)
    for row in [row for row in record["rows"] if row["times"] is not None][-1:]:
        to.print(
            f"{row['lights']} lights: drawing everything into all {row['faces']} faces takes {row['times']:.1f} times "
            "as long as what the lists leave.",
            soft_wrap=True,
        )


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time over the number of lights, a line for each way, and the time of lighting."""
    for way in WAYS:
        rows = [row for row in record["rows"] if row["way"] == way]
        axes.plot([row["lights"] for row in rows], [row["frame_ms"] for row in rows], "o-", ms=4, label=way)
    rows = [row for row in record["rows"] if row["way"] == "lists"]
    axes.plot(
        [row["lights"] for row in rows], [row["light_ms"] for row in rows], "o--", ms=4, label="lighting"
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("lights with maps")
    axes.set_ylabel("ms")
    axes.set_title(f"Casters, {record['scene']}, {record['texels']} texels a face", fontsize=10)
    axes.legend(fontsize=8)
