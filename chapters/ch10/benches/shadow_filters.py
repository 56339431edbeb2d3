"""Filters and biases of shadow maps against cast rays: `strata bench 8 --only filters`.

The atrium is lit by its sun alone, and by its lamps alone. Factors are compared with those of lights without an
extent, and with those of a wide sun and of lamps with a radius. Kernels have one width everywhere. Soft shadows have
that of the light's image. Biases are judged off edges: dark pixels there are acne, bright ones are light that leaks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject
from common.reports.tables import table
from common.settings import knobs

from .ray_casting import RayCaster
from .shadow_scenes import (
    KNOB,
    LAMPS,
    SUNS,
    found_by,
    percent,
    picture_size,
    scene_with,
    settings_of,
    view_at,
)
from .shadow_truth import ShadowTruth, errors_of

SCENE = "atrium"

LIGHTS = {"sun": SUNS, "lamps": LAMPS}

KERNELS, QUICK_KERNELS = (1, 3, 5, 7, 9, 11, 13), (1, 3, 13)

BIASES = (
    ("none", 0.0, 0.0),
    ("plane", 0.0, 0.0),
    ("plane", 0.5, 0.5),
    ("plane", 2.0, 2.0),
    ("slope", 0.0, 0.0),
    ("slope", 1.0, 1.0),
)
QUICK_BIASES = (("none", 0.0, 0.0), ("slope", 1.0, 1.0))
"""The settings `shadow_bias`, `shadow_constant` and `shadow_slope`; the rows of kernels have plane, 1 and 1."""

ANGLE = 1.0
"""Degrees of half the angle of the wide sun, four times as wide as ours."""

RADIUS = 0.003
"""The radius of lamps, in length scales."""

NEAR = 0.01
"""The setting `shadow_near`, in length scales: lamps of a radius would shine through the bodies that hold them."""

RAYS, QUICK_RAYS = 32, 8
"""Rays to a light with an extent. A factor is known to about 1 / RAYS: their places are evenly spread."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record; None for a chapter without shadow maps, or where no rays can be cast.

    `error` and `wrong` are against lights without an extent, `soft_error` and `soft_wrong` against the others. `floor`
    is the error of maps whose depths are exact, of kernels up to 3.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    everything, rows = effort.everything, list[dict[str, Any]]()
    size = picture_size(subject)
    rays = RAYS if everything else QUICK_RAYS
    ways = list(_ways(everything))
    for place, (lights, kinds) in enumerate(LIGHTS.items()):
        scene = scene_with(subject.load(SCENE), kinds)
        try:
            caster = RayCaster(scene)
        except ImportError:
            return None
        drawn = subject.on(scene, size)
        base = settings_of(drawn, shadow_near=NEAR)
        step(f"{lights}, rays", place / len(LIGHTS))
        truth = ShadowTruth(scene, view_at(scene, None, size), size, caster, base)
        hard = truth.hard()
        soft = truth.soft(RADIUS * scene.length_scale, math.radians(ANGLE), rays)
        for number, (name, values) in enumerate(ways):
            step(f"{lights}, {name}", (place + (1 + number) / (1 + len(ways))) / len(LIGHTS))
            settings = settings_of(drawn, shadow_near=NEAR, **values)
            knob = settings.shadows
            found = found_by(drawn, settings, effort)
            bias = knob.shadow_constant, knob.shadow_slope
            exact = None
            if "shadow_filter" not in values and knob.shadow_kernel <= 3 and knob.shadow_bias == "plane":
                exact = errors_of(truth.exact(found.faces, knob.shadow_kernel, bias), hard)["error"]
            extended = errors_of(found.factor, soft)
            rows.append(
                {
                    "lights": lights,
                    "name": name,
                    "settings": values,
                    **errors_of(found.factor, hard),
                    "floor": exact,
                    "soft_error": extended["error"],
                    "soft_wrong": extended["wrong"],
                    "ms": found.ms,
                    "noise_ms": found.noise_ms,
                }
            )
    return {
        "scene": SCENE,
        "size": list(size),
        "rays": rays,
        "pixels": int(np.isfinite(hard).sum()),
        "rows": rows,
    }


def _ways(everything: bool) -> list[tuple[str, dict[str, Any]]]:
    """Return the names of the rows and their settings."""
    soft = {"shadow_filter": "pcss", "shadow_lamp": RADIUS, "shadow_sun_angle": ANGLE}
    return [
        *((f"kernel {it}", {"shadow_kernel": it}) for it in (KERNELS if everything else QUICK_KERNELS)),
        ("pcss", soft),
        *(
            (
                f"{bias} {constant:g}" if bias != "none" else "no bias",
                {"shadow_bias": bias, "shadow_constant": constant, "shadow_slope": slope},
            )
            for bias, constant, slope in (BIASES if everything else QUICK_BIASES)
        ),
    ]


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the errors and times as tables."""
    width, height = record["size"]
    for lights in LIGHTS:
        shown = table(
            f"Filters and biases, {lights} of the {record['scene']}, {width}x{height}, errors in %",
            *("", ">error", ">exact", ">wrong", ">soft", ">dark", ">bright", ">ms", ">±"),
        )
        for row in record["rows"]:
            if row["lights"] == lights:
                errors = ("error", "floor", "wrong", "soft_error", "dark", "bright")
                times = f"{row['ms']:.1f}", f"{row['noise_ms']:.1f}"
                shown.add_row(row["name"], *(percent(row[name]) for name in errors), *times)
        to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = [
        "Dark and bright pixels are those off edges. Exact is the error of maps whose depths have none, soft is that "
        "against lights of an extent.",
        f"Lights of an extent have {record['rays']} rays: half of a sun's angle is {ANGLE:g} degrees, the radius of a "
        f"lamp {RADIUS:g} length scales.",
    ]
    for lights in LIGHTS:
        rows = [row for row in record["rows"] if row["lights"] == lights]
        kernels = [row for row in rows if row["name"].startswith("kernel")]
        soft = next(row for row in rows if row["name"] == "pcss")
        best = min(kernels, key=lambda row: float(row["soft_error"]))
        lines.append(
            f"{lights}: against soft light pcss is off by {percent(soft['soft_error'])} %, and the best kernel "
            f"({best['name']}) by {percent(best['soft_error'])} %."
        )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the errors of kernels against both truths, and those of soft shadows as lines across."""
    for number, lights in enumerate(LIGHTS):
        rows = [row for row in record["rows"] if row["lights"] == lights]
        kernels = [row for row in rows if row["name"].startswith("kernel")]
        at = [row["settings"]["shadow_kernel"] for row in kernels]
        soft = next(row for row in rows if row["name"] == "pcss")
        color = f"C{number}"
        axes.plot(at, [row["error"] for row in kernels], "o--", color=color, ms=4, label=f"{lights}, hard")
        axes.plot(
            at, [row["soft_error"] for row in kernels], "o-", color=color, ms=4, label=f"{lights}, soft"
        )
        axes.axhline(soft["soft_error"], color=color, lw=0.8, label=f"{lights}, pcss against soft")
    axes.set_yscale("log")
    axes.set_xlabel("texels along the kernel")
    axes.set_ylabel("mean error of the shadow factor")
    axes.set_title(f"Filters, {record['scene']}, " + "{}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=7)
