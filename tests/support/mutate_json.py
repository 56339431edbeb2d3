"""Changes to a parsed glTF document: numbers, references, texts, URIs, missing and surplus parts, wrong types."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from typing import Any

from tests.support.mutate_values import (
    COMPONENTS,
    EXTENSIONS,
    FLOATS,
    INTEGERS,
    RAW,
    REFERENCES,
    SMALL,
    TEXTS,
    TYPES,
    URIS,
)

Slot = tuple[Any, Any]
"""A container and the key or the index of a value in it."""

_RAW_MARK = "\ue000raw:"


def written(document: Any) -> bytes:
    """Return the text of a document as bytes; what `RAW` stands for stands in it without quotes."""
    text = json.dumps(document, ensure_ascii=True)
    mark = json.dumps(_RAW_MARK)[1:-1]
    parts = text.split(f'"{mark}')
    return "".join([parts[0], *(part.replace('"', "", 1) for part in parts[1:])]).encode()


def nasty_text(rng: random.Random) -> str:
    """Return a name that a terminal, a file system or a text's coding may stumble over."""
    return rng.choice(TEXTS)


def change(document: dict[str, Any], rng: random.Random, changes: list[str]) -> None:
    """Change one thing in a document that follows the schema; `changes` gets what."""
    kinds, weights = zip(*_KINDS.items(), strict=True)
    for kind in rng.choices(kinds, weights, k=8):
        told = kind(document, rng)
        if told:
            changes.append(told)
            return


def slots(value: Any, depth: int = 0) -> Iterator[Slot]:
    """Yield every place of a document that holds a value."""
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, inner in entries:
        yield value, key
        if depth < 40:
            yield from slots(inner, depth + 1)


def _pick(document: Any, rng: random.Random, fits: Callable[[Any, Any], bool]) -> Slot | None:
    found = [(holder, key) for holder, key in slots(document) if fits(key, holder[key])]
    return rng.choice(found) if found else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(document: Any, rng: random.Random) -> str:
    """A number becomes an end of its kind, or now and then a text that is none."""
    slot = _pick(document, rng, lambda _, value: _is_number(value))
    if slot is None:
        return ""
    holder, key = slot
    old = holder[key]
    if rng.random() < 0.06:
        holder[key] = _RAW_MARK + rng.choice(RAW)
    elif isinstance(old, float):
        holder[key] = rng.choice(FLOATS)
    else:
        holder[key] = rng.choice(SMALL if rng.random() < 0.6 else (*INTEGERS, *FLOATS[:8]))
    return f"{key}: {old} becomes {holder[key]!r:.40}"


def _real(document: Any, rng: random.Random) -> str:
    """A real number of nodes, materials, cameras or lights becomes an extreme one; parts that have none get them."""
    parts = [
        *(document.get("nodes") or []),
        *(document.get("materials") or []),
        *(document.get("cameras") or []),
    ]
    parts = [part for part in parts if isinstance(part, dict)]
    if not parts:
        return ""
    part = rng.choice(parts)
    if part in (document.get("nodes") or []):
        key, count = rng.choice(
            (("translation", 3), ("rotation", 4), ("scale", 3), ("matrix", 16), ("weights", 1))
        )
        values = [rng.choice(FLOATS) if rng.random() < 0.5 else rng.choice((0.0, 1.0)) for _ in range(count)]
        if key == "matrix":
            for other in ("translation", "rotation", "scale"):
                part.pop(other, None)
            values[3::4] = [0.0, 0.0, 0.0, 1.0] if rng.random() < 0.8 else values[3::4]
        part[key] = values
    elif "type" in part:
        part["perspective"] = {
            name: rng.choice(FLOATS)
            for name in ("yfov", "znear", "zfar", "aspectRatio")
            if rng.random() < 0.8
        }
        key = "perspective"
    else:
        key = rng.choice(
            ("emissiveFactor", "alphaCutoff", "KHR_materials_emissive_strength", "pbrMetallicRoughness")
        )
        if key == "KHR_materials_emissive_strength":
            part.setdefault("extensions", {})[key] = {"emissiveStrength": rng.choice(FLOATS)}
        elif key == "pbrMetallicRoughness":
            part[key] = {"roughnessFactor": rng.choice(FLOATS), "metallicFactor": rng.choice(FLOATS)}
        else:
            part[key] = rng.choice(FLOATS) if key == "alphaCutoff" else [rng.choice(FLOATS) for _ in range(3)]
    return f"{key} becomes {part.get(key)!r:.60}"


def _reference(document: Any, rng: random.Random) -> str:
    """A number of an entry becomes that of another one, of itself, or of the first that is not there."""
    slot = _pick(
        document, rng, lambda key, value: isinstance(value, int) and (key in REFERENCES or str(key).isupper())
    )
    if slot is None:
        return ""
    holder, key = slot
    count = len(document.get(REFERENCES.get(key, "accessors")) or [])
    old, holder[key] = holder[key], rng.randrange(count + (rng.random() < 0.15) or 1)
    return f"{key}: {old} becomes {holder[key]}"


def _tree(document: Any, rng: random.Random) -> str:
    """Nodes get children by lot: cycles, nodes with two parents, the same child twice."""
    nodes = document.get("nodes")
    if not nodes:
        return ""
    node = rng.randrange(len(nodes))
    target = nodes[node] if rng.random() < 0.8 else (document.get("scenes") or [{}])[0]
    key = "children" if target is nodes[node] else "nodes"
    target.setdefault(key, []).append(rng.randrange(len(nodes)))
    return f"nodes[{node}].{key} becomes {target[key]!r:.60}"


def _layout(document: Any, rng: random.Random) -> str:
    """An accessor or a buffer view becomes another one of the same bytes, or has none."""
    entries = [
        *(document.get("accessors") or []),
        *(document.get("bufferViews") or []),
        *(document.get("buffers") or []),
    ]
    if not entries:
        return ""
    entry = rng.choice(entries)
    if "componentType" in entry:
        key = rng.choice(
            ("count", "byteOffset", "type", "componentType", "normalized", "bufferView", "sparse")
        )
    else:
        key = rng.choice(("byteOffset", "byteLength", "byteStride"))
    if key == "bufferView":
        entry.pop(key, None)
        entry["count"] = rng.choice((1, 3, 1000, 2**20, 2**22, 2**24, 2**24 + 1))
    elif key == "sparse":
        views = len(document.get("bufferViews") or []) or 1
        entry[key] = {
            "count": rng.choice((1, 2, 3, 2**20)),
            "indices": {"bufferView": rng.randrange(views), "componentType": rng.choice((5121, 5123, 5125))},
            "values": {"bufferView": rng.randrange(views)},
        }
    else:
        entry[key] = {
            "type": rng.choice(TYPES[:7] if rng.random() < 0.8 else TYPES),
            "componentType": rng.choice(COMPONENTS[:6] if rng.random() < 0.8 else COMPONENTS),
            "normalized": rng.random() < 0.5,
            "byteStride": rng.choice((4, 8, 12, 16, 20, 252, 256, 3)),
        }.get(key, rng.choice((*SMALL, 12, 24, 36, 1000, *INTEGERS)))
    return f"{key} of an accessor or a view becomes {entry.get(key)!r:.60}"


def _text(document: Any, rng: random.Random) -> str:
    """A name becomes a text that no terminal should be given as it is."""
    named = [
        entry
        for kind in ("nodes", "meshes", "materials", "images", "cameras", "animations", "scenes")
        for entry in document.get(kind) or []
        if isinstance(entry, dict)
    ]
    if not named:
        return ""
    rng.choice(named)["name"] = text = nasty_text(rng)
    return f"a name becomes {text!r:.40}"


def _word(document: Any, rng: random.Random) -> str:
    """Any text of the document becomes another one, a nasty one or one that stands elsewhere."""
    slot = _pick(document, rng, lambda _, value: isinstance(value, str) and len(value) < 1000)
    if slot is None:
        return ""
    holder, key = slot
    holder[key] = rng.choice((nasty_text(rng), rng.choice(TYPES), "LINEAR", "BLEND", "2.1", "image/jpeg"))
    return f"{key} becomes {holder[key]!r:.40}"


def _uri(document: Any, rng: random.Random) -> str:
    """A URI leads elsewhere, or there is one more image, which nothing uses, or which a texture uses."""
    entries = [*(document.get("images") or []), *(document.get("buffers") or [])]
    if not entries or rng.random() < 0.4:
        entries = [{}]
        document.setdefault("images", []).append(entries[0])
        if document.get("textures") and rng.random() < 0.4:
            rng.choice(document["textures"])["source"] = len(document["images"]) - 1
    entry = rng.choice(entries)
    entry.pop("bufferView", None)
    entry["uri"] = rng.choice(URIS)
    return f"a uri becomes {entry['uri']!r:.60}"


def _extension(document: Any, rng: random.Random) -> str:
    """Extensions are named that are unknown, nasty, or not what the file uses."""
    key = rng.choices(("extensionsUsed", "extensionsRequired"), (3, 1))[0]
    name = nasty_text(rng) if rng.random() < 0.5 else rng.choice(EXTENSIONS)
    document.setdefault(key, []).append(name)
    return f"{key} names {name!r:.40}"


def _extended(document: Any, rng: random.Random) -> str:
    """A part gets an extension that Strata reads, with values by lot."""
    accessors = len(document.get("accessors") or []) or 1
    name = rng.choice(EXTENSIONS[:6])
    value: dict[str, Any] = {
        "KHR_texture_transform": {
            "offset": [rng.choice(FLOATS), 0.0],
            "rotation": rng.choice(FLOATS),
            "texCoord": 1,
        },
        "KHR_lights_punctual": {"light": rng.randrange(3)},
        "EXT_mesh_gpu_instancing": {
            "attributes": {
                key: rng.randrange(accessors)
                for key in ("TRANSLATION", "ROTATION", "SCALE")
                if rng.random() < 0.6
            }
        },
        "KHR_materials_emissive_strength": {"emissiveStrength": rng.choice(FLOATS)},
    }.get(name, {})
    parts = [holder[key] for holder, key in slots(document) if isinstance(holder[key], dict)]
    parts = [part for part in parts if isinstance(part.get("extensions", {}), dict)]
    if not parts:
        return ""
    rng.choice(parts).setdefault("extensions", {})[name] = value
    light = {
        "type": rng.choice(("point", "spot", "directional")),
        "intensity": rng.choice(FLOATS),
        "range": rng.choice(FLOATS),
    }
    if name == "KHR_lights_punctual" and rng.random() < 0.5:
        document.setdefault("extensions", {})[name] = {"lights": [light, light, light]}
    return f"{name} is {value!r:.60}"


def _without(document: Any, rng: random.Random) -> str:
    """A part is missing."""
    slot = _pick(document, rng, lambda *_: True)
    if slot is None:
        return ""
    holder, key = slot
    del holder[key]
    return f"{key} is missing"


def _doubled(document: Any, rng: random.Random) -> str:
    """A part of a list is there several times."""
    slot = _pick(document, rng, lambda _, value: isinstance(value, list) and bool(value))
    if slot is None:
        return ""
    entries = slot[0][slot[1]]
    times = rng.choice((1, 1, 7, 100 if len(entries) < 20 else 1))
    entries += [rng.choice(entries) for _ in range(times)]
    return f"{slot[1]} has {times} more"


def _images(document: Any, rng: random.Random) -> str:
    """Every texture shows a picture of its own, all of them the same: decoded, each takes memory."""
    images, textures = document.get("images"), document.get("textures")
    if not images or not textures:
        return ""
    picture = rng.choice(images)
    document["images"] = [dict(picture) for _ in textures] + images
    for number, texture in enumerate(textures):
        texture["source"] = number
    return f"all textures show the picture {picture.get('name')!r:.40}"


def _kind(document: Any, rng: random.Random) -> str:
    """A value is of another kind."""
    slot = _pick(document, rng, lambda *_: True)
    if slot is None:
        return ""
    holder, key = slot
    holder[key] = rng.choice((None, True, "x", 0, 1.5, [], {}, [[]], [None], {"a": {}}, [1, 2, 3]))
    return f"{key} becomes {holder[key]!r}"


def _exchanged(document: Any, rng: random.Random) -> str:
    """Two values change places."""
    first, second = (
        _pick(document, rng, lambda _, value: not isinstance(value, dict | list)) for _ in range(2)
    )
    if first is None or second is None:
        return ""
    (a, i), (b, j) = first, second
    a[i], b[j] = b[j], a[i]
    return f"{i} and {j} are exchanged"


def _extras(document: Any, rng: random.Random) -> str:
    """Extras are nested deeply, long, or what Strata reads in them is odd."""
    value: Any = rng.choice(FLOATS)
    kind = rng.choice(("deep", "long", "ambient", "strata"))
    if kind == "deep":
        for _ in range(rng.choice((10, 300, 700))):
            value = [value]
    elif kind == "long":
        value = {nasty_text(rng): [value] * 10000}
    else:
        value = {
            "strata": {"ambient": value}
            if kind == "ambient"
            else rng.choice((None, [], "x", {"ambient": "x"}))
        }
    holders = [document, *(document.get("scenes") or []), *(document.get("nodes") or [])]
    holder = rng.choice([holder for holder in holders if isinstance(holder, dict)])
    holder["extras"] = value
    return f"extras are {kind}"


_KINDS: dict[Callable[[Any, random.Random], str], int] = {
    _number: 14,
    _real: 14,
    _reference: 14,
    _tree: 6,
    _layout: 14,
    _text: 8,
    _word: 4,
    _uri: 8,
    _extension: 5,
    _extended: 7,
    _without: 6,
    _doubled: 8,
    _images: 2,
    _kind: 2,
    _exchanged: 4,
    _extras: 4,
}
"""How often each is tried; the first that finds its place is taken."""
