"""Whether two scenes are the same to the last bit, and where they are not."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from common.scene import Image, Nodes, Scene


def difference(one: Any, other: Any, place: str = "scene") -> str:
    """Return the first place where two values differ in type, shape or bits, "" where they do not."""
    if isinstance(one, Image) and isinstance(other, Image):
        one, other = (image_fields(image) for image in (one, other))
    if type(one) is not type(other):
        return f"{place}: {type(one).__name__} and {type(other).__name__}"
    if isinstance(one, np.ndarray):
        same = (one.dtype, one.shape) == (other.dtype, other.shape) and one.tobytes() == other.tobytes()
        return "" if same else place
    if isinstance(one, Nodes | Scene) or dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return _first((getattr(one, name), getattr(other, name), f"{place}.{name}") for name in names)
    if isinstance(one, dict):
        if list(one) != list(other):
            return f"{place}: keys {list(one)} and {list(other)}"
        return _first((one[key], other[key], f"{place}[{key!r}]") for key in one)
    if isinstance(one, list | tuple):
        if len(one) != len(other):
            return f"{place}: {len(one)} and {len(other)} of them"
        return _first(
            (a, b, f"{place}[{number}]") for number, (a, b) in enumerate(zip(one, other, strict=True))
        )
    return "" if one == other and repr(one) == repr(other) else f"{place}: {one!r} and {other!r}"


def image_fields(image: Image) -> dict[str, Any]:
    """Return what an image is, decoded."""
    return {"name": image.name, "size": (image.width, image.height), "pixels": np.asarray(image.pixels)}


def _first(pairs: Any) -> str:
    return next(filter(None, (difference(*pair) for pair in pairs)), "")
