"""The loops of the lessons: frames in flight, the staging ring, a graph that is compiled, cloth, culling, lights."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import chapters
from chapters import scenes
from chapters.ch04.graph.names import connect
from chapters.ch04.graph.order import order
from chapters.ch04.studies.glow import declared
from tools.site import inputs
from tools.site.figures.ch01 import timeline
from tools.site.figures.ch07.fill import FILL
from tools.site.figures.ch07.walk import WALK
from tools.site.figures.ch08.snapping import SNAPPING
from tools.site.figures.ch09.feedback import TURNS
from tools.site.figures.ch10.jitter import JITTER
from tools.site.figures.ch11 import walk as ch11_walk
from tools.site.figures.ch12 import converges as ch12_converges
from tools.site.figures.ch12.visits import VISITS
from tools.site.figures.culling import CULLING
from tools.site.figures.film import SCHEMES, Loop, Picture, animated

HERE = Path(__file__).parent

# --- two frames in flight ---------------------------------------------------------------------------------------------

SLOTS = 2
FLIGHT = 56
"""Frames of the film, over all of the time line."""


def frames_in_flight(c: Picture, number: int) -> None:
    """The time line of two slots up to now, and what each slot is used for."""
    frames = timeline(SLOTS)
    now = frames[-1][4] * number / (FLIGHT - 1)
    left, scale = 100.0, 520 / frames[-1][4]
    for y, words in ((54, "CPU records"), (104, "GPU draws")):
        c.text(12, y, words)
    for frame, (waits, begins, recorded, drawn, end) in enumerate(frames):
        fill = "ab"[frame % SLOTS]
        _until(c, left, scale, (waits, begins), now, 36, "", "paper")
        _until(c, left, scale, (begins, recorded), now, 36, str(frame), fill)
        _until(c, left, scale, (drawn, end), now, 86, str(frame), fill)
    c.line([(left + scale * now, 24), (left + scale * now, 124)], "mark", 2)
    c.text(left + scale * now, 18, "now", 12, "middle", "mark")
    for slot in range(SLOTS):
        words, busy = _use(slot, now)
        c.box(100 + 270 * slot, 146, 250, 34, f"slot {slot}: {words}", "ab"[slot] if busy else "paper")


def _until(
    c: Picture,
    left: float,
    scale: float,
    span: tuple[float, float],
    now: float,
    y: float,
    label: str,
    fill: str,
) -> None:
    """Draw a box over a span of time, as far as it has come."""
    begin, end = span[0], min(span[1], now)
    if end > begin:
        wide = scale * (end - begin)
        c.box(left + scale * begin, y, wide, 26, label if wide > 14 else "", fill, dashed=fill == "paper")


def _use(slot: int, now: float) -> tuple[str, bool]:
    """Return what a slot is used for at a time, and whether the GPU or the CPU has it."""
    for frame, (waits, begins, recorded, _, end) in enumerate(timeline(SLOTS)):
        if frame % SLOTS == slot:
            if begins <= now < recorded:
                return f"the CPU records frame {frame}", True
            if recorded <= now < end:
                return f"the GPU has frame {frame}", True
        elif waits <= now < begins:
            continue
    return "free", False


# --- the staging ring -------------------------------------------------------------------------------------------------

UNITS = 16
COPY = 5
"""Frames of the film that the GPU takes for an upload."""
RING_FRAMES = 64


@dataclass(frozen=True)
class Moment:
    """The ring at a moment: (upload, first unit, units, whether its copy has ended) of each range, and who waits."""

    ranges: tuple[tuple[int, int, int, bool], ...]
    head: int
    tail: int
    waits: int | None


@cache
def ring() -> tuple[Moment, ...]:
    """Return the ring over time: an upload every second frame, copies one after the other, the tail behind them."""
    sizes = [3, 5, 3, 4, 2, 6, 3, 3, 5, 4, 2, 3]
    held: deque[tuple[int, int, int, float]] = deque()
    next_, head, free_at, found = 0, 0, 0.0, []
    for now in range(RING_FRAMES):
        while held and held[0][3] <= now - 1:
            held.popleft()
        waits = None
        if now % 2 == 0 and next_ < len(sizes) * 9:
            size = sizes[next_ % len(sizes)]
            first = head if head + size <= UNITS else 0
            if _fits(held, first, size, head):
                free_at = max(free_at, now) + COPY * size / 4
                held.append((next_, first, size, free_at))
                head, next_ = first + size, next_ + 1
            else:
                waits = next_
        tail = held[0][1] if held else head
        found.append(Moment(tuple((i, f, n, end <= now) for i, f, n, end in held), head, tail, waits))
    return tuple(found)


def _fits(held: deque[tuple[int, int, int, float]], first: int, size: int, head: int) -> bool:
    """Whether a range is free: it overlaps no other, and does not pass the oldest one when it begins at 0 again."""
    wraps = first < head
    skipped = [(head, UNITS - head)] if wraps else []
    return all(
        f >= at + count or f + n <= at
        for _, f, n, _ in held
        for at, count in ((first, size), *skipped)
        if count
    )


def staging_ring(c: Picture, number: int) -> None:
    """The ring as a circle: ranges in use, head and tail."""
    moment = ring()[number]
    x, y, inner, outer = 150.0, 130.0, 50.0, 92.0
    for unit in range(UNITS):
        c.polygon(_sector(x, y, inner, outer, unit, 1), "paper", "line")
    for upload, first, count, ended in moment.ranges:
        c.polygon(_sector(x, y, inner, outer, first, count), "b" if ended else "a", "line")
        a = 2 * math.pi * (first + count / 2) / UNITS
        c.text(x + 71 * math.sin(a), y - 71 * math.cos(a) + 5, str(upload), 13, "middle")
    for unit, words, side in ((moment.head, "head", -0.08), (moment.tail, "tail", 0.08)):
        a = 2 * math.pi * unit / UNITS + side
        places = [(x + r * math.sin(a), y - r * math.cos(a)) for r in (106.0, outer - 2)]
        c.line(places, "mark", 2, arrow=True)
        a += 1.4 * side
        c.text(x + 120 * math.sin(a), y - 116 * math.cos(a) + 4, words, 11, "middle", "mark")
    c.note(300, 60, "blue: the GPU still copies this upload")
    c.note(300, 84, "yellow: its copy has ended, the tail may follow")
    c.note(300, 108, "white: free, from the head to the tail")
    if moment.waits is not None:
        c.note(300, 150, f"upload {moment.waits} finds no room and waits", "mark")


def _sector(
    x: float, y: float, inner: float, outer: float, first: int, count: int
) -> list[tuple[float, float]]:
    """Return the corners of a part of a ring, clockwise from the top."""
    a, b = (2 * math.pi * unit / UNITS for unit in (first, first + count))
    angles = np.linspace(a, b, 4 * count + 1).tolist()
    around = [(x + outer * math.sin(v), y - outer * math.cos(v)) for v in angles]
    return around + [(x + inner * math.sin(v), y - inner * math.cos(v)) for v in reversed(angles)]


# --- a graph that is compiled -----------------------------------------------------------------------------------------

STEPS = ("declared in any order", "edges from names", "left out: no pass reads it", "in order", "barriers")
HOLD, MOVE = 10, 12
"""Frames of the film that show a step, and in which the passes move to their places."""
SEED = 3


@cache
def compiled() -> tuple[list[str], list[str], tuple[Any, ...]]:
    """Return the passes of the study names as declared and as ordered, and the edges between the ordered ones."""
    nodes = declared(SEED)
    wiring = connect(nodes, {}, {})
    names = [node.name for node in wiring.nodes]
    ordered = order(names, wiring.edges, {name: {} for name in names})
    return [node.name for node in nodes], ordered, tuple(wiring.edges)


def graph_compiles(c: Picture, number: int) -> None:
    """Passes as they were declared; then their edges, the pass that is left out, the order, and the barriers."""
    first, ordered, edges = compiled()
    at = (number - 3 * HOLD) / MOVE
    step = min(number // HOLD, 2) if at < 0 else 3 if number < 4 * HOLD + MOVE else 4
    c.text(12, 24, f"{step + 1}. {STEPS[step]}", 14, bold=True)
    begin = {name: (14.0 + 106 * place, 110.0 + 56 * (place % 2)) for place, name in enumerate(first)}
    end = {name: (14.0 + 118 * place, 130.0) for place, name in enumerate(ordered)}
    part = min(max(at, 0.0), 1.0)
    part = part * part * (3 - 2 * part)
    where: dict[str, tuple[float, float]] = {}
    for name in first:
        (x0, y0), (x1, y1) = begin[name], end.get(name, begin[name])
        where[name] = (x0 + part * (x1 - x0), y0 + part * (y1 - y0))
    if step >= 1:
        for edge in edges:
            (x0, y0), (x1, y1) = where[edge.before], where[edge.after]
            _edge(c, (x0 + 46, y0), (x1 + 46, y1), step >= 4)
    for name in first:
        out = name not in end
        if out and step >= 3:
            continue
        c.box(*where[name], 92, 36, name, "card" if out and step >= 2 else "a", dashed=out and step >= 2)
    if step >= 4:
        c.note(12, 200, "red: the pass waits for the pass that wrote what it reads", "mark")


def _edge(c: Picture, start: tuple[float, float], end: tuple[float, float], barrier: bool) -> None:
    """Draw an edge as an arc over the passes."""
    (x0, y0), (x1, y1) = start, end
    t = np.linspace(0, 1, 17)
    top = min(y0, y1) - 16 - 0.16 * abs(x1 - x0)
    x = (1 - t) ** 2 * x0 + 2 * t * (1 - t) * (x0 + x1) / 2 + t * t * x1
    y = (1 - t) ** 2 * y0 + 2 * t * (1 - t) * top + t * t * y1
    c.line(list(zip(x.tolist(), y.tolist(), strict=True)), "line", 1.5, arrow=True)
    if barrier:
        c.line([(x1 - 52, y1 - 2), (x1 - 52, y1 + 38)], "mark", 4)


# --- cloth ------------------------------------------------------------------------------------------------------------

CLOTH_SIZE, CLOTH_FRAMES, CLOTH_RATE = (400, 225), 36, 12.0


def cloth() -> bytes:
    """Return the film of chapter 5's cloth: its scene from the beginning, with wind."""
    scene = scenes.load("cloth")
    frames = []
    settings = chapters.settings_class(5)(wind_speed=4.0)
    with chapters.open(5, scene=scene, size=CLOTH_SIZE, settings=settings) as renderer:
        for number in range(CLOTH_FRAMES):
            time = number / CLOTH_RATE
            pixels = renderer.render(chapters.view_of(renderer, None, time), time).image("color")
            frames.append(Image.fromarray(np.ascontiguousarray(pixels[..., :3])))
    return animated(frames, CLOTH_RATE, quality=60)


# --- all --------------------------------------------------------------------------------------------------------------

LOOPS: Mapping[str, Loop] = {
    "ch01-frames-in-flight-loop": Loop(
        "Two slots over time: while the GPU draws the frame of one, the CPU records into the other",
        "ch01-frames-in-flight.svg",
        (640, 196),
        FLIGHT,
        frames_in_flight,
    ),
    "ch03-staging-ring-loop": Loop(
        "The staging ring over time: uploads take ranges at its head, and its tail follows the copies that have ended",
        "ch03-staging-ring.svg",
        (640, 260),
        RING_FRAMES,
        staging_ring,
        6.0,
    ),
    "ch04-graph-compiles-loop": Loop(
        "A graph as it is compiled: edges from names, passes that are left out, the order, and the barriers",
        "ch04-names-and-edges.svg",
        (760, 214),
        5 * HOLD + MOVE + 10,
        graph_compiles,
    ),
    **CULLING,
    **WALK,
    **FILL,
    **SNAPPING,
    **TURNS,
    **JITTER,
    **VISITS,
}
"""The loops that are drawn; their stills are figures of the lessons."""
CLOTH = Loop(
    "A flag of cloth in the wind", "cloth.png", CLOTH_SIZE, CLOTH_FRAMES, lambda c, n: None, CLOTH_RATE
)
"""What a README says of the cloth's film, which has one file for both schemes."""
RENDERED = {
    "ch05-cloth-loop": CLOTH,
    "ch11-walk-loop": ch11_walk.WALK,
    "ch12-converges-loop": ch12_converges.CONVERGES,
}
"""The loops that a renderer draws, each with one file."""


def files() -> dict[str, tuple[Callable[[], bytes], list[Path]]]:
    """Return what makes each file of docs/pictures, and the files that it is made from."""
    mine = [HERE / name for name in ("canvas.py", "film.py", "loops.py")]
    lists = [HERE / "ch07" / "lights.py", chapters.folder_of(7) / "clusters" / "model.py"]
    sun = [HERE / "ch08" / "cascades.py", chapters.folder_of(8) / "shadows" / "cascades.py"]
    tree = [chapters.folder_of(12) / "rays" / "bvh" / "build.py"]
    more = {
        "ch01-frames-in-flight-loop": [HERE / "ch01.py"],
        "ch03-staging-ring-loop": [],
        "ch04-graph-compiles-loop": [*inputs.chapter(4), *inputs.study(4, "glow")],
        **{name: [HERE / "culling.py"] for name in CULLING},
        **{name: [*lists, HERE / "ch07" / "walk.py"] for name in WALK},
        **{name: [HERE / "ch07" / "layers.py", HERE / "ch07" / "fill.py"] for name in FILL},
        **{name: [*sun, HERE / "ch08" / "snapping.py"] for name in SNAPPING},
        **{name: [HERE / "ch09" / "feedback.py"] for name in TURNS},
        **{name: [HERE / "ch10" / "jitter.py"] for name in JITTER},
        **{name: [*tree, HERE / "ch12" / "walk.py", HERE / "ch12" / "visits.py"] for name in VISITS},
    }
    found: dict[str, tuple[Callable[[], bytes], list[Path]]] = {}
    for name, loop in LOOPS.items():
        for end, colors in SCHEMES.items():
            found[f"{name}{end}.webp"] = (partial(loop.file, colors), [*mine, *more[name]])
    found["ch05-cloth-loop.webp"] = (cloth, [*mine, *inputs.chapter(5), *inputs.scene("cloth")])
    along = [HERE / "film.py", HERE / "ch11" / "walk.py"]
    drawn = [*inputs.chapter(ch11_walk.CHAPTER), *inputs.scene(ch11_walk.SCENE)]
    found["ch11-walk-loop.webp"] = (ch11_walk.walk, [*along, *drawn])
    box = [*inputs.chapter(ch12_converges.CHAPTER), *inputs.scene(ch12_converges.SCENE)]
    made = [HERE / "film.py", HERE / "ch12" / "converges.py"]
    found["ch12-converges-loop.webp"] = (ch12_converges.converges, [*made, *box])
    return found
