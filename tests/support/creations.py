"""Creation descriptors for the tests of both backends: a value other than the default for each field, and setters."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from backends.creation import BufferCreation, Creation, ImageCreation, SamplerCreation

KINDS = (BufferCreation, ImageCreation, SamplerCreation)

DEFAULTS: dict[type[Creation], dict[str, Any]] = {
    BufferCreation: {"name": "", "size": 0, "memory": "device", "uses": (), "place": None, "families": ()},
    ImageCreation: {
        "name": "",
        "format": "rgba8",
        "size": (1, 1),
        "shape": "2d",
        "layers": 1,
        "levels": 1,
        "samples": 1,
        "uses": ("copy_target", "sampled"),
        "view_format": None,
        "swizzle": "rgba",
        "place": None,
    },
    SamplerCreation: {
        "name": "",
        "mag": "linear",
        "min": "linear",
        "mipmap": "linear",
        "wrap_u": "repeat",
        "wrap_v": "repeat",
        "anisotropy": 1.0,
    },
}
"""What the documentation says, written down once more."""

OTHERS: dict[type[Creation], dict[str, Any]] = {
    BufferCreation: {
        "name": "matrices",
        "size": 1000,
        "memory": "upload",
        "uses": ("copy_source", "storage", "vertex"),
        "place": ("somewhere", 256),
        "families": (2, 0),
    },
    ImageCreation: {
        "name": "leaves",
        "format": "rgba16f",
        "size": (16, 8),
        "shape": "array",
        "layers": 3,
        "levels": 4,
        "samples": 4,
        "uses": ("copy_source", "storage"),
        "view_format": "rgba8_srgb",
        "swizzle": "0rg1",
        "place": ("somewhere", 256),
    },
    SamplerCreation: {
        "name": "soft",
        "mag": "nearest",
        "min": "nearest",
        "mipmap": None,
        "wrap_u": "clamp",
        "wrap_v": "mirror",
        "anisotropy": 4.0,
    },
}
"""For each field a value that is not its default; not all of them can be had together."""

SETTERS: dict[type[Creation], dict[str, tuple[str, ...]]] = {
    BufferCreation: {f"set_{name}": (name,) for name in DEFAULTS[BufferCreation]},
    ImageCreation: {f"set_{name}": (name,) for name in DEFAULTS[ImageCreation] if name != "layers"}
    | {"set_shape": ("shape", "layers")},
    SamplerCreation: {
        "set_name": ("name",),
        "set_filters": ("mag", "min", "mipmap"),
        "set_wraps": ("wrap_u", "wrap_v"),
        "set_anisotropy": ("anisotropy",),
    },
}
"""Each setter with the fields that it sets, in the order of its arguments."""


def chained(kind: type[Creation], values: dict[str, Any], order: Any = None) -> Any:
    """Return a description with these values from one chain of setters, in an `order` (their numbers) or their own."""
    needed = [name for name, sets in SETTERS[kind].items() if {*sets} & {*values}]
    creation = kind()
    for number in range(len(needed)) if order is None else order:
        arguments: list[Any] = []
        for field in SETTERS[kind][needed[number]]:
            value = values.get(field, DEFAULTS[kind][field])
            arguments += value if isinstance(value, tuple) else [value]
        assert getattr(creation, needed[number])(*arguments) is creation
    return creation


def ways(kind: type[Creation], values: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Return a description made of fields, one by a chain, and one in which every field had another value before."""
    again = kind(**OTHERS[kind]).reset()
    for field, value in values.items():
        setattr(again, field, value)
    return kind(**values), chained(kind, values), again


def held(creation: Creation) -> dict[str, Any]:
    """Return what a description holds, field by field."""
    return {field.name: getattr(creation, field.name) for field in fields(creation)}


_TEXTURE: dict[str, Any] = {"format": "rgba8", "size": (16, 8), "name": "leaves"}
_CUBES: dict[str, Any] = {"format": "rgba16f", "size": (8, 8), "levels": 2, "name": "sky"}

IMAGES: dict[str, dict[str, Any]] = {
    "texture": _TEXTURE | {"levels": 5},
    "target": {"format": "rgba16f", "size": (33, 17), "uses": ("color", "sampled"), "name": "light"},
    "depth": {"format": "d32f", "size": (33, 17), "uses": ("depth",), "name": "depth"},
    "samples": {"size": (32, 32), "samples": 4, "uses": ("color",), "name": "many"},
    "array": _TEXTURE | {"shape": "array", "layers": 3, "levels": 2},
    "array of one": _TEXTURE | {"shape": "array"},
    "volume": _TEXTURE | {"shape": "3d", "layers": 5},
    "cube": _CUBES | {"shape": "cube"},
    "cubes": _CUBES | {"shape": "cube_array", "layers": 12},
    "sRGB": _TEXTURE | {"view_format": "rgba8_srgb", "uses": ("storage", "sampled")},
    "swizzled": _TEXTURE | {"swizzle": "0rg1"},
}
"""Images as both backends make them."""

BUFFERS: dict[str, dict[str, Any]] = {
    "uniforms": {"size": 1000, "memory": "upload", "uses": ("uniform",), "name": "matrices"},
    "vertices": {"size": 4096, "uses": ("copy_target", "vertex", "storage"), "name": "vertices"},
    "readback": {"size": 77, "memory": "readback", "uses": ("copy_target",), "name": "picture"},
    "nothing": {"uses": ("storage",)},
}

SAMPLERS: dict[str, dict[str, Any]] = {
    "defaults": {"name": "smooth"},
    "sharp": {"mag": "nearest", "min": "nearest", "mipmap": "nearest", "name": "sharp"},
    "level 0": {"mipmap": None, "wrap_u": "clamp", "wrap_v": "mirror", "name": "user interface"},
    "anisotropic": {"anisotropy": 4.0, "name": "ground"},
}

_ARRAY = _TEXTURE | {"shape": "array"}
ONE_FIELD: dict[type[Creation], dict[str, tuple[dict[str, Any], Any]]] = {
    BufferCreation: {
        "name": ({"size": 64, "uses": ("storage",)}, "other"),
        "size": ({"uses": ("storage",), "name": "b"}, 64),
        "memory": ({"size": 64, "uses": ("storage",), "name": "b"}, "readback"),
        "uses": ({"size": 64, "uses": ("storage",), "name": "b"}, ("storage", "indirect")),
    },
    ImageCreation: {
        "name": (_TEXTURE, "other"),
        "format": (_TEXTURE, "rgba16f"),
        "size": (_TEXTURE, (16, 9)),
        "shape": (_TEXTURE, "array"),
        "layers": (_ARRAY, 2),
        "levels": (_TEXTURE, 3),
        "samples": (_TEXTURE | {"uses": ("color",)}, 4),
        "uses": (_TEXTURE, ("sampled",)),
        "view_format": (_TEXTURE, "rgba8_srgb"),
        "swizzle": (_TEXTURE, "bgra"),
    },
    SamplerCreation: {field: ({"name": "s"}, other) for field, other in OTHERS[SamplerCreation].items()},
}
"""For each field that both backends have: what surrounds it, and a value that makes another resource."""
