"""Study: a picture filled by a triangle that is larger than it, or by two that are not. No vertex is stored anywhere.

Passes that only compute something for each pixel, as lighting, blur or tone mapping do, need a draw that reaches every
pixel once. Its corners follow from the number of the vertex. Two triangles share the diagonal of the picture; the rule
of which of them owns a pixel on it belongs to the API (both call it top-left), so no pixel is written twice or left
out. GPUs shade pixels by squares of 2x2 however, and each square that the diagonal cuts is worked on for both
triangles: the one large triangle has no diagonal, and that is why most renderers draw it. What sticks out of the
picture is clipped before any pixel of it exists.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="fullscreen pass",
    idea="The number of a vertex is enough to place it: three of them, or six, reach every pixel exactly once.",
    order=4,
    features=("composition/fullscreen-pass",),
    outputs=("color", "uv", "writes"),
)

VERTICES = {"triangle": 3, "quad": 6}
"""Vertices of each shape."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    shape: str = knob("triangle", "what fills the picture", choices=tuple(VERTICES))


class Written(NamedTuple):
    """An output: the format of its target, what happens to what is there, and its number in pass.frag."""

    format: str
    blend: Literal["add"] | None
    number: int


WRITTEN = {
    "color": Written("rgba8", "add", 0),
    # Of 32 bits: half floats hold uv to a pixel of a picture of 2048, and no better.
    "uv": Written("rgba32f", None, 1),
    # Sums of ones: they begin at 0, and half floats count to 2048. Every device can blend in this format.
    "writes": Written("rgba16f", "add", 2),
}
"""What is drawn for each output. Adding shows in the picture, too, whether pixels are written twice or never."""

SHADERS = ("studies/fullscreen_pass/pass.vert", "studies/fullscreen_pass/pass.frag")
EMPTY = (0.0, 0.0, 0.0, 0.0)


def defines(settings: Settings, output: str) -> tuple[tuple[str, int], ...]:
    """Return what the shaders are told."""
    return (("QUAD", int(settings.shape == "quad")), ("WRITTEN", WRITTEN[output].number))
