"""What shading rates save, and how far their pictures are from the full rate: `strata bench 9 --only rates`.

A row is a policy with its thresholds, on one way to light: by compute, by two passes of fragments, or by the rates of
the device. Its truth is the settled picture of the same graph at the full rate. The mask changes from frame to frame,
since each texel has the full rate in one frame of eight: invocations and FLIP are means over the eight frames of such a
turn. Times are those of a camera that drifts by much less than a pixel, so no pass can rest. Where nothing changes, the
mask is kept: `kept` is of such frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from backends.fragments import fragments
from common.errors import UserError
from common.reports import metrics
from common.reports.benches import Effort, Subject, moved_view
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs, preset, replaced
from common.view.camera import View

from ..rates.model import KEPT, MASK, RATES, decode
from ..rates.native import FEATURE
from .pass_times import Groups, is_software, recorded_by, times_of

KNOB = "rate_policy"
"""The setting; a chapter without it has no shading rates."""

SCENES, QUICK_SCENES = ("atrium", "market"), ("atrium",)

WAYS: dict[str, dict[str, Any]] = {
    "compute": {"graph": "compute"},
    "passes": {"graph": "deferred", "rate_fragments": "passes"},
    "device": {"graph": "deferred", "rate_fragments": "device"},
}
"""The ways to light, of which the last one needs a device with shading rates."""

BRIEFLY = ("passes",)
"""Ways that are measured with the FEW rows alone."""

FULL = "full rate"

THRESHOLDS, SURFACES, RADII = (0.03, 0.1, 0.3, 1.0), (0.1, 0.3), (0.3, 0.6)

Row = tuple[str, dict[str, Any]]


def _sobel(threshold: float, surface: float) -> Row:
    """Return a row of the edges of the last picture; both thresholds are in its name."""
    values = {"rate_policy": "sobel", "rate_threshold": threshold, "rate_surface": surface}
    return f"sobel {threshold:g}/{surface:g}", values


def _radial(radius: float) -> Row:
    """Return a row of a policy that lights each pixel within a radius; of radius 0 no pixel is."""
    name = f"radial {radius:g}" if radius else "all coarse"
    return name, {"rate_policy": "radial", "rate_radius": radius}


def _coarser(row: Row) -> Row:
    return f"{row[0]}, 4x4", {**row[1], "rate_coarse": "4x4"}


FEW: tuple[Row, ...] = (_sobel(0.1, 0.1), _radial(0.0), _coarser(_radial(0.0)))

ROWS: tuple[Row, ...] = (
    *(_sobel(threshold, surface) for surface in SURFACES for threshold in THRESHOLDS),
    *map(_radial, (*RADII, 0.0)),
    *map(_coarser, (_sobel(0.1, 0.1), *map(_radial, (*RADII, 0.0)))),
)

GROUPS: Groups = {
    "mask": (MASK,),
    "edges": ("rate_edges",),
    "light": ("lighting", "rate_depth", "rate_spread"),
}
"""The passes that choose rates, and those that light by them."""

TURN = 8
"""Frames in which each texel has the full rate once."""

SLOW_FRAMES = 5
"""Frames that are measured on a software driver."""

DRIFT = 1e-3
"""Steps of `moved_view` by which the camera drifts in a frame: 1e-6 length scales."""

MOST_WAITS = 64
"""Frames that are drawn at most until all textures are there."""

GOOD = 0.02
"""FLIP below which a row counts as good, in what is said about the rows."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record; None for a chapter without shading rates.

    Of a row, `share` are invocations for each pixel of the picture, by the mask, and `counted` are those that the
    device counts in one frame, with `counted_mask` those of that frame's mask. None stands where nothing counts
    fragments. `flip` and `pixels_differ` (a share) are against the full rate. `ms` is the sum of `mask_ms`, `edges_ms`
    and `light_ms`, and `times` is `ms` of the full rate divided by it, None where the clock finds no time.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    names = SCENES if effort.everything else QUICK_SCENES
    ways = [way for way in WAYS if way != "device" or FEATURE in subject.device.capabilities.features]
    rows: list[dict[str, Any]] = []
    left_out: list[str] = []
    for place, name in enumerate(names):
        drawn = subject.on(replace(subject.load(name), animations=[]))
        for number, way in enumerate(ways):
            wanted = ROWS if effort.everything and way not in BRIEFLY else FEW
            full: dict[str, Any] | None = None
            truth: NDArray[np.float32] | None = None
            for at, (row, values) in enumerate([(FULL, {KNOB: "none"}), *wanted]):
                part = (number + at / (1 + len(wanted))) / len(ways)
                step(f"{name}, {way}, {row}", (place + part) / len(names))
                found = _found(drawn, settings_of(subject, **WAYS[way], **values), effort, truth)
                if found is None:
                    left_out.append(f"{row} by {way}")
                    continue
                figures, truth = found
                full = full or figures
                ratio = full["ms"] / figures["ms"] if figures["ms"] else None
                faster = {"times": ratio, "times_noise": _noise(ratio, full, figures)}
                rows.append({"scene": name, "way": way, "name": row, "settings": values, **figures, **faster})
    return {
        "size": list(subject.size),
        "turn": TURN,
        "clock": is_software(subject),
        "left_out": sorted(set(left_out)),
        "rows": rows,
    }


def settings_of(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: those of `medium` with one sample a pixel, without what moves."""
    exact = {"msaa": 1, "cloth": False, **values}
    known = knobs(subject.settings_class)
    settings = preset(subject.settings_class, "medium")
    return replaced(settings, **{name: value for name, value in exact.items() if name in known})


def _noise(ratio: float | None, *times: dict[str, Any]) -> float | None:
    """Return the noise of the ratio of two times; None without a ratio, or where the first of the times is 0."""
    if not ratio:
        return None
    return ratio * math.hypot(*(float(one["noise_ms"]) / float(one["ms"]) for one in times))


# --- one row ----------------------------------------------------------------------------------------------------------


def _found(
    drawn: Subject, settings: Any, effort: Effort, truth: NDArray[np.float32] | None
) -> tuple[dict[str, Any], NDArray[np.float32]] | None:
    """Return the figures of a row, and the truth; None where the settings have no effect on this device."""
    software, rated = is_software(drawn), settings.rates.rate_policy != "none"
    with drawn.open(settings, {"color", "color_linear"}, inspect=True) as renderer:
        if rated and not _has_mask(renderer):
            return None
        if truth is None:
            truth = drawn.settled_picture(renderer)[1]
        view = drawn.view(renderer)
        seen = _seen(renderer, view, truth, drawn.size)
        seen |= {
            f"kept_{name}": value
            for name, value in _errors_at_rest(renderer, view, truth, drawn.size).items()
        }
        seen |= _counted(renderer, view, drawn.size)
        if software:  # the copies of an inspected frame are in all times that are compared
            times = times_of(renderer, drifting(view, drawn.scene), GROUPS, _frames(effort, True), True)
    if not software:
        with drawn.open(settings, {"color"}) as renderer:
            _wait(renderer, view)
            views = drifting(view, drawn.scene)
            for _ in range(TURN):
                len(renderer.render(next(views)).timings)  # waits for the frame
            times = times_of(renderer, views, GROUPS, _frames(effort, False), False)
    found = dict(seen)
    for group, (ms, noise) in times.items():
        found |= {f"{group}_ms": ms, f"{group}_noise_ms": noise}
    found["ms"] = sum(ms for ms, _ in times.values())
    found["noise_ms"] = math.hypot(*(noise for _, noise in times.values()))
    return found, truth


def _frames(effort: Effort, software: bool) -> int:
    """Return how many frames are measured: whole turns, where that is quick."""
    return min(effort.frames, SLOW_FRAMES) if software else -(-effort.frames // TURN) * TURN


def drifting(view: View, scene: Scene) -> Iterator[View]:
    """Yield views that no two frames share."""
    number = 0
    while True:
        number += 1
        yield moved_view(view, scene, number * DRIFT)


def _wait(renderer: Any, view: View) -> None:
    """Draw frames until all textures are there, and one turn more, in which the mask finds all edges."""
    waits = 0
    while renderer.render(view).work.get("textures_waiting", 0) and waits < MOST_WAITS:
        waits += 1
    for _ in range(TURN):
        _turning(renderer)
        len(renderer.render(view).timings)


def _turning(renderer: Any) -> None:
    """Let texels have their turn in the next frame, too, though nothing changes."""
    for technique in renderer.techniques.values():
        if technique.settles_last:
            technique.reset("")


def _has_mask(renderer: Any) -> bool:
    return any(one.name == MASK for one in renderer.passes)


def _seen(
    renderer: Any, view: View, truth: NDArray[np.float32], size: tuple[int, int]
) -> dict[str, float | None]:
    """Return invocations and errors of a view, as means over a turn."""
    _wait(renderer, view)
    frames = []
    for _ in range(TURN):
        _turning(renderer)
        frames.append(_errors(renderer, view, truth, size))
    means = {name: [it for found in frames if (it := found[name]) is not None] for name in frames[0]}
    return {name: float(np.mean(values)) if values else None for name, values in means.items()}


def _errors_at_rest(
    renderer: Any, view: View, truth: NDArray[np.float32], size: tuple[int, int]
) -> dict[str, float | None]:
    """Return invocations and errors of frames that keep their mask."""
    for _ in range(KEPT + 1):
        len(renderer.render(view).timings)
    return _errors(renderer, view, truth, size)


def _errors(
    renderer: Any, view: View, truth: NDArray[np.float32], size: tuple[int, int]
) -> dict[str, float | None]:
    frame = renderer.render(view)
    shown = frame.image("color")[..., :3].astype(np.float32) / np.float32(255)
    try:
        flip: float | None = metrics.flip_mean(shown, truth)
    except UserError:  # the package is an extra; the others need none
        flip = None
    differ = float((shown != truth).any(axis=-1).mean())
    return {"share": _share(renderer, frame, size), "flip": flip, "pixels_differ": differ}


def _share(renderer: Any, frame: Any, size: tuple[int, int]) -> float:
    """Return the invocations of a frame for each of its pixels, by its mask."""
    if not _has_mask(renderer):
        return 1.0
    made = next(one for one in renderer.passes if one.name == MASK)
    image = frame.image(f"{MASK}/{RATES}")
    return invocations(image.reshape(image.shape[:2]), made.writes[0].texel, size) / (size[0] * size[1])


def invocations(mask: NDArray[Any], texel: tuple[int, int], size: tuple[int, int]) -> int:
    """Return how many blocks a mask of codes (rows, columns) lights; a block that leaves the picture is one, too."""
    rows, columns = np.indices(mask.shape)
    found = 0
    for code in np.unique(mask).tolist():
        blocks = 1
        for place, pixels, whole, side in zip((columns, rows), texel, size, decode(int(code)), strict=True):
            blocks = blocks * -(-np.minimum(pixels, whole - place * pixels) // side)
        found += int(np.broadcast_to(blocks, mask.shape)[mask == code].sum())
    return found


def _counted(renderer: Any, view: View, size: tuple[int, int]) -> dict[str, float | None]:
    """Return the invocations of fragments that light in one frame, for each pixel, as the device counts them."""
    passes = [one for one in renderer.passes if one.name.startswith("lighting")]
    drawn = all(access.use != "storage" for one in passes for access in one.writes)
    if not drawn or not renderer.device.has("pipeline-statistics"):
        return {"counted": None, "counted_mask": None}
    found, mask = 0, 1.0
    for one in passes:  # a frame for each: at rest, frames that are a turn apart have the same mask
        with fragments(renderer.device) as (counting, read):

            def counted(record: Callable[[Any], None], within: Any = counting) -> Callable[[Any], None]:
                def recorded(commands: Any) -> None:
                    with within(commands):
                        record(commands)

                return recorded

            with recorded_by(renderer, [one], counted):
                _turning(renderer)
                frame = renderer.render(view)
                found, mask = found + read(), _share(renderer, frame, size)
        for _ in range(TURN - 1):
            _turning(renderer)
            len(renderer.render(view).timings)
    return {"counted": found / (size[0] * size[1]), "counted_mask": mask}


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the rows as a table for each scene, and the results as sentences."""
    width, height = record["size"]
    unit = "ms by the clock" if record["clock"] else "ms on the GPU"
    for scene, way in dict.fromkeys((row["scene"], row["way"]) for row in record["rows"]):
        shown = table(
            f"Shading rates by {way}, {scene}, {width}x{height}, {unit}",
            *("", ">lit %", ">mask", ">edges", ">light", ">times", ">±", ">FLIP", ">differ %"),
        )
        for row in record["rows"]:
            if (row["scene"], row["way"]) == (scene, way):
                shown.add_row(
                    row["name"],
                    _percent(row["share"]),
                    *(f"{row[f'{name}_ms']:.3g}" for name in GROUPS),
                    *(_ratio(row[name]) for name in ("times", "times_noise")),
                    "-" if row["flip"] is None else f"{row['flip']:.4f}",
                    _percent(row["pixels_differ"]),
                )
        to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def _percent(value: float) -> str:
    return f"{100 * value:.1f}"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = [
        f"FLIP, lit and differing pixels are means over the {record['turn']} frames of a turn, against the full rate "
        "of the same graph. The ratio of times counts the mask, its edges and all passes that light. Sobel has "
        "rate_threshold/rate_surface in its name, radial its radius."
    ]
    rows = [row for row in record["rows"] if row["name"] != FULL]
    for scene, way in dict.fromkeys((row["scene"], row["way"]) for row in rows):
        alike = [row for row in rows if (row["scene"], row["way"]) == (scene, way) and row["times"]]
        good = [row for row in alike if row["flip"] is not None and row["flip"] < GOOD]
        if good:
            best = max(good, key=lambda row: float(row["times"] - row["times_noise"]))
            slower = " No row of them saves time here." * (best["times"] < 1.0)
            lines.append(
                f"{scene}, {way}: with FLIP below {GOOD:g}, the fastest is {best['name']}: {best['times']:.2f} "
                f"(±{best['times_noise']:.2f}) times "
                f"as fast as the full rate, with a FLIP of {best['flip']:.4f}.{slower}"
            )
    for row in rows:
        if row["settings"] == FEW[0][1] and row["kept_flip"] is not None:
            lines.append(
                f"{row['scene']}, {row['way']}: while nothing changes, the mask of {row['name']} lights "
                f"{_percent(row['kept_share'])} % of the pixels, with a FLIP of {row['kept_flip']:.4f}."
            )
    counted = [abs(row["counted"] / row["counted_mask"] - 1) for row in rows if row["counted"] is not None]
    if counted:
        beside = f", or up to {_percent(max(counted))} % beside that" * (max(counted) >= 5e-4)
        lines.append(f"The device counts the fragments that the masks ask for{beside}.")
    if record["left_out"]:
        lines.append(f"This device does not have {', '.join(record['left_out'])}.")
    elif "device" not in {row["way"] for row in rows}:
        lines.append("Rates of the device are not compared: it has none.")
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw FLIP over the time as a share of that of the full rate, a line for each scene and way."""
    error = "flip" if all(row["flip"] is not None for row in record["rows"]) else "pixels_differ"
    rows = [row for row in record["rows"] if row["name"] != FULL]
    for scene, way in dict.fromkeys((row["scene"], row["way"]) for row in rows):
        points = [
            (1 / row["times"], row[error])
            for row in rows
            if (row["scene"], row["way"]) == (scene, way) and row["times"]
        ]
        axes.plot([x for x, _ in points], [y for _, y in points], "o", ms=4, label=f"{scene}, {way}")
    axes.axvline(1.0, color="0.6", lw=0.8)
    axes.set_xlabel("time / time of the full rate")
    axes.set_ylabel("FLIP" if error == "flip" else "share of pixels that differ")
    axes.set_title("Shading rates, {}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=7)
