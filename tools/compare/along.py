"""`strata compare A B --path P`: both sides along the same camera path, frame by frame, and B's error over time.

Each side has one renderer, whose histories live from the first frame to the last.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from backends.contract import check_time
from common import images
from common.errors import UserError
from common.images.color import quantize
from common.reports.metrics import NonFiniteError, flip_mean
from common.reports.sequences import FrameError, OverTime
from common.reports.tables import table
from common.scene import Scene
from common.view.paths import Stage
from tools.compare import report
from tools.compare.measure import Measured, Moment, Stand, errors, exposure_of, open_sides
from tools.compare.sheet import FOOTER, HEADER, LINE, MARGIN, PAPER, Panel, heat, magnification, sheet
from tools.compare.sides import Picture, Side
from tools.run.films import check_film, write_film
from tools.run.recording import planned

if TYPE_CHECKING:
    from tools.compare.compare import Request

Bytes = NDArray[np.uint8]

FILMS = (".webp", ".gif")
LIMITS = {"flip": 0.5, "difference": 0.25}
"""Where the scale of an error map ends in a film: the same in each frame."""


@dataclass
class Compared:
    """What came of a path: errors and flicker of all frames, and both sides, with their times, at the worst of them."""

    over: OverTime
    sides: tuple[Measured, Measured]


def check(request: Request) -> None:
    """Raise UserError for what is wrong with a request for a path, apart from its sides."""
    assert request.path is not None
    _, count = planned(request.path, request.frames, request.fps)
    check_time(request.time + (count - 1) / request.fps, "With --path and --fps the last --time")
    if request.map == "flip":
        blank = np.zeros((8, 8, 3), np.float32)
        flip_mean(blank, blank)  # for its error, before the work
    if request.out is not None and request.out.suffix.lower() not in (*FILMS, ".png"):
        raise UserError(
            f"--out {request.out}: the worst frame goes to a .png, all of them to a film, .webp or .gif."
        )


def check_sides(request: Request, sides: tuple[Side, Side], size: tuple[int, int]) -> None:
    """Raise UserError for sides that no path can be drawn with, or where a film cannot be written."""
    for side in sides:
        if isinstance(side, Picture):
            raise UserError(f"{side.text} is a picture: with --path both sides are what a renderer draws.")
        if "color" not in side.outputs:
            raise UserError(f"{side.text} shows no picture: with --path what is shown is compared.")
    if request.out is not None and request.out.suffix.lower() in FILMS:
        assert request.path is not None
        _, count = planned(request.path, request.frames, request.fps)
        times = magnification(size)
        width = MARGIN + 3 * (max(size[0] * times, 360) + MARGIN)
        check_film(
            request.out,
            count,
            (width, 2 * MARGIN + HEADER + size[1] * times + FOOTER + 4 * LINE),
            request.fps,
        )


def compare(
    request: Request,
    sides: tuple[Side, Side],
    scene: Scene,
    size: tuple[int, int],
    target: Path,
    steps: Any,
) -> Compared:
    """Draw both sides along the path; write the film of it, or the sheet of the worst frame. Raises StrataError."""
    assert request.path is not None
    path, count = planned(request.path, request.frames, request.fps)
    moment = Moment(request.camera, request.time, count, request.fps)
    over = OverTime(flip=request.map != "difference")
    with ExitStack() as stack:
        stands = open_sides(stack, sides, scene, size, moment, steps)
        a, b = (stand for stand in stands if isinstance(stand, Stand))
        stage = Stage.of(scene, a.view(request.time), size)
        worst: list[tuple[Measured, Measured]] = []

        def frames() -> Iterator[tuple[FrameError, Measured, Measured]]:
            for index, view in enumerate(path.views(stage, count, request.fps)):
                steps("frames", 0.5 + 0.5 * index / count)
                one, other = (stand.along(view, moment.at(index)) for stand in (a, b))
                found = _add(over, index, one, other)
                if found is over.worst():
                    worst[:] = [(one, other)]
                yield found, one, other

        if target.suffix.lower() in FILMS:
            write_film(target, _sheets(frames(), request, over), count, request.fps)
        else:
            for _ in frames():
                pass
            images.write_image(target, _sheet_of(over.worst(), *worst[0], request, None))
        for measured, stand in zip(worst[0], (a, b), strict=True):
            stand.point.rounds = stand.point.rounds[1:] or stand.point.rounds  # in the first, drivers compile
            measured.record = stand.record()
            measured.capabilities, measured.plan = stand.renderer.capabilities, stand.renderer.plan
    return Compared(over, worst[0])


def _add(over: OverTime, index: int, a: Measured, b: Measured) -> FrameError:
    """Add a frame of B, held against A."""
    assert a.shown is not None and b.shown is not None
    light = None if a.linear is None or b.linear is None else (b.linear, a.linear)
    try:
        return over.add(b.shown, a.shown, light)
    except NonFiniteError as error:
        raise NonFiniteError(f"Frame {index} cannot be compared: {error}.") from None


def _sheets(
    frames: Iterator[tuple[FrameError, Measured, Measured]], request: Request, over: OverTime
) -> Iterator[Bytes]:
    """Yield the sheet of each frame, all of one height."""
    height = None
    for found, a, b in frames:
        made = _sheet_of(found, a, b, request, over.flicker[-1] if over.flicker else 0.0)
        height = height or made.shape[0]
        if made.shape[0] < height:
            below = np.broadcast_to(np.array(PAPER, np.uint8), (height - made.shape[0], made.shape[1], 3))
            made = np.concatenate([made, below])
        yield made[:height]


def _sheet_of(found: FrameError, a: Measured, b: Measured, request: Request, flicker: float | None) -> Bytes:
    """Return A, B and the map of their difference side by side; in a film, where `flicker` is given, on one scale."""
    exposed = exposure_of(a, b, request.ev100)
    _, error_map, shown = errors(a, b, exposed, request.map)
    limit, more = error_map.limit, error_map.more
    if flicker is not None:
        limit = LIMITS[error_map.kind]
        more = bool(np.nanmax(error_map.values) > limit)
    panels = [
        Panel(f"{name}   {one.side.text}", report.capital(report.described(one.side)), quantize(pixels))  # type: ignore[arg-type]
        for name, one, pixels in zip("AB", (a, b), shown, strict=True)
    ]
    panels.append(Panel("Error of B against A", report.map_text(error_map), heat(error_map.values, limit)))
    line = f"{request.path}, frame {found.frame}: {_spoken(found)}"
    return sheet(panels, limit, more, [line if flicker is None else f"{line}, flicker {flicker:.2f} codes"])


def _spoken(found: FrameError) -> str:
    flip = "" if found.flip is None else f", FLIP {found.flip:.4f}"
    return f"PSNR {_number(found.psnr, '.2f')} dB, largest difference {found.max_abs:.0f} codes{flip}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else "infinite" if math.isinf(value) else format(value, form)


# --- what is said -----------------------------------------------------------------------------------------------------

ROWS = (
    ("largest difference, codes", "max_abs", ".1f"),
    ("PSNR, dB", "psnr", ".2f"),
    ("relative MSE", "relative_mse", ".3g"),
    ("FLIP, mean", "flip", ".4f"),
    ("flicker, codes", "flicker", ".3f"),
)


def figures_table(where: str, found: Compared) -> Table:
    """Return the errors of the first frame, the worst and the last, and their means; then times."""
    over = found.over
    chosen = (over.errors[0], over.worst(), over.errors[-1])
    heads = (f"first ({chosen[0].frame})", f"worst ({chosen[1].frame})", f"last ({chosen[2].frame})")
    shown = table(f"{where}: B against A", "", *(f">{head}" for head in heads), ">mean")
    mean = over.mean()
    for name, key, form in ROWS:
        cells = [_number(value, form) for value in (_value(over, one.frame, key) for one in chosen)]
        shown.add_row(name, *cells, _number(mean[key], form))
    return shown


def times_table(found: Compared) -> Table:
    """Return the medians of both sides' times."""
    a, b = found.sides
    shown = table("Medians of all frames after the first", "", ">A", ">B", ">B : A")
    for name, one, other, _ in report.times(a, b):
        cells = ["-" if value is None else f"{value:.2f}" for value in (one, other)]
        shown.add_row(name, *cells, f"{other / one:.2f}" if one and other is not None else "-")
    return shown


def _value(over: OverTime, frame: int, key: str) -> float | None:
    if key == "flicker":
        return over.flicker[frame - 1] if frame else None
    value: float | None = getattr(over.errors[frame], key)
    return value


def record(request: Request, found: Compared) -> dict[str, Any]:
    """Return what a record has of a path, beside what every comparison has; what is infinite is null."""

    def plain(value: float | None) -> float | None:
        return None if value is None or not math.isfinite(value) else value

    over, count = found.over, len(found.over.errors)
    return {
        "path": request.path,
        "frames": count,
        "worst_frame": over.worst().frame,
        "mean": {key: plain(value) for key, value in over.mean().items()},
        "over_time": {key: [plain(_value(over, frame, key)) for frame in range(count)] for _, key, _ in ROWS},
    }
