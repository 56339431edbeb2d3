"""The chains of levels of detail of a scene's meshes, made once and kept in the user's cache."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.files.blobs import BlobError, read_blob, write_blob
from common.files.disk_cache import mark_read, prune
from common.mesh import lods, metrics, optimize
from common.mesh.lods import MAX_FURTHER_LEVELS, lod_chain
from common.paths import cache_dir, write_whole
from common.scene import Scene, UInt32

FOLDER = "levels"
VERSION = 1
MOST_BYTES = 1 << 30

Chain = list[tuple[UInt32, float]]
"""The further levels of a mesh: indices (3 T,) of its own vertices, and the distance as a fraction of the extent."""


def kept_chains(scene: Scene, meshes: Sequence[int], kept: bool = True) -> list[Chain]:
    """Return the chain of each of these meshes: from the cache, or made and then kept; without a cache unless `kept`.

    A cache that cannot be read or written costs time and nothing else.

    Raises:
        UserError: the package `meshoptimizer` is not installed.
    """
    folder, key = (cache_dir(FOLDER), _key(scene, meshes)) if kept else (None, "")
    if folder is not None and (chains := _read(folder / f"{key}.blob")) is not None:
        return chains
    chains = [
        [(level.indices, level.distance) for level in lod_chain(scene, mesh, MAX_FURTHER_LEVELS)[1:]]
        for mesh in meshes
    ]
    if folder is not None and meshes:
        _write(folder / f"{key}.blob", chains)
    return chains


def _key(scene: Scene, meshes: Sequence[int]) -> str:
    """Return a hash of what a chain follows from: vertices, triangles, and the code here that makes it."""
    digest = hashlib.sha256(str(VERSION).encode())
    for module in (lods, metrics, optimize):
        digest.update(Path(str(module.__file__)).read_bytes())
    streams = (scene.positions, scene.normals, scene.tangents, scene.uv0, scene.uv1, scene.colors)
    chosen = np.array(meshes, np.int64)
    rows = scene.meshes[["first_index", "index_count", "first_vertex", "vertex_count"]]
    for array in (*streams, scene.indices, rows, chosen):
        if array is not None:
            digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
        digest.update(b";")
    return digest.hexdigest()


def _read(path: Path) -> list[Chain] | None:
    try:
        data = path.read_bytes()
        checked, checksum = data[:-32], data[-32:]
        if hashlib.sha256(checked).digest() != checksum:
            return None
        kept = read_blob(checked, VERSION)
        mark_read(path)
    except (OSError, BlobError):
        return None
    parts = np.split(kept["indices"], np.cumsum(kept["sizes"])[:-1])
    levels = list(zip(parts, kept["distances"].tolist(), strict=True)) if len(kept["sizes"]) else []
    ends = np.cumsum(kept["counts"])
    return [
        levels[end - count : end] for end, count in zip(ends.tolist(), kept["counts"].tolist(), strict=True)
    ]


def _write(path: Path, chains: list[Chain]) -> None:
    levels = [level for chain in chains for level in chain]
    value = {
        "counts": np.array([len(chain) for chain in chains], np.int64),
        "sizes": np.array([len(indices) for indices, _ in levels], np.int64),
        "distances": np.array([distance for _, distance in levels], np.float64),
        "indices": np.concatenate([indices for indices, _ in levels]) if levels else np.zeros(0, np.uint32),
    }
    prune(path.parent, MOST_BYTES)
    data = write_blob(value, VERSION)
    with contextlib.suppress(OSError):
        write_whole(path, data + hashlib.sha256(data).digest())
