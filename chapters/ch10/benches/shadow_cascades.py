"""Cascades of the sun by their number and size: `strata bench 8 --only cascades`.

The atrium is lit by its sun alone. Errors are those of `shadow_truth`, and those of maps with exact depths stand beside
them. Along a walk of the camera some frames draw cascades anew; those are counted.
"""

from __future__ import annotations

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

COUNTS, QUICK_COUNTS = (1, 2, 3, 4), (1, 3)
SIZES, QUICK_SIZES = (512, 1024, 2048), (512,)

WALK, QUICK_WALK = 40, 4
"""Frames of the walk, in steps of `common.reports.benches.STEP`."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record; None for a chapter without shadow maps, or where no rays can be cast.

    `texels_mm` are the lengths of texels of the cascades, finest first; `drawn` is the mean of cascades that a frame of
    the walk draws, `steps` the part of its frames that draw any.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    scene, size = scene_with(subject.load(SCENE), SUNS), picture_size(subject)
    try:
        caster = RayCaster(scene)
    except ImportError:
        return None
    drawn = subject.on(scene, size)
    truth = ShadowTruth(scene, view_at(scene, None, size), size, caster, settings_of(drawn))
    hard, rows = truth.hard(), list[dict[str, Any]]()
    sizes, counts = (SIZES, COUNTS) if effort.everything else (QUICK_SIZES, QUICK_COUNTS)
    for number, (texels, count) in enumerate((texels, count) for texels in sizes for count in counts):
        step(f"{count} of {texels} texels", number / (len(sizes) * len(counts)))
        settings = settings_of(drawn, shadow_cascades=count, shadow_sun_size=texels, shadow_pool=1024)
        walk = WALK if effort.everything else QUICK_WALK
        found, knob = found_by(drawn, settings, effort, walk=walk), settings.shadows
        exact = truth.exact(found.faces, knob.shadow_kernel, (knob.shadow_constant, knob.shadow_slope))
        rows.append(
            {
                "cascades": count,
                "texels": texels,
                "texels_mm": [
                    float(1e3 / min(face["scale_x"], face["scale_y"])) for face in found.faces[:count]
                ],
                "mib": found.mib,
                **errors_of(found.factor, hard),
                "floor": errors_of(exact, hard)["error"],
                "drawn": float(np.mean(found.walked)),
                "steps": float(np.mean(np.array(found.walked) > 0)),
                "ms": found.ms,
                "noise_ms": found.noise_ms,
            }
        )
    return {"scene": SCENE, "size": list(size), "pixels": int(np.isfinite(hard).sum()), "rows": rows}


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the rows as a table."""
    shown = table(
        "Cascades of the sun, {}, {}x{}, errors in %".format(record["scene"], *record["size"]),
        *(">cascades", ">texels", ">mm", ">MiB", ">error", ">exact", ">wrong", ">drawn", ">ms"),
    )
    for row in record["rows"]:
        shown.add_row(
            str(row["cascades"]),
            str(row["texels"]),
            " ".join(f"{length:.0f}" for length in row["texels_mm"]),
            f"{row['mib']:.1f}",
            *(percent(row[name]) for name in ("error", "floor", "wrong")),
            f"{row['drawn']:.2f}",
            f"{row['ms']:.1f}",
        )
    to.print(shown)
    to.print(
        "The lengths are those of texels of each cascade. Drawn are cascades in each frame of a walk, in the mean.",
        soft_wrap=True,
    )


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error over the memory, a line for each number of cascades."""
    for count in dict.fromkeys(row["cascades"] for row in record["rows"]):
        rows = [row for row in record["rows"] if row["cascades"] == count]
        axes.plot([row["mib"] for row in rows], [row["error"] for row in rows], "o-", ms=4, label=f"{count}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("MiB of cascades")
    axes.set_ylabel("mean error of the shadow factor")
    axes.set_title(f"Cascades, {record['scene']}, " + "{}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=8, title="cascades")
