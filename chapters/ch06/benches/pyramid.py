"""The time of the depth pyramid alone, by the size of the picture: it does not depend on what is drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table

from .streets import LEAST_WARM_UP, QUICK_SCENE, medium, street_views, view_at

PASS = "depth_pyramid"

SIZES = ((640, 360), (1280, 720), (1919, 1079), (1920, 1080), (3840, 2160))
"""Sizes of pictures; one of them is odd in both directions."""

QUICK_SIZES = ((640, 360),)

FRAMES = 3
"""Frames for each of the bench's: the pass is short."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> list[dict[str, Any]]:
    """Return the ms of the pyramid's pass for each size; none on a device without timestamps."""
    scene = subject.load(QUICK_SCENE)
    (name, *_) = street_views(subject, effort, scene)
    settings = medium(subject, geometry="classic", culling="occlusion")
    points: list[dict[str, Any]] = []
    sizes = SIZES if effort.everything else QUICK_SIZES
    for number, size in enumerate(sizes):
        step("pyramid of {}x{}".format(*size), number / len(sizes))
        count = LEAST_WARM_UP + FRAMES * effort.frames
        with subject.on(scene, size).open(settings, {"color"}) as renderer:
            view = view_at(scene, name, size)
            times = [renderer.render(view, 0.0).timings.get(PASS) for _ in range(count)][LEAST_WARM_UP:]
        if None not in times:
            median, noise = middle(times)
            least = min(times)
            points.append({"size": list(size), "gpu_ms": median, "noise_ms": noise, "least_ms": least})
    return points


# --- results ----------------------------------------------------------------------------------------------------------


def show(points: list[dict[str, Any]], to: Console) -> None:
    """Print the times as a table."""
    if not points:
        return
    shown = table("The depth pyramid", ">size", ">GPU ms", ">±", ">least", ">ns a pixel")
    for point in points:
        width, height = point["size"]
        ns = point["gpu_ms"] * 1e6 / (width * height)
        times = (f"{point[name]:.4f}" for name in ("gpu_ms", "noise_ms", "least_ms"))
        shown.add_row(f"{width}x{height}", *times, f"{ns:.3f}")
    to.print(shown)
