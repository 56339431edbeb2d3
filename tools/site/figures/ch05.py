"""Figures of chapter 5: a counter instead of fences, two queues, the springs of a cloth, three ways to run a kernel."""

from __future__ import annotations

import numpy as np

from chapters.ch05.cloth.build import build_cloth
from chapters.ch05.cloth.types import KINDS as SPRINGS

from .canvas import Canvas
from .ch01 import timeline as one_queue
from .graphs import cloth_frame

FRAMES = 4
CPU_MS, COMPUTE_MS, GRAPHICS_MS = 2.0, 3.0, 5.0
SLOTS = 2


def timelines() -> list[tuple[float, float, float, float]]:
    """Return of each frame when the CPU begins to record, compute begins, graphics begins and graphics ends, in ms.

    The CPU waits for the frame two before. Compute waits for nothing else on the GPU, graphics for compute.
    """
    found: list[tuple[float, float, float, float]] = []
    compute_free = graphics_free = cpu_free = 0.0
    for number in range(FRAMES):
        begins = max(cpu_free, found[number - SLOTS][3] if number >= SLOTS else 0.0)
        cpu_free = begins + CPU_MS
        compute = max(cpu_free, compute_free)
        compute_free = compute + COMPUTE_MS
        graphics = max(compute_free, graphics_free)
        graphics_free = graphics + GRAPHICS_MS
        found.append((begins, compute, graphics, graphics_free))
    return found


def counter() -> Canvas:
    """The value of a timeline over time: submissions raise it, and the CPU waits until it has reached a number."""
    c = Canvas(
        760, 280, "A timeline semaphore: a number that rises as frames end, and the waits of the CPU for it"
    )
    frames = one_queue(SLOTS)
    left, scale = 110, 630 / frames[-1][4]
    c.text(12, 56, "CPU records")
    c.text(12, 106, "GPU draws")
    c.text(12, 180, "timeline")
    for number, (_, begins, recorded, drawn, ends) in enumerate(frames):
        fill = "ab"[number % SLOTS]
        c.box(left + scale * begins, 40, scale * (recorded - begins), 26, str(number), fill)
        c.box(left + scale * drawn, 90, scale * (ends - drawn), 26, f"frame {number}", fill, 12)
        start = frames[number - 1][4] if number else 0.0
        low = 228 - 18 * number
        c.line(
            [(left + scale * start, low), (left + scale * ends, low), (left + scale * ends, low - 18)],
            "ink",
            2,
        )
        c.text(left + scale * (start + ends) / 2, low - 5, f"value {number}", 12, "middle", "soft")
        if number >= SLOTS:
            x = left + scale * begins
            c.arrow(x, 228 - 18 * (number - 1), x, 66, "mark")
    c.note(
        12, 252, "red: before frame n the CPU waits until the value is n - 1: frame n - 2 has ended", "mark"
    )
    c.note(12, 270, "Any number of waits can ask for any value, and nothing has to be reset.")
    return c


def two_queues() -> Canvas:
    """Frames on two queues: the compute batch of a frame runs beside the graphics batch of the frame before."""
    c = Canvas(760, 300, "Frames on a compute queue and a graphics queue, each with its timeline")
    graph, frames = cloth_frame(), timelines()
    names = {
        batch.queue: ", ".join(graph.steps[step].name for step in batch.steps[:3]) for batch in graph.batches
    }
    left, scale = 130, 600 / frames[-1][3]
    for y, queue in ((60, "compute"), (150, "graphics")):
        c.text(12, y + 18, f"{queue} queue", bold=True)
        c.text(12, y + 44, names.get(queue, ""), 11, role="soft")
        c.line([(left, y + 34), (745, y + 34)], "card", 1)
    for number, (_, compute, graphics, ends) in enumerate(frames):
        fill = "ab"[number % SLOTS]
        c.box(left + scale * compute, 60, scale * COMPUTE_MS, 28, f"frame {number}", fill, 12)
        c.box(left + scale * graphics, 150, scale * GRAPHICS_MS, 28, f"frame {number}", fill, 12)
        x0, x1 = left + scale * (compute + COMPUTE_MS), left + scale * graphics
        c.text(x0, 108, f"c = {number + 1}", 11, "middle", "soft")
        c.text(left + scale * ends, 198, f"g = {number + 1}", 11, "middle", "soft")
        c.line([(x0, 114), (x0, 132), (x1 + 3, 132), (x1 + 3, 150)], "mark", arrow=True)
    c.arrow(left, 214, 745, 214)
    c.text(745, 230, "time", 12, "end", "soft")
    c.note(12, 252, "red: graphics of frame n waits until compute's timeline c is n + 1", "mark")
    c.note(12, 270, "Each batch raises the timeline of its own queue when it ends. Compute of the next frame")
    c.note(12, 286, "does not wait for graphics: it writes the buffers of the other slot.")
    return c


def springs() -> Canvas:
    """A grid of particles with all springs, and the twelve of one particle by kind."""
    columns, grid_rows, step = 7, 6, 52
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(grid_rows, dtype=float))
    positions = np.stack([x.ravel(), -y.ravel(), np.zeros(x.size)], axis=-1)
    corner = np.array([r * columns + k for r in range(grid_rows - 1) for k in range(columns - 1)])
    triangles = np.concatenate(
        [
            np.stack([corner, corner + columns, corner + 1], -1),
            np.stack([corner + 1, corner + columns, corner + columns + 1], -1),
        ]
    )
    cloth = build_cloth(positions, triangles, {"columns": columns, "rows": grid_rows})
    c = Canvas(680, 330, "A cloth as particles and springs: stretch, shear and bend")
    at = [(30 + step * px, 36 - step * py) for px, py, _ in cloth.positions]
    middle = 2 * columns + 3
    roles = {"stretch": "c", "shear": "a", "bend": "mark"}
    for a, b in cloth.springs:
        c.line([at[a], at[b]], "card", 1.5)
    count = dict.fromkeys(SPRINGS, 0)
    for (a, b), kind in zip(cloth.springs, cloth.kinds, strict=True):
        if middle in (a, b):
            name = SPRINGS[kind]
            count[name] += 1
            (x0, y0), (x1, y1) = at[a], at[b]
            if name == "bend":  # beside the stretch springs that it covers
                shift = 7 if x0 == x1 else 0
                c.line([(x0 + shift, y0 + 7 - shift), (x1 + shift, y1 + 7 - shift)], "mark", 2, dashed=True)
            else:
                c.line([(x0, y0), (x1, y1)], "ink" if name == "stretch" else "line", 3)
    for number, (px, py) in enumerate(at):
        c.circle(px, py, 6 if number == middle else 4, "f" if number == middle else "paper", "ink")
    for number, (name, words) in enumerate(
        (("stretch", "along the threads"), ("shear", "across the meshes"), ("bend", "two particles away"))
    ):
        y0 = 70 + 60 * number
        role = {"stretch": "ink", "shear": "line", "bend": "mark"}[name]
        c.line([(400, y0), (440, y0)], role, 3 if name != "bend" else 2, dashed=name == "bend")
        c.text(452, y0 + 5, f"{name}: {count[name]}, {words}", 13)
    assert roles.keys() == set(SPRINGS)
    c.text(400, 262, f"springs of the cloth: {len(cloth.springs)}", 13, role="soft")
    c.text(400, 282, "The marked particle has twelve.", 13, role="soft")
    return c


def three_ways() -> Canvas:
    """One kernel in three ways: a thread for a cloth, a work group for a cloth, a thread for a particle."""
    c = Canvas(760, 300, "One kernel in three ways, and what waits between two substeps")
    for number, (name, words, wait) in enumerate(
        (
            ("thread", "a thread for each cloth", "no wait is needed"),
            ("group", "a work group for each cloth", "barrier() in the shader"),
            ("dispatch", "a thread for each particle", "a pipeline barrier"),
        )
    ):
        x = 14 + 250 * number
        c.text(x, 26, name, bold=True)
        c.note(x, 46, words)
        for substep in range(2):
            y = 62 + 98 * substep
            if name == "dispatch":
                c.box(x, y, 226, 58, "", "paper", dashed=True)
                c.text(x + 6, y + 52, f"dispatch {substep}", 11, role="soft")
            elif substep == 0:
                c.box(x, y, 226, 156, "", "paper", dashed=True)
                c.text(x + 6, y + 150, "one dispatch", 11, role="soft")
            for i in range(2):
                for k in range(6):
                    left = x + 14 + 106 * i + 16 * k
                    if name == "thread":
                        c.box(left, y + 8, 14, 22, "", "ab"[i], round=1)
                    else:
                        c.box(left, y + 8, 14, 22, "", "ab"[i], round=6)
                if name == "thread":
                    c.arrow(x + 14 + 106 * i, y + 38, x + 108 + 106 * i, y + 38, "ink")
                if name == "group" and substep == 0:
                    c.line([(x + 12 + 106 * i, y + 48), (x + 110 + 106 * i, y + 48)], "mark", 3)
            if name == "dispatch" and substep == 0:
                c.line([(x, y + 78), (x + 226, y + 78)], "mark", 3)
        c.text(x, 246, wait, 12, role="mark" if name != "thread" else "soft")
    c.text(
        14,
        272,
        "colours: two cloths; round: particles that run at the same time; square: one after the other",
        12,
        role="soft",
    )
    c.note(14, 290, "rows: two substeps. All three ways give the same bits.")
    return c


FIGURES = {
    "ch05-counter": counter,
    "ch05-two-queues": two_queues,
    "ch05-springs": springs,
    "ch05-three-ways": three_ways,
}
