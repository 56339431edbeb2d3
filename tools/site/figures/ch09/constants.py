"""The two compilers of a shader, and where a define and a specialization constant come in."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas

VALUES = (1, 3, 6)
ROWS = (
    ("a define", (3, 3, 3)),
    ("a specialization constant", (1, 1, 3)),
    ("the same on OpenGL", (1, 3, 3)),
)
"""What gives the value, and how many texts, modules and pipelines three values take; on OpenGL the second is text."""


def two_compilers() -> Canvas:
    """Three rows: texts, modules, pipelines."""
    c = Canvas(
        760,
        318,
        "From text to the code of the device: a define makes three modules, a specialization constant one module and "
        "three pipelines",
    )
    lefts = (206.0, 394.0, 582.0)
    for x, title in zip(lefts, ("text in GLSL", "SPIR-V, or text", "code of the device"), strict=True):
        c.text(x, 26, title, 13, bold=True)
    for row, (title, counts) in enumerate(ROWS):
        y = 44.0 + 88 * row
        c.text(16, y + 42, title, 13, bold=True)
        gl = row == 2
        words = ("declares RADIUS", "holds RADIUS = ?" if not gl else "")
        for column, count in enumerate(counts):
            for number in range(count):
                place = y + 26 * number if count > 1 else y + 26
                value = f"RADIUS = {VALUES[number]}"
                label = value if count > 1 else words[column]
                c.box(lefts[column], place, 140, 22, label, ("a", "b", "c")[column], 12, round=2)
        for column in (0, 1):
            for number in range(3):
                start = y + 26 * number + 11 if counts[column] > 1 else y + 37
                end = y + 26 * number + 11 if counts[column + 1] > 1 else y + 37
                if counts[column] == counts[column + 1] == 1 and number:
                    continue
                c.arrow(lefts[column] + 140, start, lefts[column + 1] - 2, end)
    return c
