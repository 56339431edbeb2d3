"""`strata compare A B`: two pictures of the same moment, the map of their difference, and time, error and work.

B is held against A: errors are those of B, with A as the truth, and ratios are B : A.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backends.contract import check_time
from chapters import studies
from common import images
from common.errors import UserError
from common.images.color import quantize
from common.names import suggest
from common.paths import write_whole
from common.scene import Scene
from tools.cli.console import Steps, err, out, say
from tools.cli.stopping import prompt_stop
from tools.compare import along, report
from tools.compare.measure import FRAMES, ROUNDS, WARM_UP, Moment, errors, exposure_of, measure
from tools.compare.sheet import Panel, heat, sheet
from tools.compare.sides import Drawn, Picture, Side, comparable, read_side
from tools.run import recording
from tools.run import run as running
from tools.run.record import STDOUT

DEFAULT_SIZE = (640, 360)
QUALITIES = tuple(name for name in running.QUALITIES if name != "auto")
MAPS = ("auto", "flip", "difference")


@dataclass(frozen=True)
class Request:
    """What the user asked for. `size` None: that of a file among the two, else 640x360.

    `scene` None: what `load_scene` chooses.
    """

    a: str
    b: str
    scene: str | None = None
    environment: str = "none"
    camera: str | None = None
    path: str | None = None  # a name or a file of `common.view.paths`
    ev100: float | None = None
    size: tuple[int, int] | None = None
    time: float = 0.0
    frames: int | None = None
    fps: float = 60.0
    quality: str = "medium"
    without: tuple[str, ...] = ()
    map: str = "auto"
    out: Path | None = None
    json: Path | None = None
    verbose: bool = False


def check(request: Request) -> None:
    """Raise UserError for what is wrong with a request apart from its two sides."""
    for what, given, known in (("quality", request.quality, QUALITIES), ("map", request.map, MAPS)):
        if given not in known:
            near = suggest(given, known)
            raise UserError(f"There is no {what} {given!r}{near}{'' if near.endswith('?') else '.'}")
    if request.frames is not None and request.frames < 1:
        raise UserError(f"--frames {request.frames} draws nothing: it must be at least 1.")
    check_time(request.time, "--time")
    if not (math.isfinite(request.fps) and request.fps > 0):
        raise UserError(f"--fps {request.fps} is no rate: give frames per second above 0.")
    if request.frames is not None:
        count = min(request.frames, 10**18)  # a float holds that; nobody waits for so many
        timed = WARM_UP + ROUNDS * FRAMES  # the clock runs on while times are taken
        check_time(request.time + (count + timed) / request.fps, "With --frames and --fps the last --time")
    if request.ev100 is not None and not -60.0 <= request.ev100 <= 60.0:
        raise UserError(
            f"--ev {request.ev100} is no exposure: give EV100 between -60 and 60; daylight is about 15."
        )
    target = request.out
    if request.path is not None:
        along.check(request)
    if target is not None:
        if target.suffix.lower() in (".exr", ".hdr"):
            raise UserError(f"--out {target}: the pictures and the map go to a .png.")
        images.check_writable(target, images.WRITABLE if request.path is None else (".png", *along.FILMS))
    made = request.json if request.json != STDOUT else None
    if made is not None and (made.is_dir() or not made.absolute().parent.is_dir()):
        raise UserError(f"--json {made} cannot be written: name a file in a folder that exists.")
    written = [path.resolve() for path in (target, made) if path is not None]
    if len(set(written)) < len(written):
        raise UserError(f"--out and --json both name {target}: the picture and the record are two files.")
    read = {Path(text).expanduser().resolve() for text in (request.a, request.b)}
    if any(path in read and path.is_file() for path in written):
        raise UserError("--out and --json must not name a picture that is compared: it would be lost.")


def run(request: Request) -> int:
    """Compare, write the sheet and the record, print the table; return the exit code. Raises StrataError."""
    with prompt_stop():
        return _run(request)


def _run(request: Request) -> int:
    check(request)
    target = request.out or default_picture(request)
    texts = request.a, request.b
    a, b = (read_side(text, request.quality, request.without) for text in texts)
    comparable(a, b)
    size = size_of(a, b, request.size)
    if request.path is not None:
        along.check_sides(request, (a, b), size)
        return _along(request, (a, b), size, target)
    moment = Moment(request.camera, request.time, request.frames, request.fps)
    with Steps() as steps:
        scene = load_scene((a, b), request, steps.of("load", 0.05, 0.3))
        if scene is not None:
            running.expose(scene, running.Request(0, ev100=request.ev100))
            running.tell_warnings(scene, request.verbose)
            told = len(scene.warnings)
        first, second = measure((a, b), scene, size, moment, steps)
        if scene is not None:
            running.tell_warnings(scene, request.verbose, told)  # of what was found while it was drawn
        steps("errors", 1.0)
        exposed = exposure_of(first, second, request.ev100)
        found, error_map, shown = errors(first, second, exposed, request.map)
    differ = report.differences(first, second)
    titles = [f"{name}   {side.text}" for name, side in (("A", a), ("B", b))]
    panels = [
        Panel(title, report.capital(report.described(side)), quantize(pixels))  # type: ignore[arg-type]
        for title, side, pixels in zip(titles, (a, b), shown, strict=True)
    ]
    panels.append(
        Panel("Error of B against A", report.map_text(error_map), heat(error_map.values, error_map.limit))
    )
    drawn = None if scene is None else scene.name if request.scene is None else request.scene
    where = "" if drawn is None else f"{drawn}, "
    foot = [differ, f"{where}{size[0]}x{size[1]}. {report.verdict(found)}"]
    if found.of == "linear":
        foot.append(f"Shown is linear light times {exposed:.4g}, without a tone curve.")
    picture = sheet(panels, error_map.limit, error_map.more, foot)
    if request.out is None:
        target.parent.mkdir(exist_ok=True)
    images.write_image(target, picture)
    if request.json is not None:
        write_record(request, report.record(request, drawn, first, second, found, differ, size, target))
    for side in (a, b):
        if isinstance(side, Picture) and side.note:
            say(f"strata: {side.note}")
    to = err if request.json == STDOUT else out
    to.print(differ, soft_wrap=True, markup=False)
    to.print(report.figures_table(f"{where}{size[0]}x{size[1]}", first, second, found))
    to.print(report.verdict(found), soft_wrap=True, markup=False)
    say(f"Wrote {target}")
    return 0


def _along(request: Request, sides: tuple[Side, Side], size: tuple[int, int], target: Path) -> int:
    """Compare two sides along a path."""
    with Steps() as steps:
        scene = load_scene(sides, request, steps.of("load", 0.05, 0.3))
        assert scene is not None  # both sides are drawn
        running.expose(scene, running.Request(0, ev100=request.ev100))
        running.tell_warnings(scene, request.verbose)
        if request.out is None:
            target.parent.mkdir(exist_ok=True)
        found = along.compare(request, sides, scene, size, target, steps)
    first, second = found.sides
    differ = report.differences(first, second)
    drawn = scene.name if request.scene is None else request.scene
    if request.json is not None:
        error = errors(first, second, exposure_of(first, second, request.ev100), request.map)[0]
        made = report.record(request, drawn, first, second, error, differ, size, target)
        write_record(request, {**made, **along.record(request, found)})
    to = err if request.json == STDOUT else out
    to.print(differ, soft_wrap=True, markup=False)
    to.print(along.figures_table(f"{drawn}, {size[0]}x{size[1]}, {request.path}", found))
    to.print(along.times_table(found))
    say(f"Wrote {target}" if target.suffix.lower() in along.FILMS else f"Wrote {target}, the worst frame")
    return 0


def load_scene(sides: tuple[Side, Side], request: Request, progress: Any = None) -> Scene | None:
    """Return what both sides draw: the scene asked for, else a chapter's, else a study's own; None for two files."""

    def needs(side: Drawn) -> int:
        if not isinstance(side.which, str):
            return 2
        return 1 if studies.study(side.which).scene is not None else 0

    drawn = [side for side in sides if isinstance(side, Drawn)]
    if not drawn:
        return None
    most = max(drawn, key=needs)
    return studies.load(most.which, request.scene, progress, request.environment)


def default_picture(request: Request) -> Path:
    """Return where the sheet goes for which no place was named: out/compare-A-B.png below the current folder."""
    folder = Path("out")
    if not os.access(folder if folder.is_dir() else Path.cwd(), os.W_OK) or (
        folder.exists() and not folder.is_dir()
    ):
        raise UserError(f"Nothing can be written to {folder.absolute()}: say --out FILE.png.")
    names = [
        re.sub(r"[^\w.@=,+-]+", "-", Path(text).stem if Path(text).suffix in images.READABLE else text)
        for text in (request.a, request.b)
    ]
    moved = "" if request.path is None else f"-{recording.file_name(request.path)}"
    return folder / f"compare-{names[0][:80]}-{names[1][:80]}{moved}.png"


def size_of(a: Side, b: Side, wanted: tuple[int, int] | None) -> tuple[int, int]:
    """Return the size of both pictures; raise UserError where they cannot have the same."""
    files = [side for side in (a, b) if isinstance(side, Picture)]
    sizes = [side.size for side in files]
    if len(set(sizes)) > 1:
        (w, h), (u, v) = sizes
        raise UserError(
            f"{files[0].text} is {w}x{h} and {files[1].text} is {u}x{v}: pictures to compare must have one size."
        )
    if sizes and wanted is not None and wanted != sizes[0]:
        raise UserError(
            f"--size {wanted[0]}x{wanted[1]} differs from {files[0].text}, which is {sizes[0][0]}x{sizes[0][1]}: "
            "leave --size out."
        )
    return sizes[0] if sizes else wanted or DEFAULT_SIZE


def write_record(request: Request, made: dict[str, Any]) -> None:
    """Write the record, whole or not at all; to `STDOUT`, print it."""
    assert request.json is not None
    text = json.dumps(made, indent=1) + "\n"
    if request.json == STDOUT:
        sys.stdout.write(text)
        return
    try:
        write_whole(request.json.absolute(), text.encode())
    except OSError as error:
        raise UserError(f"--json {request.json} cannot be written: {error.strerror or error}.") from None
