"""How a study describes a draw, for both backends: shaders, what the corners make, where vertices come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple


class Attribute(NamedTuple):
    """A part of each vertex: its location in the shader, how many floats, and its byte within the vertex."""

    location: int
    floats: int
    offset: int


@dataclass(frozen=True)
class Drawn:
    """What a draw is made of; the chapter's own pipelines know neither lines nor offsets, since they need none.

    `push_back` moves filled triangles away from the camera: by that many times the depth that they gain over a pixel,
    and by as many smallest steps of depth. `attributes` are read from one buffer, `stride` bytes a vertex.
    """

    shaders: tuple[str, str]
    corners: Literal["triangles", "lines"] = "triangles"
    filled: bool = True
    push_back: float = 0.0
    depth: bool = True
    attributes: tuple[Attribute, ...] = ()
    stride: int = 0
    defines: tuple[tuple[str, int], ...] = ()
