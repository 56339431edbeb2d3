"""Participating media: what scatters and absorbs light between surfaces.

Extinction is per metre: the part of light that is lost in a metre, by scattering and absorption. Albedo is the part of
it that is scattered, in three channels.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
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

    def moved(self, offset: tuple[float, float, float]) -> Medium:
        """Return the medium moved by `offset` metres."""
        boxes = (replace(box, center=_sum(box.center, offset)) for box in self.boxes)
        return replace(self, height_base=self.height_base + offset[1], boxes=tuple(boxes))

    def scaled(self, factor: float) -> Medium:
        """Return the medium scaled about zero: lengths times `factor`, so that rays lose as much light as before."""
        boxes = (
            replace(
                box,
                center=_times(box.center, factor),
                half_size=_times(box.half_size, factor),
                extinction=box.extinction / factor,
            )
            for box in self.boxes
        )
        return replace(
            self,
            extinction=self.extinction / factor,
            height_extinction=self.height_extinction / factor,
            height_falloff=self.height_falloff / factor,
            height_base=self.height_base * factor,
            boxes=tuple(boxes),
        )


def _sum(a: Color, b: Color) -> Color:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _times(a: Color, factor: float) -> Color:
    return a[0] * factor, a[1] * factor, a[2] * factor


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
