"""Writes small glTF files for tests, byte by byte and without the loader's own code."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "f4")
QUAD = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "f4")
QUAD_INDICES = np.array([0, 1, 2, 0, 2, 3], "u2")


class Gltf:
    """A document in the making: `json` may be changed freely before it is written."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}}
        self.data = bytearray()

    def add(self, name: str, entry: dict[str, Any]) -> int:
        self.json.setdefault(name, []).append(entry)
        return len(self.json[name]) - 1

    def view(self, data: bytes, **entry: Any) -> int:
        self.data += bytes(-len(self.data) % 4)
        start = len(self.data)
        self.data += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **entry})

    def accessor(self, values: Any, dtype: str | None = None, **entry: Any) -> int:
        values = np.asarray(values, dtype)
        values = values.reshape(len(values), -1)
        if values.dtype.itemsize == 8:
            values = values.astype("f4")
        return self.add(
            "accessors",
            {
                "bufferView": self.view(values.astype(values.dtype.newbyteorder("<")).tobytes()),
                "componentType": CODES[values.dtype.str[1:]],
                "count": len(values),
                "type": KINDS[values.shape[1]],
                **entry,
            },
        )

    def primitive(self, indices: Any = None, targets: Any = None, **attributes: Any) -> dict[str, Any]:
        """Upper-case names are attributes, given as arrays or accessor numbers; the others go into the entry."""
        names = {name for name in attributes if name.isupper() or name[-1].isdigit()}
        entry = {key: value for key, value in attributes.items() if key not in names}
        entry["attributes"] = {name: self._number(attributes[name]) for name in sorted(names)}
        if indices is not None:
            entry["indices"] = self._number(indices)
        if targets is not None:
            entry["targets"] = [{k: self._number(v) for k, v in target.items()} for target in targets]
        return entry

    def _number(self, values: Any) -> int:
        return values if isinstance(values, int) else self.accessor(values)

    def mesh(self, *primitives: dict[str, Any], **entry: Any) -> int:
        return self.add("meshes", {"primitives": list(primitives), **entry})

    def node(self, **entry: Any) -> int:
        return self.add("nodes", entry)

    def draw(self, *primitives: dict[str, Any], **node: Any) -> int:
        """Add a mesh and a node for it."""
        return self.node(mesh=self.mesh(*primitives), **node)

    def image(self, pixels: np.ndarray, form: str = "PNG", **entry: Any) -> int:
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, form)
        return self.add(
            "images",
            {"bufferView": self.view(stream.getvalue()), "mimeType": f"image/{form.lower()}", **entry},
        )

    def text(self) -> str:
        root = dict(self.json)
        if self.data and "buffers" not in root:
            root["buffers"] = [{"byteLength": len(self.data)}]
        return json.dumps(root)

    def glb(self) -> bytes:
        return pack_glb(self.text().encode(), bytes(self.data))

    def write(self, folder: Path, form: str = "glb") -> Path:
        """Write as 'glb', 'gltf' (with a .bin) or 'data' (one .gltf with a data URI)."""
        path = folder / f"scene.{'glb' if form == 'glb' else 'gltf'}"
        if form == "glb":
            path.write_bytes(self.glb())
            return path
        root = json.loads(self.text())
        if self.data and form == "gltf":
            (folder / "scene.bin").write_bytes(self.data)
            root["buffers"][0]["uri"] = "scene.bin"
        elif self.data:
            coded = base64.b64encode(self.data).decode()
            root["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{coded}"
        path.write_text(json.dumps(root))
        return path


def pack_glb(text: bytes, data: bytes) -> bytes:
    """Put a JSON text and a binary chunk into a .glb (glTF 2.0, chapter 4)."""
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle() -> Gltf:
    """The smallest scene that draws something."""
    gltf = Gltf()
    gltf.draw(gltf.primitive(POSITION=TRIANGLE))
    return gltf


def everything() -> Gltf:
    """A small file with one of everything that the loader reads."""
    gltf, rng = Gltf(), np.random.default_rng(0)
    image = gltf.image(rng.integers(0, 256, (4, 4, 3)).astype(np.uint8))
    photo = gltf.image(rng.integers(0, 256, (8, 8, 3)).astype(np.uint8), "JPEG")
    sampler = gltf.add("samplers", {"magFilter": 9728, "minFilter": 9986, "wrapS": 33071})
    textures = [gltf.add("textures", {"source": source, "sampler": sampler}) for source in (image, photo)]
    transform = {
        "extensions": {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 2]}}
    }
    material = gltf.add(
        "materials",
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": textures[1], **transform}},
            "normalTexture": {"index": textures[0], "scale": 0.5},
            "emissiveFactor": [1, 0.5, 0],
            "alphaMode": "MASK",
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5}},
        },
    )
    part = gltf.primitive(
        QUAD_INDICES,
        targets=[{"POSITION": QUAD * 0.5}],
        POSITION=QUAD,
        NORMAL=np.tile((0, 0, 1), (4, 1)).astype("f4"),
        TEXCOORD_0=QUAD[:, :2].copy(),
        COLOR_0=gltf.accessor(rng.integers(0, 256, (4, 4)), "u1", normalized=True),
        JOINTS_0=np.tile((0, 1, 0, 0), (4, 1)).astype("u1"),
        WEIGHTS_0=np.tile((0.5, 0.5, 0, 0), (4, 1)).astype("f4"),
        material=material,
    )
    lines = gltf.primitive(POSITION=QUAD, mode=2)
    gltf.add(
        "skins", {"joints": [0, 1], "inverseBindMatrices": gltf.accessor(np.tile(np.eye(4).ravel(), (2, 1)))}
    )
    gltf.node(translation=[0, 1, 0], children=[1])
    gltf.node(rotation=[0, 0.6, 0, 0.8])
    gltf.draw(part, skin=0, weights=[0.25])
    copies = {"attributes": {"TRANSLATION": gltf.accessor(QUAD), "SCALE": gltf.accessor(QUAD + 1)}}
    gltf.node(mesh=gltf.mesh(lines), extensions={"EXT_mesh_gpu_instancing": copies})
    gltf.json["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"outerConeAngle": 1}}]}
    }
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    gltf.node(
        camera=camera, extensions={"KHR_lights_punctual": {"light": 0}}, matrix=np.eye(4).ravel().tolist()
    )
    times = gltf.accessor([0, 0.5, 1], "f4")
    keys = [
        ("rotation", "CUBICSPLINE", gltf.accessor(rng.normal(size=(9, 4)), "f4"), 1),
        ("translation", "STEP", gltf.accessor(rng.normal(size=(3, 3)), "f4"), 0),
        ("weights", "LINEAR", gltf.accessor(rng.random(3), "f4"), 2),
    ]
    samplers = [{"input": times, "output": output, "interpolation": how} for _, how, output, _ in keys]
    channels = [
        {"sampler": number, "target": {"node": node, "path": path}}
        for number, (path, _, _, node) in enumerate(keys)
    ]
    gltf.add("animations", {"samplers": samplers, "channels": channels})
    sparse = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\1\0"), "componentType": 5123},
        "values": {"bufferView": gltf.view(QUAD[2].tobytes())},
    }
    spread = gltf.add("accessors", {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    gltf.draw(gltf.primitive(gltf.accessor([0, 1, 2, 3], "u1"), POSITION=spread, mode=5))
    return gltf
