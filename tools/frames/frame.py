"""`strata frame N`: one frame pass by pass, with time, work, inputs, outputs, and a picture of every output."""

from __future__ import annotations

import json
import os
import re
import statistics
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image as Bitmap
from PIL import ImageDraw, ImageFont
from rich.console import Console

import chapters
from chapters import studies
from common.errors import UserError
from common.images import write_image
from common.images.frame_pictures import picture_of
from common.names import suggest
from common.paths import write_whole
from common.reports.tables import table
from common.settings import preset
from tools.cli.console import Steps, err, out, say
from tools.cli.stopping import prompt_stop
from tools.frames import page, report
from tools.run import run
from tools.run.record import STDOUT, naming
from tools.run.views import stored_as
from tools.window.stop import nodes_of

if TYPE_CHECKING:
    from backends.contract import Access, Renderer

WARM_UP, MEASURED = 2, 5
"""Frames before those that count, since drivers compile in the first, and how many the median is of."""

CELL = 320
"""Pixels of the longer side of one picture of the contact sheet."""


@dataclass(frozen=True)
class Resource:
    """What a pass reads or writes: an image as it is declared, its size in pixels, and the pass that wrote it."""

    name: str
    use: str
    format: str
    size: tuple[int, int]
    samples: int
    written_by: str


@dataclass(frozen=True)
class Output(Resource):
    """What a pass has written: a file with its picture, and how values became colours."""

    file: str
    mapping: str


@dataclass(frozen=True)
class Step:
    """One pass of the frame; `work` are its counters."""

    number: int
    name: str
    sentence: str
    gpu_ms: float
    work: dict[str, int]
    reads: list[Resource]
    writes: list[Output]


@dataclass(frozen=True)
class Held:
    """An image or a buffer of a frame graph: what it is, and from which pass to which it is alive.

    `names` are what it is called from pass to pass, its own first; `size` is None for a buffer.
    """

    names: list[str]
    life: str
    format: str
    size: tuple[int, int] | None
    samples: int
    bytes: int
    first: str
    last: str


@dataclass
class Frame:
    """All of a frame, as the page and the JSON have it."""

    chapter: int
    title: str
    scene: str
    backend: str
    device: str
    size: tuple[int, int]
    time: float
    settings: dict[str, Any]
    work: dict[str, int]
    cpu_ms: float
    left_out: list[str] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    """Passes that the frame graph leaves out, and why; before there was a graph, this is empty."""
    resources: list[Held] = field(default_factory=list)
    """What the graph's passes write and read, in the order of the first use."""
    steps: list[Step] = field(default_factory=list)
    fork: str | None = None
    """Where the fork is, if one was drawn with; `chapter` is then the one that it is a copy of."""

    @property
    def of(self) -> str:
        """What drew it, in the middle of a sentence."""
        return f"the fork {Path(self.fork).name}" if self.fork else f"chapter {self.chapter}"


def step_through(request: run.Request, after: str | None = None, folder: Path | None = None) -> int:
    """Draw one frame and write what each of its passes did; return the exit code. Raises StrataError."""
    with prompt_stop():
        return _step_through(request, after, folder)


def _step_through(request: run.Request, after: str | None, folder: Path | None) -> int:
    which = chapters.parse_chapter(request.chapter)
    run.check(request)
    target = folder_for(request, folder)
    settings = run.settings_of(request, "medium" if request.quality == "auto" else request.quality)
    with Steps() as steps:
        scene = studies.load(which, request.scene, steps.of("load", 0.05, 0.5), request.environment)  # type: ignore[arg-type]
        run.expose(scene, request)
        run.tell_warnings(scene, request.verbose)
        steps("create", 0.5)
        with chapters.open(
            which,
            request.backend,
            scene=scene,
            size=request.size,
            settings=settings,
            without=request.without,
            validate=request.validate,
            inspect=True,
        ) as renderer:
            last = last_pass(renderer, after)
            steps("draw", 0.7)
            made, pictures = take_apart(which, request, renderer, last)
            steps("write", 0.9)
            write(target, made, pictures)
            messages = run.report_messages(renderer)
        steps.finish()
    if request.json is not None:
        write_json(request.json, made)
    show(made, err if request.json == STDOUT else out)
    say(f"{studies.spoken(which)}, {scene.name}, {made.device}: wrote {target / 'index.html'}")
    return 1 if messages else 0


def folder_for(request: run.Request, folder: Path | None) -> Path:
    """Return the folder to write to; raise UserError where that cannot be."""
    if folder is None:
        picture = run.default_picture(request)
        folder = picture.with_name(f"frame-{picture.stem}")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"--out {folder} is a file: name a folder for the pictures of the frame.")
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        raise UserError(f"--out {folder} cannot be made: nothing can be written to {there}.")
    return folder


def last_pass(renderer: Renderer, after: str | None) -> int:
    """Return how many passes to show; raise UserError if the frame has no pass `after`."""
    names = [made.name for made in nodes_of(renderer)]
    if after is None:
        return len(names)
    if after not in names:
        near = suggest(after, names)
        raise UserError(f"This frame has no pass {after!r}{near}" + ("" if near.endswith("?") else "."))
    return names.index(after) + 1


def take_apart(
    which: chapters.Whole, request: run.Request, renderer: Renderer, count: int
) -> tuple[Frame, dict[str, np.ndarray]]:
    """Return what the first `count` passes of a frame did, and each file's picture (H, W, 3)."""
    view = chapters.view_of(renderer, request.camera, request.time)
    stored = stored_as(renderer.settings)
    timings: list[dict[str, float]] = []
    for _ in range(WARM_UP + MEASURED):
        drawn = renderer.render(view, request.time)
        timings.append({**drawn.timings, "cpu": drawn.cpu_ms})
    measured = timings[WARM_UP:]
    capabilities = renderer.capabilities
    plain = preset(type(renderer.settings), "medium")
    made = Frame(
        **naming(which),
        title=chapters.title_of(which),
        scene=renderer.scene.name,
        backend=capabilities.backend,
        device=f"{capabilities.device} ({capabilities.driver})",
        size=renderer.size,
        time=request.time,
        settings={
            name: value for name, value in asdict(renderer.settings).items() if value != getattr(plain, name)
        },
        work=dict(drawn.work),
        cpu_ms=statistics.median(each["cpu"] for each in measured),
        left_out=[one.name for one in nodes_of(renderer)[count:]],
    )
    graph = getattr(renderer, "graph", None)
    if graph is not None:
        made.skipped, made.resources = dict(graph.left_out), held_by(renderer)
    pictures: dict[str, np.ndarray] = {}
    written: dict[str, tuple[Access, str]] = {}
    drawn_by = list(zip(nodes_of(renderer), renderer.passes, strict=True))[:count]
    for place, (one, draws) in enumerate(drawn_by, start=1):
        reads = [described(access, written.get(access.resource), renderer) for access in one.reads]
        writes = []
        for access in one.writes:
            written[access.resource] = access, one.name
            if f"{one.name}/{access.resource}" not in renderer.inspection.names:
                continue  # a buffer, of which there is no picture
            values = drawn.image(f"{one.name}/{access.resource}")
            known = described(access, (access, one.name), renderer)
            shown, mapping = picture_of(values, access.resource, known.format, view, stored)
            if known.samples > 1:
                of = "one" if access.use == "depth" else "the mean"
                mapping += f"; {of} of {known.samples} samples a pixel"
            file = f"{place}-{one.name}-{access.resource}.png"
            pictures[file] = shown
            writes.append(Output(**asdict(known), file=file, mapping=mapping))
        made.steps.append(
            Step(
                place,
                one.name,
                sentence_of(draws),
                statistics.median(each[one.name] for each in measured),
                dict(renderer.inspection.work.by_pass.get(one.name, {})),  # beside graphics nobody counts
                reads,
                writes,
            )
        )
    return made, pictures


def described(access: Access, written: tuple[Access, str] | None, renderer: Renderer) -> Resource:
    """Return what is known of a resource: a reader leaves format and samples to the pass that wrote it."""
    origin, by = written or (access, "")
    graph = getattr(renderer, "graph", None)
    if graph is not None:  # there the image is that of the first of its names
        image = graph.resources[graph.names[access.resource]]
        size = image.size or (image.bytes, 1)
        return Resource(access.resource, access.use, image.format or image.kind, size, image.samples, by)
    width, height = renderer.size
    scaled = (max(1, round(width * origin.scale)), max(1, round(height * origin.scale)))
    return Resource(access.resource, access.use, origin.format or "", scaled, origin.samples, by)


def held_by(renderer: Renderer) -> list[Held]:
    """Return the images and buffers of a renderer's frame graph."""
    found, graph = [], renderer.graph
    for row in report.rows(graph):
        one = row.resource
        if row.name == one.name:  # else it is what the frame before left of it
            used = sorted(row.signs)
            ends = graph.steps[used[0]].name, graph.steps[used[-1]].name
            taken = report.bytes_of(one)
            found.append(
                Held([*one.names], one.life, one.format or one.kind, one.size, one.samples, taken, *ends)
            )
    return found


def sentence_of(made: Any) -> str:
    """Return the sentence with which the module of a pass says what it is."""
    text = " ".join((sys.modules[type(made).__module__].__doc__ or "").split())
    return re.split(r"(?<=[.])\s", text, maxsplit=1)[0]


def write(folder: Path, made: Frame, pictures: dict[str, np.ndarray]) -> None:
    """Write the pictures, the contact sheet and the page; raise UserError where the disk refuses."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in pictures.items():
            write_image(folder / name, picture)
        write_image(folder / "contact.png", contact_sheet(made, pictures))
        write_whole(folder / "index.html", page.page(made).encode())
    except OSError as error:
        raise UserError(f"--out {folder} cannot be written: {error.strerror or error}.") from None


def contact_sheet(made: Frame, pictures: dict[str, np.ndarray]) -> np.ndarray:
    """Return (H, W, 3): every output small, in the order of the frame, under its pass and name."""
    outputs = [(step, output) for step in made.steps for output in step.writes]
    width, height = made.size
    scale = CELL / max(width, height)
    size = max(1, round(scale * width)), max(1, round(scale * height))
    cell = (CELL, size[1])  # a narrow picture needs room for its title
    columns = min(len(outputs), 3)
    rows = -(-len(outputs) // columns)
    text, gap = 22, 8
    sheet = Bitmap.new(
        "RGB",
        (columns * (cell[0] + gap) + gap, rows * (cell[1] + text + gap) + gap),
        (24, 24, 27),
    )
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for index, (step, output) in enumerate(outputs):
        x = gap + index % columns * (cell[0] + gap)
        y = gap + index // columns * (cell[1] + text + gap)
        title = f"{step.number} {step.name}: {output.name} ({output.format})"
        draw.text((x, y + 2), title, fill=(228, 228, 231), font=font)
        hard = output.format.endswith("ui")  # hues between two ids would be those of others
        small = Bitmap.fromarray(pictures[output.file]).resize(
            size, Bitmap.Resampling.NEAREST if hard else Bitmap.Resampling.BOX
        )
        sheet.paste(small, (x, y + text))
    return np.asarray(sheet)


def write_json(path: Path, made: Frame) -> None:
    """Write all figures, whole or not at all; to `STDOUT`, print them."""
    text = json.dumps(asdict(made), indent=1) + "\n"
    if path == STDOUT:
        sys.stdout.write(text)
        return
    try:
        write_whole(path.absolute(), text.encode())
    except OSError as error:
        raise UserError(f"--json {path} cannot be written: {error.strerror or error}.") from None


def show(made: Frame, to: Console) -> None:
    """Print the passes as a table."""
    columns = ("pass", ">GPU ms", ">draws", ">triangles", "reads", "writes")
    printed = table(f"A frame of {made.of}", *columns)
    for step in made.steps:
        printed.add_row(
            step.name,
            f"{step.gpu_ms:.2f}",
            str(step.work.get("draws", 0)),
            str(step.work.get("triangles", 0)),
            ", ".join(one.name for one in step.reads) or "-",
            ", ".join(f"{one.name} ({one.format})" for one in step.writes),
        )
    to.print(printed)
    if made.skipped:
        skipped = table("Left out", "pass", "why")
        for name, why in made.skipped.items():
            skipped.add_row(name, why)
        to.print(skipped)
