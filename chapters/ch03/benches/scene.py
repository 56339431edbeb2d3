"""A scene that is large on disk and in memory: squares, each with a texture of its own in a PNG file."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

SIDE = 2048
"""Pixels along a side of a texture: 16.8 MB decoded."""

COUNT = 30
"""Textures: 503 MB decoded."""

_CELL = 16
"""Pixels between two random colours; pixels between them are interpolated, with a little noise on top."""


def write(folder: Path, count: int = COUNT, side: int = SIDE) -> Path:
    """Write `count` squares with textures of `side` x `side` pixels into a folder; return the .gltf file.

    The textures compress as pictures do: smooth, with noise of a few codes. The same call writes the same pixels.
    """
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda number: _write_picture(folder / f"{number}.png", number, side), range(count)))
    positions = np.array([(0, 0, 0), (0.9, 0, 0), (0.9, 0.9, 0), (0, 0.9, 0)], "<f4")
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "<f4")
    indices = np.array([0, 1, 2, 0, 2, 3], "<u2")
    parts = [array.tobytes() for array in (positions, uv, indices)]
    (folder / "squares.bin").write_bytes(b"".join(parts))
    offsets = np.cumsum([0, *map(len, parts)]).tolist()
    columns = int(np.ceil(np.sqrt(count)))
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "squares.bin", "byteLength": offsets[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
            for offset, part in zip(offsets, parts, strict=False)
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 4,
                "type": "VEC3",
                "min": positions.min(axis=0).tolist(),
                "max": positions.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "images": [{"uri": f"{number}.png"} for number in range(count)],
        "textures": [{"source": number} for number in range(count)],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}} for number in range(count)
        ],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": number}
                ]
            }
            for number in range(count)
        ],
        "nodes": [
            {"mesh": number, "translation": [float(number % columns), float(number // columns), 0.0]}
            for number in range(count)
        ],
        "scenes": [{"nodes": list(range(count))}],
        "scene": 0,
    }
    path = folder / "squares.gltf"
    path.write_text(json.dumps(document), "utf-8")
    return path


def _write_picture(path: Path, seed: int, side: int) -> None:
    random = np.random.default_rng(seed)
    cells = Image.fromarray(random.integers(0, 256, (side // _CELL, side // _CELL, 3), np.uint8))
    smooth = np.asarray(cells.resize((side, side), Image.Resampling.BICUBIC)).astype(np.int16)
    noisy = np.clip(smooth + random.integers(-2, 3, smooth.shape, np.int16), 0, 255).astype(np.uint8)
    Image.fromarray(noisy).save(path, compress_level=1)
