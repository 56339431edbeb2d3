"""Ambient occlusion in screen space against rays that are cast: error and time of each mode, by radius.

The occlusion is measured where it acts. Of three pictures, without light from everywhere, with it, and with occlusion
too, the ratio of what is added is the factor on ambient light. Albedo and exposure are in both, and divide out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.settings import knobs, preset, replaced

from .ray_casting import RayCaster

KNOB = "ssao"
"""The setting; a chapter without it has no occlusion in screen space."""

SCENE = "atrium"

SIZE, QUICK_SIZE = (640, 360), (320, 180)

RADII, QUICK_RADII = (0.015, 0.03, 0.06), (0.03,)
"""Radii in length scales of the scene, which of the atrium is 33 m."""

RAYS, QUICK_RAYS = 128, 32
"""Rays of a pixel. With n of them a visibility of 1/2 is known to 1 / (2 sqrt(n)), and better in strata."""

EVERY = 4
"""Distance in pixels between those that are compared."""

WAYS: dict[str, dict[str, Any]] = {
    "none": {"ssao": "off"},
    "depth": {"ssao": "depth"},
    "depth, no blur": {"ssao": "depth", "ssao_blur": False},
    "normals": {"ssao": "normals"},
    "normals, no blur": {"ssao": "normals", "ssao_blur": False},
}

LEAST_WARM_UP = 3

Float64 = NDArray[np.float64]


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record; None for a chapter without the knob, or where no rays can be cast."""
    if KNOB not in knobs(subject.settings_class):
        return None
    scene = subject.load(SCENE)
    try:
        caster = RayCaster(scene)
    except ImportError:
        return None
    size = SIZE if effort.everything else QUICK_SIZE
    drawn = subject.on(scene, size)
    lit = _settings(drawn, ambient=1e3)
    with drawn.open(_settings(drawn, ambient=0.0), {"color_linear"}, size) as renderer:
        view = drawn.view(renderer)
        dark = _linear(renderer.render(view, 0.0))
    with drawn.open(lit, {"color_linear"}, size) as renderer:
        added = _linear(renderer.render(view, 0.0)) - dark
    points: list[dict[str, Any]] = []
    radii = RADII if effort.everything else QUICK_RADII
    for number, radius in enumerate(radii):
        step(f"rays of {radius} length scales", number / len(radii))
        rays = RAYS if effort.everything else QUICK_RAYS
        truth = caster.visibility(view, size, radius * scene.length_scale, rays, EVERY)
        compared = np.isfinite(truth) & (added > 1e-3 * added.max())
        for name, values in WAYS.items():
            step(f"ssao {name}", (number + 0.5) / len(radii))
            settings = replaced(lit, ssao_radius=radius, **values)
            with drawn.open(settings, {"color_linear"}, size) as renderer:
                times = []
                for _ in range(LEAST_WARM_UP + effort.frames):
                    frame = renderer.render(view, 0.0)
                    times.append(_pass_ms(frame.timings))
                factor = (_linear(frame) - dark)[compared] / added[compared]
            ms, noise = middle(times[LEAST_WARM_UP:])
            points.append(
                {"radius": radius, "way": name, "ms": ms, "noise_ms": noise}
                | compare(factor, truth[compared])
            )
    return {
        "scene": SCENE,
        "size": list(size),
        "length_scale_m": scene.length_scale,
        "rays": rays,
        "pixels": int(compared.sum()),
        "points": points,
    }


def compare(found: Float64, truth: Float64) -> dict[str, float]:
    """Return the mean error, its root mean square, and the correlation with the truth (0 for a constant)."""
    error = found - truth
    spread = float(found.std() * truth.std())
    centred = (found - found.mean()) * (truth - truth.mean())
    return {
        "mean": float(truth.mean()),
        "bias": float(error.mean()),
        "rmse": float(np.sqrt(np.mean(error**2))),
        "correlation": float(centred.mean() / spread) if spread > 1e-9 else 0.0,
    }


def _settings(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: exact ones, without what moves."""
    settings = replaced(
        preset(subject.settings_class, "medium"), graph="deferred", color_format="rgba32f", **values
    )
    return replaced(settings, cloth=False) if "cloth" in knobs(subject.settings_class) else settings


def _linear(frame: Any) -> Float64:
    """Return the green channel of a frame's light (H, W)."""
    return np.asarray(frame.image("color_linear")[..., 1], np.float64)


def _pass_ms(timings: dict[str, float]) -> float:
    """Return the time of the passes of occlusion."""
    return sum(took for name, took in timings.items() if name.startswith("ssao"))


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the errors and times as a table."""
    shown = table(
        "Ambient occlusion against {} rays a pixel, {}, {}x{}".format(
            record["rays"], record["scene"], *record["size"]
        ),
        *(">radius", "way", ">RMS error", ">mean error", ">correlation", ">GPU ms", ">±"),
    )
    for point in record["points"]:
        shown.add_row(
            f"{point['radius']:g}",
            point["way"],
            *(f"{point[key]:.3f}" for key in ("rmse", "bias", "correlation", "ms", "noise_ms")),
        )
    to.print(shown)


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error of each way over the radius."""
    for way in WAYS:
        points = [point for point in record["points"] if point["way"] == way]
        axes.plot([it["radius"] for it in points], [it["rmse"] for it in points], "o-", label=way, ms=4)
    axes.set_xscale("log")
    axes.set_xlabel("radius, length scales")
    axes.set_ylabel("RMS error of visibility")
    axes.legend(fontsize=8)
