"""Memory of shadow maps against their error: `strata bench 8 --only memory`.

The market is lit by 256 lamps, which all may cast shadows. Maps of one size for all lamps are compared with maps as
fine as the picture needs, and with those that a small pool leaves of them. Where a device has sparse memory, maps by
need are drawn without it, too. Errors are those of `shadow_truth`, against rays. The moon is left out: its cascades
would take the same memory in all rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, difference
from common.reports.tables import table
from common.settings import knobs

from .. import LESSON
from ..shadows.faces import has_cube
from ..shadows.model import CUBE_FACES
from .ray_casting import RayCaster
from .shadow_scenes import KNOB, LAMPS, MIB, found_by, percent, picture_size, scene_with, settings_of
from .shadow_truth import ShadowTruth, errors_of

COUNT, QUICK_COUNT = 256, 32
"""Lamps of the market."""

SIZES, QUICK_SIZES = (128, 256, 512), (128, 256)
"""Texels along the faces of all lamps."""

DETAILS, QUICK_DETAILS = (0.0625, 0.125, 0.25, 0.5, 1.0, 2.0), (0.25, 1.0)
"""The setting `shadow_detail`: texels for each pixel."""

POOLS, QUICK_POOLS = (8, 16, 32, 64), (2,)
"""MiB of pools that are too small for POOLED_DETAIL."""

POOLED_DETAIL = 1.0

LARGEST, ROOM = 1024, 1024
"""Texels of the finest faces by need, and MiB of a pool that is never too small."""

SPARSE = "sparse"
"""The feature of devices."""

PARTING = "software pages"
"""How tables call maps by need on a device with sparse memory that does without it."""

BY_NEED = ("pages", "pool")
"""The kinds of rows whose memory follows what the picture needs."""

Step = Callable[[str, float], None]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without shadow maps, or where no rays can be cast.

    Of a row, `mib` is the memory that is compared: with full maps what those of all lamps take, whether they are seen
    or not, else the tiles in use. `used_mib` are the tiles in use, `allocated_mib` is the whole image of pages.
    `floor` is the error of maps of this size whose depths are exact, None where sizes differ from lamp to lamp.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    everything = effort.everything
    name = f"market:lights={COUNT if everything else QUICK_COUNT}"
    scene = scene_with(subject.load(name), LAMPS)
    try:
        caster = RayCaster(scene)
    except ImportError:
        return None
    size = picture_size(subject)
    drawn, settings = subject.on(scene, size), settings_of(subject, shadow_pool=ROOM)
    sparse = has_sparse(subject)
    truth: ShadowTruth | None = None
    rows: list[dict[str, Any]] = []
    pictures: dict[str, np.ndarray] = {}
    ways = list(_ways(everything, sparse))
    for number, (kind, values) in enumerate(ways):
        step(f"{kind}, {_spoken(values)}", number / len(ways))
        wanted = settings_of(subject, **{"shadow_pool": ROOM, **values})
        without = (SPARSE,) if kind == PARTING else ()
        found = found_by(drawn, wanted, effort, without)
        if truth is None:
            truth = ShadowTruth(scene, _first_view(drawn, settings), size, caster, wanted)
            hard = truth.hard()
        knob = wanted.shadows
        bias = knob.shadow_constant, knob.shadow_slope
        exact = truth.exact(found.faces, knob.shadow_kernel, bias) if kind == "full" else None
        rows.append(
            {
                "kind": kind,
                "name": _spoken(values),
                "settings": values,
                "mib": full_mib(truth.records, wanted) if kind == "full" else found.mib,
                "used_mib": found.mib,
                "allocated_mib": found.work["shadow_bytes"] / MIB,
                "lights": found.work["shadow_lights"],
                "lowered": found.work.get("shadow_lights_lowered", 0),
                **errors_of(found.factor, hard),
                "floor": None if exact is None else errors_of(exact, hard)["error"],
                "ms": found.ms,
                "noise_ms": found.noise_ms,
                "pixels_differ": None,
            }
        )
        picture = found.factor.astype(np.float32)[..., None]
        if kind == PARTING:
            rows[-1]["pixels_differ"] = difference(picture, pictures[rows[-1]["name"]])["pixels_differ"]
        elif kind == "pages":
            pictures[rows[-1]["name"]] = picture
    return {
        "scene": name,
        "lamps": len(scene.lights),
        "size": list(size),
        "pixels": int(np.isfinite(hard).sum()),
        "sparse": sparse,
        "rows": rows,
        "equal_error": equal_errors(rows),
    }


def has_sparse(subject: Subject) -> bool:
    """Whether the chapter puts pages into sparse memory on the subject's device."""
    return SPARSE in LESSON.needs.optional and SPARSE in subject.device.capabilities.features


def full_mib(records: np.ndarray, settings: Any) -> float:
    """Return the MiB of maps of the largest size for all faces of all lamps."""
    faces = int(np.where(has_cube(records), CUBE_FACES, 1).sum())
    return faces * settings.shadows.shadow_size**2 * 4 / MIB


def _ways(everything: bool, sparse: bool) -> list[tuple[str, dict[str, Any]]]:
    """Return the kinds of the rows and their settings."""
    sizes, details = (SIZES, DETAILS) if everything else (QUICK_SIZES, QUICK_DETAILS)
    by_need = [{"shadow_memory": "pages", "shadow_size": LARGEST, "shadow_detail": it} for it in details]
    pools = [
        {
            "shadow_memory": "pages",
            "shadow_size": LARGEST,
            "shadow_detail": POOLED_DETAIL,
            "shadow_pool": pool,
        }
        for pool in (POOLS if everything else QUICK_POOLS)
    ]
    return [
        *(("full", {"shadow_memory": "full", "shadow_size": size}) for size in sizes),
        *(("pages", values) for values in by_need),
        *(("pool", values) for values in pools),
        *((PARTING, values) for values in (by_need if sparse else ())),
    ]


def _spoken(values: dict[str, Any]) -> str:
    if values["shadow_memory"] == "full":
        return f"{values['shadow_size']} texels"
    if "shadow_pool" in values:
        return f"{values['shadow_pool']} MiB"
    return f"detail {values['shadow_detail']:g}"


def _first_view(drawn: Subject, settings: Any) -> Any:
    with drawn.open(settings, {"color"}) as renderer:
        return drawn.view(renderer)


# --- memory at equal error --------------------------------------------------------------------------------------------


def equal_errors(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return for each row of full maps the memory with which maps by need have its error, and the ratio of both.

    None stands where no maps by need have so small an error. `at_most` says that even those with the least memory have
    a smaller one.
    """
    by_need = front([(row["mib"], row["error"]) for row in rows if row["kind"] in BY_NEED])
    found = []
    for row in rows:
        if row["kind"] == "full":
            mib = memory_at(row["error"], by_need)
            ratio = None if mib is None else mib / row["mib"]
            at_most = bool(by_need) and row["error"] > by_need[0][1]
            found.append(
                {"full": row["name"], "error": row["error"], "mib": mib, "ratio": ratio, "at_most": at_most}
            )
    return found


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the (memory, error) of which no other has less of both, by growing memory."""
    kept: list[tuple[float, float]] = []
    for memory, error in sorted(points):
        if not kept or error < kept[-1][1]:
            kept.append((memory, error))
    return kept


def memory_at(error: float, points: Sequence[tuple[float, float]]) -> float | None:
    """Return the memory of an error on the line through a front of (memory, error), logarithmic on both axes.

    It is that of the first point where all errors are smaller, and None where all are larger.
    """
    if not points or points[-1][1] > error:
        return None
    memory, errors = np.log(np.array(points[::-1])).T
    return float(np.exp(np.interp(np.log(error), errors, memory)))


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the rows as a table, and the results as sentences."""
    width, height = record["size"]
    shown = table(
        f"Memory and error of shadow maps, {record['lamps']} lamps of the market, {width}x{height}, errors in %",
        *("maps", ">MiB", ">bound", ">error", ">exact", ">wrong", ">off edges", ">ms"),
    )
    for row in record["rows"]:
        lowered = f" ({row['lowered']} lowered)" if row["lowered"] else ""
        shown.add_row(
            f"{row['kind']}, {row['name']}{lowered}",
            f"{row['mib']:.1f}",
            f"{row['allocated_mib']:.0f}",
            *(percent(row[name]) for name in ("error", "floor", "wrong", "off_edges")),
            f"{row['ms']:.1f}",
        )
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = []
    for one in record["equal_error"]:
        if one["ratio"] is None:
            lines.append(f"{one['full']} for all lamps: no maps by need have this error.")
        else:
            lines.append(
                f"{one['full']} for all lamps: maps by need have "
                f"{'less' if one['at_most'] else 'the same'} error in {one['mib']:.1f} MiB, {one['ratio']:.2f} of the "
                "memory."
            )
    differ = [row["pixels_differ"] for row in record["rows"] if row["pixels_differ"] is not None]
    if differ:
        lines.append(f"Sparse memory and software pages: {sum(differ)} pixels differ in all rows together.")
    elif not record["sparse"]:
        lines.append("Sparse memory is not compared: this chapter has none on this device.")
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error over the memory, a line for each kind of maps."""
    for kind in dict.fromkeys(row["kind"] for row in record["rows"]):
        rows = sorted((row["mib"], row["error"]) for row in record["rows"] if row["kind"] == kind)
        axes.plot(*zip(*rows, strict=True), "o-", label=kind, ms=4)
    floor = [(row["mib"], row["floor"]) for row in record["rows"] if row["floor"] is not None]
    axes.plot(*zip(*floor, strict=True), "--", color="0.6", label="full, exact depths")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("MiB of shadow maps")
    axes.set_ylabel("mean error of the shadow factor")
    axes.set_title(f"{record['lamps']} lamps, " + "{}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=8)
