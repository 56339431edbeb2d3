"""The knobs of the visibility buffer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Surfaces = Literal["gbuffer", "visibility"]
"""What draws the G-buffer: the triangles themselves, or a pass over all pixels that knows the triangle of each."""

Tangents = Literal["stored", "derived"]
"""Where the frame of a normal map comes from: the vertices, or the derivatives of position and uv."""


@dataclass
class VisibilitySettings:
    """How a deferred frame finds the surface of each pixel."""

    surfaces: str = knob(
        "gbuffer",
        "what evaluates materials: each triangle while it is drawn, or each pixel once, by its triangle's number",
        choices=get_args(Surfaces),
    )
    tangents: str = knob(
        "stored",
        "the frame of normal maps with surfaces=visibility: of the vertices, or from derivatives of position and uv",
        choices=get_args(Tangents),
    )
