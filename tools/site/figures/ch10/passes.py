"""The passes of fog, what each reads and writes, and the passes that show surfaces through it."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas

PASSES = (
    ("fog_inject", "the medium at a point", "fog_medium", "scattering, extinction"),
    ("fog_scatter", "lights, shadows, ambient", "fog_light", "light, extinction"),
    ("fog_spatial", "5x5 in the slice", "fog_smooth", "light, extinction"),
    ("fog_temporal", "history at the old place", "history_fog", "light, extinction"),
    ("fog_integrate", "sum along a column", "records", "sum to the slice, and inside"),
)
"""Of each pass: its name, what it does, what it writes, and what is in that."""
INPUTS = (
    "scene's media, noise, wind",
    "clusters, shadow maps",
    "",
    "history of the last frame",
    "",
)


def passes_of_fog() -> Canvas:
    """A row for each pass, from top to bottom, and what reads the records."""
    c = Canvas(
        760,
        452,
        "The five passes of fog with what each reads and writes, and the passes that show surfaces through it",
    )
    for x, words in ((20.0, "reads besides"), (236.0, "pass"), (516.0, "writes, for each froxel")):
        c.text(x, 26, words, 13, bold=True)
    for number, (name, does, result, holds) in enumerate(PASSES):
        y = 40.0 + 66 * number
        if INPUTS[number]:
            c.box(20, y + 6, 180, 32, INPUTS[number], "d", 12)
            c.arrow(200, y + 22, 234, y + 22)
        c.box(236, y, 230, 44, f"{name}\n{does}", "a", 12)
        c.arrow(466, y + 22, 514, y + 22)
        c.box(516, y, 224, 44, f"{result}\n{holds}", "b", 12)
        if number:
            c.line([(628, y - 22), (628, y - 11), (351, y - 11), (351, y - 2)], arrow=True)
    c.box(236, 386, 504, 44, "lighting, forward, transparent, sky\ncolour x transmittance + light", "c", 12)
    c.arrow(628, 348, 628, 384)
    return c
