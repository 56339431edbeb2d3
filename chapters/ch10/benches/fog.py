"""What grids and filters of fog cost, and how far they are from single scattering: `strata bench 10 --only fog`.

A row is one setting on one scene. Surfaces are black, so what is seen is the light of the fog: it is compared at some
pixels with quadrature in double precision (`fog_truth.py`), with shadows by cast rays. The view is at rest, as the mean
of some frames has it. Times are those of a camera that drifts by much less than a pixel, so no pass can rest.

Bands are steps of a ramp of fog beyond its slope (`common.reports.metrics.gradient_step`), in codes of 8 bits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from common.reports.benches import Effort, Subject
from common.reports.metrics import gradient_step
from common.reports.tables import table
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import knobs

from ..clusters.lights import LightRecords
from ..fog import model
from . import fog_scenes as scenes
from .fog_truth import Blocked, FogTruth, eye_rays
from .pass_times import Groups, is_software, times_of
from .ray_casting import Float64, RayCaster

KNOB = "fog_columns"
"""The setting; a chapter without it has no fog."""

Row = tuple[str, dict[str, Any]]

NONE = "without fog"

GRID, QUICK_GRID = (128, 72, 64), (64, 36, 32)
"""The grid of all rows but those of other grids: the default one."""

GRIDS, LARGER = ((32, 18, 16), (64, 36, 32), (96, 54, 48), (192, 108, 96)), (256, 144, 128)
"""Other grids. The last one is measured on a GPU alone."""

SLICES = (16, 32, 128)

UNFILTERED = {"fog_spatial": False, "fog_temporal": False}

SCENES = ("lamp behind", "lamp ahead", "atrium:fog", "market:fog")
QUICK_SCENES = SCENES[:2]

HALF = "half resolution"

PASSES = ("inject", "scatter", "spatial", "temporal", "integrate", "half")
GROUPS: Groups = {"fog": ("fog_",), "light": ("lighting",)}
"""All passes of fog, and the one that shows surfaces through it."""

PIXELS, QUICK_PIXELS = 400, 100
"""Pixels that are compared."""

SETTLED, LOADED = 16, 6
"""Frames of a view at rest whose mean a history is; and frames until all shadows are there."""

FLOOR = 0.01
"""The part of the mean light below which errors are not relative to the light of their pixel."""

SLOW_FRAMES = 3
"""Frames that are measured on a software driver."""

RAMP_SIZE, HORIZON = (320, 180), 100
"""Size of the picture of a ramp, and the first row that is part of it."""

RAMPS, QUICK_RAMPS = (16, 32, 64), (16,)
"""Slices of the grids whose bands are measured."""

WAYS: tuple[Row, ...] = (
    ("as it is", UNFILTERED),
    ("jitter, temporal", {"fog_spatial": False}),
    ("all filters", {}),
    ("all filters, dither", {"fog_dither": True}),
)

Step = Callable[[str, float], None]


class Truth(NamedTuple):
    """The pixels of a scene that are compared: numbers, light (P, 3) of the fog in nits, and transmittance (P,).

    `clear` is the picture without fog, and `known` whether the truth has all that the picture has.
    """

    pixels: NDArray[np.intp]
    light: Float64
    seen: Float64
    clear: Float64
    known: bool


def grid(size: tuple[int, int, int]) -> dict[str, Any]:
    """Return the settings of a grid."""
    return dict(zip(("fog_columns", "fog_rows", "fog_slices"), size, strict=True))


def rows_of(everything: bool, software: bool) -> list[Row]:
    """Return the settings to measure, the grid's own row first."""
    own = grid(GRID if everything else QUICK_GRID)
    names: list[Row] = [("default grid" if everything else "grid", {})]
    others: list[Row] = [("x".join(map(str, size)), grid(size)) for size in GRIDS if everything]
    if everything and not software:
        others.append(("x".join(map(str, LARGER)), grid(LARGER)))
    if not everything:
        others.append(("x".join(map(str, GRIDS[0])), grid(GRIDS[0])))
    others += [(f"{count} slices", {"fog_slices": count}) for count in SLICES if everything]
    turned: list[Row] = [
        *(names + others),
        ("rgba32f", {"fog_format": "rgba32f"}),
        ("no spatial", {"fog_spatial": False}),
        ("no temporal", {"fog_temporal": False}),
        ("no filter", UNFILTERED),
        (HALF, {"fog_half": True}),
    ]
    return [(name, own | values) for name, values in turned]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without fog.

    Of a row, `rms`, `median` and `p95` are relative errors of a pixel's light, `bias` is that of the mean light; None
    where the truth lacks the package that casts rays. `codes` is how far half resolution is from full resolution, at
    most, in codes of 8 bits. `fog_ms` and `light_ms` are times of all passes of fog and of the pass that shows surfaces
    through it; `passes_ms` has each pass of fog where there are timestamps.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    names = SCENES if effort.everything else QUICK_SCENES
    wanted = rows_of(effort.everything, is_software(subject))
    rows: list[dict[str, Any]] = []
    for place, name in enumerate(names):
        scene, values = scene_named(subject, name)
        drawn = subject.on(scene)
        truth: Truth | None = None
        whole: NDArray[np.int64] | None = None
        for at, (row, turned) in enumerate([(NONE, {"fog": False}), *wanted]):
            step(f"{name}, {row}", 0.9 * (place + at / (1 + len(wanted))) / len(names))
            settings = scenes.settings_of(subject, **values, **turned)
            count = PIXELS if effort.everything else QUICK_PIXELS
            figures, shown, truth = _found(drawn, settings, effort, truth, count)
            if whole is None and row != NONE:
                whole = shown
            codes = int(np.abs(shown - whole).max()) if row == HALF and whole is not None else None
            rows.append({"scene": name, "name": row, "settings": turned, "codes": codes, **figures})
    step("bands", 0.9)
    return {
        "size": list(subject.size),
        "frames": SETTLED,
        "clock": is_software(subject),
        "rows": rows,
        "bands": _bands(subject, RAMPS if effort.everything else QUICK_RAMPS),
    }


def scene_named(subject: Subject, name: str) -> tuple[Scene, dict[str, Any]]:
    """Return a scene of `SCENES` and the settings that it needs: the lamp of the haze casts no shadow."""
    if name == SCENES[0]:
        return scenes.ground(scenes.HAZE, scenes.BEHIND), {"shadows": "off"}
    if name == SCENES[1]:
        return scenes.ground(scenes.HAZE, scenes.AHEAD), {"shadows": "off"}
    return scenes.with_black_surfaces(subject.load(name)), {}


# --- one row ----------------------------------------------------------------------------------------------------------


def _found(
    drawn: Subject, settings: Any, effort: Effort, truth: Truth | None, count: int
) -> tuple[dict[str, Any], NDArray[np.int64], Truth]:
    """Return the figures of a row, what is shown (H, W, 3) in codes, and the truth, which the row without fog makes."""
    software, fog = is_software(drawn), settings.fog
    with drawn.open(settings, {"color", "color_linear", "depth"}) as renderer:
        view = drawn.view(renderer)
        for _ in range(SETTLED if fog.fog and fog.fog_temporal else LOADED):
            frame = renderer.render(view)
            shown = frame.image("color")[..., :3].astype(np.int64)  # waits for the frame
        linear = frame.image("color_linear")[..., :3].astype(np.float64)
        if truth is None:
            depth = frame.image("depth").astype(np.float64)
            truth = _truth(
                drawn.scene, view, depth.reshape(linear.shape[:2]), linear, renderer.settings, count
            )
        groups = GROUPS if software else {**GROUPS, **{name: (f"fog_{name}",) for name in PASSES}}
        views = scenes.drifting(view, drawn.scene)
        for _ in range(effort.warm_up):
            len(renderer.render(next(views)).timings)
        frames = min(effort.frames, SLOW_FRAMES) if software else effort.frames
        times = times_of(renderer, views, groups, frames, software)
        figures: dict[str, Any] = {**_errors(linear, truth, fog.fog), **_size(renderer.settings)}
    for name in GROUPS:
        figures[f"{name}_ms"], figures[f"{name}_noise_ms"] = times[name]
    figures["passes_ms"] = {name: times[name][0] for name in PASSES if times.get(name, (0.0,))[0]}
    return figures, shown, truth


def _truth(scene: Scene, view: Any, depth: Float64, clear: Float64, settings: Any, count: int) -> Truth:
    """Return the truth at `count` pixels, chosen by lot."""
    pixels = np.sort(np.random.default_rng(10).choice(depth.size, min(count, depth.size), replace=False))
    medium, knob = model.medium_of(scene, settings.fog), settings.fog
    rays = eye_rays(scene, view, depth, pixels, model.range_of(scene, knob)[1])
    lights = LightRecords(scene, settings.scene.light_cutoff, settings.clusters.most_lights)
    lights.follow()
    records = lights.at(evaluate_pose(scene, 0.0))
    blocked: Blocked | None = None
    known = True
    if settings.shadows.shadows != "off" and len(records):
        try:
            caster = RayCaster(scene)
        except ImportError:
            known = False
        else:
            blocked = _solid(caster)
    ambient = settings.scene.ambient if settings.scene.ambient >= 0.0 else scene.ambient or 0.0
    near = settings.shadows.shadow_near * scene.length_scale
    truth = FogTruth(scene, medium, records, knob.fog_anisotropy, ambient, blocked, near)
    light = truth.light(rays) if known else np.zeros((len(pixels), 3))
    return Truth(pixels, light, truth.transmittance(rays), clear.reshape(-1, 3)[pixels], known)


def _solid(caster: RayCaster) -> Blocked:
    return lambda origins, targets: caster.blocked(origins, targets)[0]


def _errors(linear: Float64, truth: Truth, fog: bool) -> dict[str, float | None]:
    """Return the errors of a picture's fog: what it has beyond its surfaces, dimmed."""
    if not fog or not truth.known:
        return dict.fromkeys(("rms", "median", "p95", "bias"))
    found = linear.reshape(-1, 3)[truth.pixels] - truth.clear * truth.seen[:, None]
    away = (found - truth.light) / np.maximum(truth.light, FLOOR * truth.light.mean())
    return {
        "rms": float(np.sqrt((away**2).mean())),
        "median": float(np.median(np.abs(away))),
        "p95": float(np.quantile(np.abs(away), 0.95)),
        "bias": float(found.mean() / truth.light.mean() - 1.0),
    }


def _size(settings: Any) -> dict[str, Any]:
    """Return the number of froxels, and MiB of volumes and records; some volumes may share memory."""
    knob = settings.fog
    if not knob.fog:
        return {"froxels": 0, "mib": 0.0}
    count, texel = int(np.prod(model.grid_of(knob))), 16 if knob.fog_format == "rgba32f" else 8
    volumes = 2 + knob.fog_spatial + 2 * knob.fog_temporal
    return {"froxels": count, "mib": count * (volumes + 2) * texel / 2**20}


# --- bands ------------------------------------------------------------------------------------------------------------


def _bands(subject: Subject, counts: tuple[int, ...]) -> list[dict[str, Any]]:
    """Return the bands of the ramp in codes of 8 bits, for each number of slices and way to filter."""
    drawn, rows = subject.on(scenes.ramp(), RAMP_SIZE), []
    for count in counts:
        for name, values in WAYS:
            turned = {**values, "fog_slices": count}
            with drawn.open(scenes.settings_of(subject, shadows="off", **turned), {"color"}) as renderer:
                view = drawn.view(renderer)
                for _ in range(SETTLED):
                    shown = renderer.render(view).image("color")[..., :3]
            below = shown[HORIZON:].astype(np.float64)
            rows.append({"slices": count, "way": name, "codes": gradient_step(below, axis=0)})
    return rows


# --- results ----------------------------------------------------------------------------------------------------------


TIMES = (("fog_ms", 3), ("fog_noise_ms", 1), ("light_ms", 3))
"""The times of a row, and how many digits of each are printed: a table has room in 80 columns."""


def show(record: dict[str, Any], to: Console) -> None:
    """Print a table for each scene, the bands, and the results as sentences."""
    width, height = record["size"]
    unit = "ms by the clock" if record["clock"] else "ms on the GPU"
    for scene in dict.fromkeys(row["scene"] for row in record["rows"]):
        shown = table(
            f"Fog, {scene}, {width}x{height}, {unit}, errors in %",
            *("", ">froxels", ">fog", ">±", ">light", ">rms", ">half", ">95 %", ">bias"),
        )
        for row in (row for row in record["rows"] if row["scene"] == scene):
            shown.add_row(
                row["name"],
                f"{row['froxels'] / 1000:.0f}k",
                *(f"{row[name]:.{digits}g}" for name, digits in TIMES),
                *(_percent(row[name]) for name in ("rms", "median", "p95", "bias")),
            )
        to.print(shown)
    shown = table("Bands of a ramp of fog, codes of 8 bits", "slices", *(f">{name}" for name, _ in WAYS))
    for count in dict.fromkeys(row["slices"] for row in record["bands"]):
        shown.add_row(
            str(count), *(f"{row['codes']:.2f}" for row in record["bands"] if row["slices"] == count)
        )
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True, emoji=False)  # ":fog:" is a picture to the printer


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = [
        "Errors are relative to single scattering in double precision at pixels chosen by lot, after "
        f"{record['frames']} frames of a view at rest. The time of light is that of all surfaces."
    ]
    for scene in dict.fromkeys(row["scene"] for row in record["rows"]):
        rows = [row for row in record["rows"] if row["scene"] == scene and row["froxels"]]
        if rows[0]["rms"] is None:
            lines.append(f"{scene}: no errors, since the package that casts rays is not installed.")
            continue
        best = min(rows, key=lambda row: float(row["rms"]))
        lines.append(
            f"{scene}: the {rows[0]['name']} is off by {_percent(rows[0]['rms'])} % rms, half of the pixels by less "
            f"than {_percent(rows[0]['median'])} %; nearest is {best['name']} with {_percent(best['rms'])} % rms."
        )
    codes = [row["codes"] for row in record["rows"] if row["codes"] is not None]
    if codes:
        lines.append(f"Half resolution is off by {max(codes)} of 255 codes at most.")
    return lines


def _is_grid(row: dict[str, Any]) -> bool:
    """Whether a row has another grid alone: grids have two columns for each slice."""
    settings = row["settings"]
    return len(settings) == 3 and settings["fog_columns"] == 2 * settings["fog_slices"]


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error over the number of froxels, a line for each scene; crosses are other settings."""
    for scene in dict.fromkeys(row["scene"] for row in record["rows"] if row["rms"] is not None):
        points: dict[bool, list[tuple[int, float]]] = {True: [], False: []}
        for row in record["rows"]:
            if row["scene"] == scene and row["rms"] is not None:
                points[_is_grid(row)].append((row["froxels"], row["rms"]))
        (line,) = axes.plot(*zip(*sorted(points[True]), strict=True), "o-", ms=4, label=scene)
        axes.plot(*zip(*points[False], strict=True), "x", color=line.get_color())
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("froxels")
    axes.set_ylabel("relative rms error")
    axes.set_title("Fog against single scattering, {}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=7)
