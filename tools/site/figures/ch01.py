"""Figures of chapter 1: frames in flight, sorted draws, the vectors and tables of shading, samples of a pixel."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from .canvas import Canvas

FRAMES = 5
CPU_MS, GPU_MS = 3.0, 5.0
"""Milliseconds that the CPU records and the GPU draws, in the figure of frames in flight."""


def timeline(slots: int) -> list[tuple[float, float, float, float, float]]:
    """Return for each frame when the CPU begins to wait, to record and has recorded, and when the GPU begins and ends.

    The CPU records a frame in a slot once the GPU has drawn the frame that used the slot before.
    """
    frames: list[tuple[float, float, float, float, float]] = []
    for number in range(FRAMES):
        waits = frames[-1][2] if frames else 0.0
        begins = max(waits, frames[number - slots][4] if number >= slots else 0.0)
        recorded = begins + CPU_MS
        drawn = max(recorded, frames[-1][4] if frames else 0.0)
        frames.append((waits, begins, recorded, drawn, drawn + GPU_MS))
    return frames


def frames_in_flight() -> Canvas:
    """One slot against two: while the GPU draws a frame, the CPU records the next one."""
    c = Canvas(760, 330, "CPU and GPU over time with one frame slot and with two")
    scale, left = 640 / timeline(1)[-1][4], 100
    for top, slots in ((40, 1), (190, 2)):
        c.text(12, top - 14, f"{slots} slot{'s' * (slots > 1)}", bold=True)
        c.text(12, top + 22, "CPU records")
        c.text(12, top + 82, "GPU draws")
        for number, (waits, begins, recorded, drawn, end) in enumerate(timeline(slots)):
            fill = "ab"[number % slots]
            if begins > waits:
                x, wide = left + scale * waits, scale * (begins - waits)
                c.box(x, top + 6, wide, 24, "fence" if wide > 40 else "", "paper", 11, dashed=True)
                before = timeline(slots)[number - slots][4]
                c.line(
                    [(left + scale * before, top + 66), (left + scale * before, top + 30)], "mark", arrow=True
                )
            c.box(left + scale * begins, top + 6, scale * (recorded - begins), 24, str(number), fill)
            c.box(left + scale * drawn, top + 66, scale * (end - drawn), 24, str(number), fill)
        c.arrow(left, top + 104, 745, top + 104)
    c.text(745, 314, "time", 12, "end", "soft")
    c.note(left, 314, "red: the fence of a slot tells the CPU that the slot is free", "mark")
    return c


def sorted_draws() -> Canvas:
    """The same draws in the order of the file and sorted by state: how often something has to be bound."""
    c = Canvas(760, 220, "Draws in the order of the file and sorted by pipeline and material")
    rng = np.random.default_rng(3)
    draws = [(int(rng.integers(2)), int(rng.integers(3)), number) for number in range(14)]
    for top, title, listed in ((56, "order of the file", draws), (150, "sorted", sorted(draws))):
        pipelines = 1 + sum(a[0] != b[0] for a, b in pairwise(listed))
        materials = 1 + sum(a[:2] != b[:2] for a, b in pairwise(listed))
        c.text(12, top - 18, f"{title}: {pipelines} pipeline binds, {materials} material binds", bold=True)
        for place, (pipeline, material, number) in enumerate(listed):
            x = 12 + 52 * place
            c.box(x, top, 46, 34, str(number), "abc"[material], round=14 if pipeline else 2)
            before = listed[place - 1] if place else (-1, -1, -1)
            if (pipeline, material) != before[:2]:
                c.line([(x - 3, top - 4), (x - 3, top + 38)], "mark", 2.5)
    c.note(12, 208, "colour: material, shape: pipeline, red line: something is bound")
    return c


def brdf_vectors() -> Canvas:
    """The unit vectors of shading at a surface point: normal, view, light and the half vector between them."""
    c = Canvas(560, 310, "Normal, view, light and half vector at a point of a surface")
    x, y, long = 280, 250, 190
    c.polygon([(40, y), (520, y), (520, y + 26), (40, y + 26)], "card")
    c.note(48, y + 18, "surface")
    view, light = math.radians(48), math.radians(-30)
    half = (view + light) / 2
    ends = {}
    for name, angle, role in (
        ("n", 0.0, "ink"),
        ("v", view, "ink"),
        ("l", light, "ink"),
        ("h", half, "mark"),
    ):
        end = (x - long * math.sin(angle), y - long * math.cos(angle))
        ends[name] = end
        c.arrow(x, y, *end, role=role)
    for name, words, dx, anchor in (
        ("n", "n, normal", 8, "start"),
        ("v", "v, to the eye", -8, "end"),
        ("l", "l, to the light", 10, "start"),
        ("h", "h = (l + v) / |l + v|", -8, "end"),
    ):
        c.text(ends[name][0] + dx, ends[name][1] - 4, words, 13, anchor, "mark" if name == "h" else "ink")
    for radius, angle, words in ((70, view, "n·v"), (100, light, "n·l"), (130, half, "n·h")):
        steps = [angle * i / 20 for i in range(21)]
        c.line([(x - radius * math.sin(a), y - radius * math.cos(a)) for a in steps], "soft", 1)
        middle = angle * (0.75 if words != "n·h" else 0.5)
        c.text(
            x - (radius + 12) * math.sin(middle),
            y - (radius + 12) * math.cos(middle) + 4,
            words,
            12,
            "middle",
            "soft",
        )
    return c


def directional_albedo(cos_v: float, roughness: float, count: int = 256) -> tuple[float, float]:
    """Return scale and bias of F0 for GGX, (A, B) of Karis's split sum, by importance sampling in float64."""
    alpha = max(roughness * roughness, 1e-4)
    i = np.arange(count)
    u = (i + 0.5) / count
    phi = 2 * np.pi * np.mod(i * 0.618033988749895, 1.0)
    cos_h = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))
    sin_h = np.sqrt(1 - cos_h**2)
    sin_v = math.sqrt(max(0.0, 1 - cos_v**2))
    v_h = sin_v * sin_h * np.cos(phi) + cos_v * cos_h
    cos_l = 2 * v_h * cos_h - cos_v
    up = (cos_l > 0) & (v_h > 0)
    cos_l, cos_h, v_h = cos_l[up], cos_h[up], v_h[up]

    def smith(cosine: float | np.ndarray) -> float | np.ndarray:
        tan2 = (1 - cosine**2) / cosine**2
        return (-1 + np.sqrt(1 + alpha**2 * tan2)) / 2

    weight = v_h / (cos_h * cos_v * (1 + smith(cos_v) + smith(cos_l)))
    fresnel = (1 - v_h) ** 5
    # visible part G2 v·h / (n·h n·v), with Smith's height-correlated masking and shadowing
    return float(np.sum((1 - fresnel) * weight) / count), float(np.sum(fresnel * weight) / count)


def split_sum() -> Canvas:
    """The integral over the environment as a product: a blurred environment, and a table of two numbers."""
    c = Canvas(760, 290, "The split sum: light blurred by roughness, times a table of the surface")
    c.text(12, 26, "light that a surface reflects from its environment", bold=True)
    c.text(
        12,
        48,
        "integral over l of  L(l) · f(l, v) · n·l   is about   blurred L(r, roughness)  x  (F0 · A + B)",
    )
    c.text(12, 84, "levels of the environment's cube map", bold=True)
    cells, size = 10, 60
    for level in range(6):
        rough = level / 5
        x = 16 + 68 * level
        width = 0.12 + 0.6 * rough
        for column in range(cells):
            for row in range(cells):
                away = math.hypot((column + 0.5) / cells - 0.62, (row + 0.5) / cells - 0.35)
                light = math.exp(-0.5 * (away / width) ** 2) * (0.12 / width) ** 0.7
                left, top, side = x + column * size / cells, 100 + row * size / cells, size / cells + 0.3
                shape = f'<rect x="{left:.1f}" y="{top:.1f}" width="{side:.1f}" height="{side:.1f}" '
                c.raw(f'{shape}fill="hsl(35 80% {12 + 78 * light:.0f}%)"/>')
        c.text(x + size / 2, 178, f"{rough:.1f}", 12, "middle", "soft")
    c.note(16, 200, "roughness of each level; a rough surface reads a blurred one")
    c.text(450, 84, "the table of A and B, integrated", bold=True)
    cells = 12
    for part, (left, name) in enumerate(((456, "A"), (610, "B"))):
        for column in range(cells):
            for row in range(cells):
                value = directional_albedo((column + 0.5) / cells, (row + 0.5) / cells)[part]
                shape = f'<rect x="{left + 11 * column}" y="{100 + 11 * row}" width="11.3" height="11.3" '
                c.raw(f'{shape}fill="hsl(215 60% {100 * min(1.0, value) ** 0.45:.0f}%)"/>')
        c.text(left + 66, 252, f"{name}: n·v to the right", 12, "middle", "soft")
        c.text(left + 66, 268, "roughness down", 12, "middle", "soft")
    c.note(16, 232, "F0: what the surface reflects when seen from straight above")
    return c


SAMPLES = ((6, 2), (14, 6), (2, 10), (10, 14))
"""The places of four samples in a pixel, in sixteenths (Vulkan specification, "Standard Sample Locations")."""


def samples() -> Canvas:
    """An edge over pixels: with one sample at the centre, and with four."""
    c = Canvas(700, 300, "A triangle's edge over pixels, with one sample a pixel and with four")
    size, columns, rows = 50, 6, 4

    def inside(x: float, y: float) -> bool:
        return y > 0.9 + 0.42 * x

    for left, places, title in ((20, ((8, 8),), "one sample"), (370, SAMPLES, "four samples")):
        c.text(left, 26, title, bold=True)
        for column in range(columns):
            for row in range(rows):
                hits = [inside(column + a / 16, row + b / 16) for a, b in places]
                share = sum(hits) / len(hits)
                x, y = left + size * column, 40 + size * row
                c.box(x, y, size, size, "", "paper", round=0)
                c.raw(
                    f'<rect x="{x}" y="{y}" width="{size}" height="{size}" fill="var(--f-a)" opacity="{share:g}"/>'
                )
                for (a, b), hit in zip(places, hits, strict=True):
                    c.circle(x + size * a / 16, y + size * b / 16, 3, "ink" if hit else "paper", "ink")
        c.line([(left, 40 + size * 0.9), (left + size * 6, 40 + size * (0.9 + 0.42 * 6))], "mark", 2)
    c.note(20, 270, "dots: samples, filled where the triangle covers them; red: its edge")
    c.text(
        20,
        288,
        "A pixel's colour is the mean of its samples. The shader still runs once a pixel.",
        12,
        role="soft",
    )
    return c


FIGURES = {
    "ch01-frames-in-flight": frames_in_flight,
    "ch01-sorted-draws": sorted_draws,
    "ch01-brdf-vectors": brdf_vectors,
    "ch01-split-sum": split_sum,
    "ch01-samples": samples,
}
