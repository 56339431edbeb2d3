"""Participating media: what scatters and absorbs light between surfaces.

Extinction is per metre: the part of light that is lost in a metre, by scattering and absorption. Albedo is the part of
it that is scattered, in three channels.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

Color = tuple[float, float, float]

WHITISH: Color = (0.9, 0.9, 0.9)
"""The albedo of haze and mist in visible light, if nothing else is said: water absorbs next to nothing, dust more."""


@dataclass(frozen=True)
class FogBox:
    """A medium of constant extinction in a box along the axes of the world: |point - center| <= half_size."""

    center: tuple[float, float, float]
    half_size: tuple[float, float, float]
    extinction: float
    albedo: Color = WHITISH


@dataclass(frozen=True)
class Medium:
    """The sum of a constant medium, one that thins out with height, and boxes.

    The extinction of the second is `height_extinction` up to y = `height_base`, and falls by
    exp(-height_falloff * (y - height_base)) above.
    """

    extinction: float = 0.0
    height_extinction: float = 0.0
    height_falloff: float = 0.0
    height_base: float = 0.0
    albedo: Color = WHITISH
    boxes: tuple[FogBox, ...] = ()


def medium_of(extras: dict[str, Any]) -> Medium | None:
    """Return the medium that `extras.strata` of a glTF scene describes as "fog", by the names of the fields above."""
    said = extras.get("fog")
    if said is None:
        return None
    boxes = tuple(FogBox(**_values(box, FogBox)) for box in said.get("boxes", ()))
    return Medium(**{**_values(said, Medium), "boxes": boxes})


def _values(said: dict[str, Any], kind: type) -> dict[str, Any]:
    """Return the numbers and vectors of a JSON object that are fields of `kind`; others are for later versions."""
    known = {field.name for field in fields(kind)} - {"boxes"}
    return {
        name: tuple(map(float, value)) if isinstance(value, list | tuple) else float(value)
        for name, value in said.items()
        if name in known
    }
