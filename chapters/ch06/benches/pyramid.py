"""The time of the depth pyramid alone, by the size of the picture: it does not depend on what is drawn.

The pass is short, and some drivers read its last time stamp before its last dispatch is done (llvmpipe of Mesa 25.0.7
does). So the pyramid is built several times in one pass, and the time is the growth from one build to more.
"""

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

BUILDS = 9
"""Builds of the pyramid in the longer pass."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> list[dict[str, Any]]:
    """Return the ms of one build for each size, and its noise; none on a device without timestamps."""
    scene = subject.load(QUICK_SCENE)
    (name, *_) = street_views(subject, effort, scene)
    points: list[dict[str, Any]] = []
    sizes = SIZES if effort.everything else QUICK_SIZES
    for number, size in enumerate(sizes):
        step("pyramid of {}x{}".format(*size), number / len(sizes))
        drawn, view = subject.on(scene, size), view_at(scene, name, size)
        once, several = (_pass_times(drawn, view, builds, effort.frames) for builds in (1, BUILDS))
        if once and several:
            (first, noise), (last, more_noise) = middle(once), middle(several)
            build = {"gpu_ms": (last - first) / (BUILDS - 1), "noise_ms": (noise + more_noise) / (BUILDS - 1)}
            points.append({"size": list(size), **build})
    return points


def _pass_times(subject: Subject, view: Any, builds: int, frames: int) -> list[float]:
    """Return the ms of the pass in each frame, with so many builds of the pyramid in it; none without timestamps."""
    settings = medium(subject, geometry="classic", culling="occlusion")
    with subject.open(settings, {"color"}) as renderer:
        memory = renderer.techniques["culling"].memory
        build = memory.build_pyramid

        def build_several(commands: Any, number: int) -> None:
            build(commands, number)
            for _ in range(builds - 1):
                commands.compute_barrier()
                build(commands, number)

        memory.build_pyramid = build_several
        times = [renderer.render(view, 0.0).timings.get(PASS) for _ in range(LEAST_WARM_UP + frames)]
    return [took for took in times[LEAST_WARM_UP:] if took is not None]


# --- results ----------------------------------------------------------------------------------------------------------


def show(points: list[dict[str, Any]], to: Console) -> None:
    """Print the times as a table."""
    if not points:
        return
    shown = table("One build of the depth pyramid", ">size", ">GPU ms", ">±", ">ns a pixel")
    for point in points:
        width, height = point["size"]
        ns = point["gpu_ms"] * 1e6 / (width * height)
        shown.add_row(f"{width}x{height}", f"{point['gpu_ms']:.4f}", f"{point['noise_ms']:.4f}", f"{ns:.3f}")
    to.print(shown)
