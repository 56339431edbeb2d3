"""The visibility buffer against the G-buffer pass on the city: time of their passes, memory traffic, and agreement.

Both sides cull alike and draw the same triangles. Anisotropy is 1: the software driver filters isotropically where a
shader gives the gradients itself.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any

from rich.console import Console

from common.reports.benches import Effort, Subject, errors, middle
from common.reports.tables import table
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import knobs, preset, replaced
from common.view.camera import View, view_of_scene

KNOB = "surfaces"
"""The setting; a chapter without it has the G-buffer pass alone."""

WAYS = ("gbuffer", "visibility")
"""The values of the setting; the picture of the first one is the truth."""

KERNEL = "visibility_resolve"
"""The pass that evaluates materials."""

SCENE, QUICK_SCENE = "city:1M", "city:100K"

SIZE, QUICK_SIZE = (1920, 1080), (160, 90)

VIEWS, QUICK_VIEWS = 4, 1
"""Cameras of the scene, evenly spread over its list."""

SOFTWARE_FRAMES, LEAST_WARM_UP = 4, 3
"""Frames of a view on a software driver, and those before the measured ones: the second knows what the first saw."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return a row for each view and way; None for a chapter without the setting.

    `passes` are ms by pass of those that fill the G-buffer and its depth, `ms` is their sum; both are 0 on a device
    without time stamps. `ms` is None where those of dispatches are wrong: Vulkan's software driver takes them before a
    dispatch has ended. `wall_ms` is the time from the call until the frame is done. `triangles` are those that culling
    left.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    name = SCENE if effort.everything else QUICK_SCENE
    size = SIZE if effort.everything else QUICK_SIZE
    step(name, 0.0)
    scene = subject.load(name)
    views = [camera.name for camera in scene.cameras]
    count = min(VIEWS if effort.everything else QUICK_VIEWS, len(views))
    views = [views[number * len(views) // count] for number in range(count)]
    drawn = subject.on(scene, size)
    settings = replaced(
        preset(subject.settings_class, "medium"), graph="deferred", culling="occlusion", anisotropy=1.0
    )
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    pictures: dict[tuple[str, str], Any] = {}
    for place, way in enumerate(WAYS):
        with drawn.open(replaced(settings, surfaces=way), {"color", "color_linear"}) as renderer:
            for number, view in enumerate(views):
                step(f"{way}, {view}", (place + number / count) / len(WAYS))
                rows[view, way], frame = _timed(renderer, _view_at(scene, view, size), effort)
                pictures[view, way] = tuple(frame.image(image) for image in ("color_linear", "color"))
                linear, shown = pictures[view, way]
                pictures[view, way] = linear[..., :3].copy(), shown[..., :3].copy()
    for (view, way), row in rows.items():
        truth = pictures[view, WAYS[0]]
        row |= {"view": view, "way": way, "error": errors(pictures[view, way], truth)}
    return {"scene": name, "size": list(size), "rows": list(rows.values())}


def _view_at(scene: Scene, name: str, size: tuple[int, int]) -> View:
    return view_of_scene(scene, evaluate_pose(scene, 0.0), name, size[0] / size[1])


def _timed(renderer: Any, view: View, effort: Effort) -> tuple[dict[str, Any], Any]:
    """Return the times of a view, and its last frame."""
    software = renderer.capabilities.is_software
    frames = min(effort.frames, SOFTWARE_FRAMES) if software else effort.frames
    times: list[tuple[dict[str, float], float]] = []
    for _ in range(max(effort.warm_up, LEAST_WARM_UP) + frames):
        started = clock.perf_counter()
        frame = renderer.render(view, 0.0)
        taken = dict(frame.timings)
        times.append((taken, (clock.perf_counter() - started) * 1e3))
    measured = [taken for taken, _ in times[-frames:]]
    names = [name for name in measured[0] if name.startswith(WAYS)]
    passes = {name: middle([took[name] for took in measured])[0] for name in names}
    ms: float | None
    ms, noise = middle([sum(took[name] for name in names) for took in measured])
    if software and renderer.capabilities.backend == "vulkan" and KERNEL in names:
        ms = None
    wall, wall_noise = middle([whole for _, whole in times[-frames:]])
    triangles = int(frame.work.get("triangles_drawn", frame.work.get("triangles", 0)))
    row = {
        "ms": ms,
        "noise_ms": noise,
        "wall_ms": wall,
        "wall_noise_ms": wall_noise,
        "passes": passes,
        "triangles": triangles,
    }
    return row, frame


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print times and errors as a table."""
    shown = table(
        "G-buffer and visibility buffer, {}, {}x{}".format(record["scene"], *record["size"]),
        *(
            "view",
            ">triangles",
            "surfaces",
            ">GPU ms",
            ">±",
            ">of it resolve",
            ">wall ms",
            ">±",
            ">largest difference",
        ),
    )
    for row in record["rows"]:
        resolve, known = row["passes"].get(KERNEL), row["ms"] is not None
        shown.add_row(
            row["view"],
            f"{row['triangles']:,}",
            row["way"],
            f"{row['ms']:.3f}" if known else "-",
            f"{row['noise_ms']:.3f}" if known else "-",
            "-" if resolve is None or not known else f"{resolve:.3f}",
            f"{row['wall_ms']:.3f}",
            f"{row['wall_noise_ms']:.3f}",
            f"{row['error']['max_abs']:.0f}",
        )
    to.print(shown)


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of each way by view: of its passes, or of the frame where their stamps are wrong."""
    known = all(row["ms"] is not None for row in record["rows"])
    for way in WAYS:
        rows = [row for row in record["rows"] if row["way"] == way]
        took = [row["ms" if known else "wall_ms"] for row in rows]
        axes.plot([row["view"] for row in rows], took, "o-", label=way, ms=4)
    axes.set_yscale("log")
    axes.set_ylabel("GPU ms of filling the G-buffer" if known else "ms of a frame")
    width, height = record["size"]
    axes.set_title(f"Surfaces, {record['scene']}, {width}x{height}", fontsize=10)
    axes.legend(fontsize=8)
