"""Three rates of a fragment, and the combiners that make one of them."""

from __future__ import annotations

from collections.abc import Callable

from tools.site.figures.canvas import Canvas

Rate = tuple[int, int]

OPERATIONS: dict[str, Callable[[Rate, Rate], Rate]] = {
    "keep": lambda a, b: a,
    "replace": lambda a, b: b,
    "min": lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    "max": lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    "mul": lambda a, b: (a[0] * b[0], a[1] * b[1]),
}
"""What a combiner makes of two rates (Vulkan 1.3 specification, "Combining the Fragment Shading Rates")."""

EXAMPLE: tuple[Rate, Rate] = ((1, 2), (2, 1))
CHAPTER = ("keep", "replace")
"""The combiners of the lighting pass: of the primitive, and of the attachment."""


def combined(draw: Rate, primitive: Rate, attachment: Rate, combiners: tuple[str, str]) -> Rate:
    """Return the rate of a fragment."""
    first, second = (OPERATIONS[name] for name in combiners)
    return second(first(draw, primitive), attachment)


def rates_combined() -> Canvas:
    """The sources, the combiners, and a table of their operations."""
    c = Canvas(760, 300, "Three rates of a fragment, and the two combiners that make one of them")
    c.box(20, 40, 150, 44, "of the draw\npipeline or command", "a")
    c.box(20, 104, 150, 44, "of the primitive\nvertex, mesh shader", "b")
    c.box(20, 168, 150, 44, "of the attachment\ntexel of the mask", "d")
    c.box(248, 72, 140, 44, "first combiner\nhere: keep", "card")
    c.box(466, 120, 140, 44, "second combiner\nhere: replace", "card")
    c.box(672, 120, 70, 44, "rate", "c")
    c.arrow(170, 62, 246, 86)
    c.arrow(170, 126, 246, 102)
    c.arrow(388, 94, 464, 132)
    c.line([(170, 190), (420, 190), (464, 156)], arrow=True)
    c.arrow(606, 142, 670, 142)
    (a, b) = EXAMPLE
    c.text(20, 246, f"of {a[0]}x{a[1]} and {b[0]}x{b[1]}:", 13, bold=True)
    for number, (name, operation) in enumerate(OPERATIONS.items()):
        width, height = operation(a, b)
        c.box(150 + 118 * number, 230, 108, 24, f"{name}: {width}x{height}", "card", 12, round=2)
    c.note(20, 280, "Both combiners keep by default. Then the draw alone decides, and no message says so.")
    return c
