"""The shape of a glTF 2.0 document: types, ranges and references, checked once before anything is read.

Behind this check the other modules may take `document["meshes"][0]["primitives"]` for what the standard says
it is. A check is a function `(value, sizes)` that raises `_Wrong`; `sizes` has the length of every top-level
list, so that an index is checked where it stands. The place of a fault is put together only while the
exception climbs, so a good document pays nothing for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from common.gltf.refusal import refuse
from common.scene import NUMBER_LIMIT

Sizes = Mapping[str, int]
Check = Callable[[Any, Sizes], None]

LISTS = [
    "accessors",
    "animations",
    "buffers",
    "bufferViews",
    "cameras",
    "images",
    "materials",
    "meshes",
    "nodes",
    "samplers",
    "scenes",
    "skins",
    "textures",
]


class _Wrong(Exception):
    def __init__(self, fault: str) -> None:
        self.fault = fault
        self.keys: list[str] = []  # from the inside out

    def place(self) -> str:
        text = "".join(reversed(self.keys))
        return text[1:] if text.startswith(".") else text


def _show(value: Any) -> str:
    text = (
        repr(value)
        if not isinstance(value, dict | list)
        else "an object"
        if isinstance(value, dict)
        else "a list"
    )
    return text if len(text) <= 40 else text[:37] + "..."


def _uint(value: Any, _sizes: Sizes) -> None:
    if type(value) is not int or not 0 <= value < 2**53:
        raise _Wrong(f"is {_show(value)}, not a whole number from 0 up")


def _positive(value: Any, _sizes: Sizes) -> None:
    if type(value) is not int or not 1 <= value < 2**53:
        raise _Wrong(f"is {_show(value)}, not a whole number from 1 up")


def _number(value: Any, _sizes: Sizes) -> None:
    if type(value) not in (int, float) or not -NUMBER_LIMIT <= value <= NUMBER_LIMIT:
        raise _Wrong(f"is {_show(value)}, not a number between -1e18 and 1e18")


def _boolean(value: Any, _sizes: Sizes) -> None:
    if type(value) is not bool:
        raise _Wrong(f"is {_show(value)}, not true or false")


def _string(value: Any, _sizes: Sizes) -> None:
    if type(value) is not str:
        raise _Wrong(f"is {_show(value)}, not a string")


def _object(value: Any, _sizes: Sizes) -> None:
    if type(value) is not dict:
        raise _Wrong(f"is {_show(value)}, not an object")


def _index(name: str) -> Check:
    """A number of an element of the top-level list `name`."""

    def check(value: Any, sizes: Sizes) -> None:
        if type(value) is not int or value < 0:
            raise _Wrong(f"is {_show(value)}, not a place in {name}")
        if value >= sizes[name]:
            raise _Wrong(f"is {value}, but there are only {sizes[name]} {name}")

    return check


def _one_of(*values: Any) -> Check:
    def check(value: Any, _sizes: Sizes) -> None:
        if isinstance(value, bool | list | dict) or value not in values:
            raise _Wrong(f"is {_show(value)}, not one of {', '.join(map(str, values))}")

    return check


def _list(item: Check, length: int | None = None) -> Check:
    def check(value: Any, sizes: Sizes) -> None:
        if type(value) is not list:
            raise _Wrong(f"is {_show(value)}, not a list")
        if length is not None and len(value) != length:
            raise _Wrong(f"has {len(value)} elements instead of {length}")
        number = 0
        try:
            for element in value:
                item(element, sizes)
                number += 1
        except _Wrong as wrong:
            wrong.keys.append(f"[{number}]")
            raise

    return check


def _map(item: Check) -> Check:
    def check(value: Any, sizes: Sizes) -> None:
        _object(value, sizes)
        for key, element in value.items():
            try:
                item(element, sizes)
            except _Wrong as wrong:
                wrong.keys.append(f".{key}")
                raise

    return check


def _fields(required: str = "", **checks: Check) -> Check:
    """An object; keys without a check are allowed (later versions, extensions) and never read."""
    needed = tuple(required.split())

    def check(value: Any, sizes: Sizes) -> None:
        if type(value) is not dict:
            raise _Wrong(f"is {_show(value)}, not an object")
        for key in needed:
            if key not in value:
                raise _Wrong(f"has no {key}")
        for key, element in value.items():
            item = checks.get(key)
            if item is not None:
                try:
                    item(element, sizes)
                except _Wrong as wrong:
                    wrong.keys.append(f".{key}")
                    raise

    return check


def _vector(length: int) -> Check:
    return _list(_number, length)


_TEXTURE = _fields(
    "index",
    index=_index("textures"),
    texCoord=_uint,
    scale=_number,
    strength=_number,
    extensions=_fields(
        KHR_texture_transform=_fields(offset=_vector(2), rotation=_number, scale=_vector(2), texCoord=_uint)
    ),
)

_FOG = _fields(
    extinction=_number,
    height_extinction=_number,
    height_falloff=_number,
    height_base=_number,
    albedo=_vector(3),
    boxes=_list(
        _fields(
            "center half_size extinction",
            center=_vector(3),
            half_size=_vector(3),
            extinction=_number,
            albedo=_vector(3),
        )
    ),
)
_STRATA_EXTRAS = _fields(strata=_fields(ev100=_number, ambient=_number, fog=_FOG))


def _extras(value: Any, sizes: Sizes) -> None:
    """Extras may be anything; only our own part of them is read and therefore checked."""
    if type(value) is dict:
        _STRATA_EXTRAS(value, sizes)


_LIGHT = _fields(
    "type",
    type=_one_of("point", "spot", "directional"),
    name=_string,
    color=_vector(3),
    intensity=_number,
    range=_number,
    spot=_fields(innerConeAngle=_number, outerConeAngle=_number),
)

_ATTRIBUTES = _map(_index("accessors"))

_TOP = _fields(
    "asset",
    asset=_fields("version", version=_string, minVersion=_string),
    extensionsUsed=_list(_string),
    extensionsRequired=_list(_string),
    scene=_index("scenes"),
    scenes=_list(_fields(nodes=_list(_index("nodes")), name=_string, extras=_extras)),
    nodes=_list(
        _fields(
            children=_list(_index("nodes")),
            mesh=_index("meshes"),
            skin=_index("skins"),
            camera=_index("cameras"),
            matrix=_vector(16),
            translation=_vector(3),
            rotation=_vector(4),
            scale=_vector(3),
            weights=_list(_number),
            name=_string,
            extras=_extras,
            extensions=_fields(
                KHR_lights_punctual=_fields("light", light=_index("lights")),
                EXT_mesh_gpu_instancing=_fields("attributes", attributes=_ATTRIBUTES),
            ),
        )
    ),
    meshes=_list(
        _fields(
            "primitives",
            primitives=_list(
                _fields(
                    "attributes",
                    attributes=_ATTRIBUTES,
                    indices=_index("accessors"),
                    material=_index("materials"),
                    mode=_one_of(0, 1, 2, 3, 4, 5, 6),
                    targets=_list(_ATTRIBUTES),
                )
            ),
            weights=_list(_number),
            name=_string,
        )
    ),
    accessors=_list(
        _fields(
            "componentType count type",
            bufferView=_index("bufferViews"),
            byteOffset=_uint,
            componentType=_one_of(5120, 5121, 5122, 5123, 5125, 5126),
            normalized=_boolean,
            count=_positive,
            type=_one_of("SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"),
            sparse=_fields(
                "count indices values",
                count=_positive,
                indices=_fields(
                    "bufferView componentType",
                    bufferView=_index("bufferViews"),
                    byteOffset=_uint,
                    componentType=_one_of(5121, 5123, 5125),
                ),
                values=_fields("bufferView", bufferView=_index("bufferViews"), byteOffset=_uint),
            ),
        )
    ),
    bufferViews=_list(
        _fields(
            "buffer byteLength",
            buffer=_index("buffers"),
            byteOffset=_uint,
            byteLength=_positive,
            byteStride=_uint,
        )
    ),
    buffers=_list(_fields("byteLength", byteLength=_positive, uri=_string)),
    materials=_list(
        _fields(
            name=_string,
            pbrMetallicRoughness=_fields(
                baseColorFactor=_vector(4),
                metallicFactor=_number,
                roughnessFactor=_number,
                baseColorTexture=_TEXTURE,
                metallicRoughnessTexture=_TEXTURE,
            ),
            normalTexture=_TEXTURE,
            occlusionTexture=_TEXTURE,
            emissiveTexture=_TEXTURE,
            emissiveFactor=_vector(3),
            alphaMode=_one_of("OPAQUE", "MASK", "BLEND"),
            alphaCutoff=_number,
            doubleSided=_boolean,
            extensions=_fields(
                KHR_materials_emissive_strength=_fields(emissiveStrength=_number), KHR_materials_unlit=_object
            ),
        )
    ),
    textures=_list(_fields(sampler=_index("samplers"), source=_index("images"))),
    images=_list(_fields(uri=_string, bufferView=_index("bufferViews"), name=_string)),
    samplers=_list(
        _fields(
            magFilter=_one_of(9728, 9729),
            minFilter=_one_of(9728, 9729, 9984, 9985, 9986, 9987),
            wrapS=_one_of(33071, 33648, 10497),
            wrapT=_one_of(33071, 33648, 10497),
        )
    ),
    cameras=_list(
        _fields(
            "type",
            type=_one_of("perspective", "orthographic"),
            name=_string,
            perspective=_fields("yfov znear", yfov=_number, znear=_number, zfar=_number, aspectRatio=_number),
            orthographic=_fields(
                "xmag ymag znear zfar", xmag=_number, ymag=_number, znear=_number, zfar=_number
            ),
            extras=_extras,
        )
    ),
    skins=_list(
        _fields(
            "joints",
            joints=_list(_index("nodes")),
            inverseBindMatrices=_index("accessors"),
            skeleton=_index("nodes"),
        )
    ),
    animations=_list(
        _fields(
            "channels samplers",
            name=_string,
            channels=_list(
                _fields(
                    "sampler target",
                    sampler=_uint,
                    target=_fields("path", node=_index("nodes"), path=_string),
                )
            ),
            samplers=_list(
                _fields(
                    "input output",
                    input=_index("accessors"),
                    output=_index("accessors"),
                    interpolation=_one_of("LINEAR", "STEP", "CUBICSPLINE"),
                )
            ),
        )
    ),
    extensions=_fields(KHR_lights_punctual=_fields("lights", lights=_list(_LIGHT))),
)


def check_document(root: Any) -> None:
    """Check a parsed document.

    Raises:
        Refusal: a value has the wrong type, is out of its range, is missing, or refers to nothing; the text
            names it.
    """
    try:
        _object(root, {})
        sizes = {name: len(root[name]) if isinstance(root.get(name), list) else 0 for name in LISTS}
        extensions = root.get("extensions")
        punctual = extensions.get("KHR_lights_punctual") if isinstance(extensions, dict) else None
        lights = punctual.get("lights") if isinstance(punctual, dict) else None
        sizes["lights"] = len(lights) if isinstance(lights, list) else 0
        _TOP(root, sizes)
    except _Wrong as wrong:
        refuse(wrong.place() or "the document", wrong.fault)
