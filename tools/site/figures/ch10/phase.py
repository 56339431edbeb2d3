"""The phase function of Henyey and Greenstein as polar curves."""

from __future__ import annotations

import math

from tools.site.figures.canvas import Canvas, Point

ANISOTROPIES = (0.0, 0.4, 0.7, 0.9)
LOWEST, HIGHEST = 1e-3, 20.0
"""Light per steradian at the middle of the drawing, and at its rim."""
RADIUS, MIDDLE = 150.0, (250.0, 178.0)
STEPS = 180


def phase(cosine: float, g: float) -> float:
    """Return the part of the scattered light per steradian, as shaders/phase.glsl has it."""
    size, turned = abs(g), 1 + cosine if g < 0 else 1 - cosine
    d = (1 - size) ** 2 + 2 * size * turned
    return (1 - size) * (1 + size) / (4 * math.pi * d * math.sqrt(d))


def radius(value: float) -> float:
    """Return the distance from the middle for an amount of light."""
    return RADIUS * math.log(value / LOWEST) / math.log(HIGHEST / LOWEST)


def curve(g: float) -> list[Point]:
    """Return the points of a curve, all around."""
    points = []
    for step in range(STEPS + 1):
        angle = 2 * math.pi * step / STEPS
        far = radius(phase(math.cos(angle), g))
        points.append((MIDDLE[0] + far * math.cos(angle), MIDDLE[1] - far * math.sin(angle)))
    return points


def phase_function() -> Canvas:
    """Four curves, circles for powers of ten, and what the curves are."""
    c = Canvas(760, 356, "The phase function for four values of g: polar curves of the light by direction")
    for power in (-2, -1, 0, 1):
        far = radius(10.0**power)
        circle = [
            (
                MIDDLE[0] + far * math.cos(math.tau * i / STEPS),
                MIDDLE[1] + far * math.sin(math.tau * i / STEPS),
            )
            for i in range(STEPS + 1)
        ]
        c.line(circle, "line", 0.5, dashed=True)
        c.text(MIDDLE[0] - 0.71 * far - 2, MIDDLE[1] + 0.71 * far + 10, f"{10.0**power:g}", 11, "end", "soft")
    c.arrow(16, MIDDLE[1], 92, MIDDLE[1], "ink")
    c.text(16, MIDDLE[1] - 10, "light arrives", 12, role="soft")
    c.circle(*MIDDLE, 4, "mark", "mark")
    for number, g in enumerate(ANISOTROPIES):
        color = f"s{number + 1}"
        c.line(curve(g), color, 2)
        y = 66.0 + 56 * number
        c.line([(452, y - 4), (472, y - 4)], color, 3)
        c.text(480, y, f"g = {g:g}", 13, bold=True)
        ahead, back = phase(1, g), phase(-1, g)
        c.note(480, y + 18, f"straight on {ahead:.3g} / sr, back {back:.2g} / sr")
    c.text(452, 32, "mean cosine of the turn", 13, bold=True)
    c.note(452, 300, "The distance from the middle is the logarithm")
    c.note(452, 317, "of the light. All curves have the integral 1.")
    return c
