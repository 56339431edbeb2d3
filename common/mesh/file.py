"""Packed mesh files: a header of 20 bytes, a record of 152 bytes per mesh, all indices, all vertices.

Loading is four reads and no parsing, since what is in the file is what a GPU is given. A record says where the
triangles of each level of detail begin, as byte offsets into the indices, with the end of the last one after it;
levels share the vertices of their mesh. Indices count from the first vertex of their mesh, which is the offset of its
stream divided by the size of a vertex: the base vertex of a draw. All numbers are little-endian.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.files.regular_files import read_regular
from common.gltf.geometry.pools import MAX_INDICES
from common.mesh.pools import mesh_indices
from common.paths import write_whole
from common.scene import Scene, UInt32

MAGIC = 0x12345678
MAX_LEVELS = 7
"""A record has eight offsets, and the last level needs one more for its end."""
MAX_STREAMS = 8
HEADER_DTYPE = np.dtype(
    [(name, "<u4") for name in ("magic", "mesh_count", "data_start", "index_bytes", "vertex_bytes")]
)
RECORD_DTYPE = np.dtype(
    [
        ("lod_count", "<u4"),
        ("stream_count", "<u4"),
        ("material", "<u4"),
        ("mesh_bytes", "<u4"),  # of all levels and streams
        ("vertex_count", "<u4"),
        ("lod_offset", "<u4", 8),  # bytes into the indices; lod_count + 1 of them are used
        ("padding", "<u4"),  # what follows has 64 bits and begins at a multiple of 8
        ("stream_offset", "<u8", 8),  # bytes into the vertices; a multiple of the size below
        ("stream_element_bytes", "<u4", 8),  # bytes of a vertex in each stream
    ]
)


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds: `records` (M,) RECORD_DTYPE, `indices` (I,) uint32, `vertices` (B,) bytes."""

    records: np.ndarray
    indices: UInt32
    vertices: NDArray[np.uint8]

    def level(self, mesh: int, level: int = 0) -> UInt32:
        """Return the indices (3 T,) of a level of a mesh, relative to its base vertex; a view."""
        start, end = self.records["lod_offset"][mesh, level : level + 2] // 4
        return self.indices[start:end]

    def base_vertex(self, mesh: int, stream: int = 0) -> int:
        """Return what a draw adds to the indices of a mesh."""
        record = self.records[mesh]
        return int(record["stream_offset"][stream]) // int(record["stream_element_bytes"][stream])

    def stream(self, mesh: int, stream: int = 0) -> NDArray[np.uint8]:
        """Return (V, size of a vertex) the bytes of a stream of a mesh; a view."""
        record = self.records[mesh]
        start, size = int(record["stream_offset"][stream]), int(record["stream_element_bytes"][stream])
        return self.vertices[start : start + int(record["vertex_count"]) * size].reshape(-1, size)


def from_scene(
    scene: Scene, levels: Mapping[int, Sequence[UInt32]] | None = None, uv: bool = True, normals: bool = True
) -> MeshFile:
    """Return the meshes of a scene with one stream of float32: position, then uv, then normal.

    `levels` has the levels of detail by mesh, the first being the mesh itself (`common.mesh.lods.lod_chain`); a mesh
    that is not in it has one. A vertex has 12 bytes, 20 with uv, 24 with normals, 32 with both. Meshes that share
    vertices share them in the file.

    Raises:
        ValueError: a mesh has more levels than a record has room for.
    """
    parts = [scene.positions, *([scene.uv0] if uv else []), *([scene.normals] if normals else [])]
    vertices = np.concatenate(parts, axis=1).astype("<f4")
    size = vertices.shape[1] * 4
    records = np.zeros(len(scene.meshes), RECORD_DTYPE)
    pool: list[UInt32] = []
    offset = 0
    for mesh, row in enumerate(scene.meshes):
        chain = (levels or {}).get(mesh) or [mesh_indices(scene, mesh)]
        if len(chain) > MAX_LEVELS:
            raise ValueError(f"mesh {mesh} has {len(chain)} levels of detail, more than {MAX_LEVELS}")
        ends = offset + 4 * np.cumsum([0, *map(len, chain)])
        record = records[mesh]
        record["lod_count"], record["stream_count"], record["material"] = len(chain), 1, row["material"]
        record["vertex_count"] = row["vertex_count"]
        record["lod_offset"][: len(ends)] = ends
        record["stream_offset"][0] = int(row["first_vertex"]) * size
        record["stream_element_bytes"][0] = size
        record["mesh_bytes"] = ends[-1] - offset + int(row["vertex_count"]) * size
        pool += chain
        offset = int(ends[-1])
    indices = np.concatenate([np.zeros(0, "<u4"), *pool]).astype("<u4")
    return MeshFile(records, indices, vertices.reshape(-1).view(np.uint8))


def to_bytes(meshes: MeshFile) -> bytes:
    """Return the bytes of the file."""
    header = np.zeros(1, HEADER_DTYPE)
    start = HEADER_DTYPE.itemsize + meshes.records.nbytes
    header[0] = (MAGIC, len(meshes.records), start, meshes.indices.nbytes, meshes.vertices.nbytes)
    return b"".join(
        part.tobytes() for part in (header, meshes.records, meshes.indices.astype("<u4"), meshes.vertices)
    )


def write_mesh_file(path: str | os.PathLike[str], meshes: MeshFile) -> None:
    """Write a mesh file; a reader sees the old file or the new one, never a part.

    Raises:
        SceneError: the file cannot be written.
    """
    try:
        write_whole(Path(path), to_bytes(meshes))
    except OSError as error:
        raise SceneError(f"{path} cannot be written: {error.strerror or error}") from None


def read_mesh_file(path: str | os.PathLike[str]) -> MeshFile:
    """Return what a mesh file holds, checked so that no draw of it can read outside its own mesh.

    Raises:
        SceneError: the file is missing, cut short, or says something that its bytes do not bear out.
    """
    return from_bytes(read_bytes(path), str(path))


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a file.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        return read_regular(path)
    except OSError as error:
        raise SceneError(f"{path} cannot be read: {error.strerror or error}") from None


def from_bytes(data: bytes, name: str = "the mesh file") -> MeshFile:
    """Return what the bytes of a mesh file hold; `name` begins the sentence of an error.

    Raises:
        SceneError: the bytes are no mesh file, or are damaged.
    """

    def refuse(fault: str) -> SceneError:
        return SceneError(f"{name} {fault}: write it again, or name another file")

    if len(data) < HEADER_DTYPE.itemsize:
        fault = f"has {len(data)} bytes, fewer than the {HEADER_DTYPE.itemsize} of a header"
        raise refuse(fault)
    header = np.frombuffer(data, HEADER_DTYPE, 1)[0]
    magic, count, start, index_bytes, vertex_bytes = (int(value) for value in header.item())
    if magic != MAGIC:
        raise refuse(f"begins with {magic:#010x} instead of {MAGIC:#010x} and is no mesh file")
    if start != HEADER_DTYPE.itemsize + count * RECORD_DTYPE.itemsize:
        raise refuse(f"has its data at byte {start}, which does not fit {count} meshes")
    if len(data) != start + index_bytes + vertex_bytes or index_bytes % 4:
        raise refuse(f"has {len(data)} bytes, and its header speaks of {start + index_bytes + vertex_bytes}")
    meshes = MeshFile(
        np.frombuffer(data, RECORD_DTYPE, count, HEADER_DTYPE.itemsize),
        np.frombuffer(data, "<u4", index_bytes // 4, start),
        np.frombuffer(data, np.uint8, vertex_bytes, start + index_bytes),
    )
    if fault := _fault(meshes):
        raise refuse(fault)
    return meshes


def _fault(meshes: MeshFile) -> str:
    """Return what is wrong with the records, or ""."""
    records = meshes.records
    levels, streams = (records[name].astype(np.int64) for name in ("lod_count", "stream_count"))
    offsets = records["lod_offset"].astype(np.int64)
    sizes, starts = records["stream_element_bytes"].astype(object), records["stream_offset"].astype(object)
    place = np.arange(8)
    checks: tuple[tuple[NDArray[np.bool_], str], ...] = (
        ((levels < 1) | (levels > MAX_LEVELS), f"has not 1 to {MAX_LEVELS} levels of detail"),
        ((streams < 1) | (streams > MAX_STREAMS), f"has not 1 to {MAX_STREAMS} streams"),
    )
    for wrong, fault in checks:
        if wrong.any():
            return f"is damaged: mesh {int(np.argmax(wrong))} {fault}"
    steps = np.where(place[1:] <= levels[:, None], np.diff(offsets, axis=1), 0)
    last = np.take_along_axis(offsets, levels[:, None], axis=1)[:, 0]
    used = place < streams[:, None]
    lengths = records["vertex_count"].astype(object)[:, None] * sizes  # Python's integers do not overflow
    bad_stream = used & ((sizes == 0) | (starts + lengths > len(meshes.vertices)))
    bad_base = used & (starts % np.where(sizes == 0, 1, sizes) != 0)
    total = last - offsets[:, 0] + np.where(used, lengths, 0).sum(axis=1)
    checks = (
        (
            ((steps < 0) | (steps % 12 != 0)).any(axis=1) | (offsets[:, 0] % 4 != 0),
            "has levels that are no whole triangles in order",
        ),
        (last > meshes.indices.nbytes, "has levels beyond the indices of the file"),
        (bad_stream.any(axis=1), "has a stream beyond the vertices of the file"),
        (bad_base.any(axis=1), "has a stream that begins within a vertex"),
        (total != records["mesh_bytes"], "has other sizes than it says"),
    )
    for wrong, fault in checks:
        if wrong.any():
            return f"is damaged: mesh {int(np.argmax(wrong))} {fault}"
    if (last - offsets[:, 0]).sum() > 4 * MAX_INDICES:
        return f"has meshes of more than {MAX_INDICES} indices together"
    for mesh, (first, end) in enumerate(zip(offsets[:, 0] // 4, last // 4, strict=True)):
        if end > first and meshes.indices[first:end].max() >= records["vertex_count"][mesh]:
            return f"is damaged: mesh {mesh} has an index beyond its vertices"
    return ""


def merged(files: Sequence[MeshFile], names: Sequence[str] = ()) -> MeshFile:
    """Return the meshes of all files, one file after another; no index changes, since they count from their mesh.

    Levels begin later by the index bytes of the files before, streams by the vertex bytes. `names` are for the
    sentence of an error.

    Raises:
        SceneError: vertices of different sizes do not fit behind each other, or offsets would pass 32 bits.
    """
    records = [file.records.copy() for file in files]
    index_bytes = vertex_bytes = 0
    for number, (file, own) in enumerate(zip(files, records, strict=True)):
        name = names[number] if number < len(names) else f"mesh file {number}"
        place = np.arange(8)
        if max(index_bytes + file.indices.nbytes, vertex_bytes + file.vertices.nbytes) >= 2**32:
            raise SceneError(
                f"{name} brings the merged file above 4 GiB of indices or vertices: merge fewer files"
            )
        used = place < own["stream_count"][:, None]
        sizes = own["stream_element_bytes"]
        if (used & (vertex_bytes % np.maximum(sizes, 1) != 0)).any():
            raise SceneError(
                f"{name} has vertices of another size than the files before it: write all with the same attributes"
            )
        own["lod_offset"] += np.where(place <= own["lod_count"][:, None], index_bytes, 0).astype(np.uint32)
        own["stream_offset"] += np.where(used, vertex_bytes, 0).astype(np.uint64)
        index_bytes += file.indices.nbytes
        vertex_bytes += file.vertices.nbytes
    return MeshFile(
        np.concatenate([np.zeros(0, RECORD_DTYPE), *records]),
        np.concatenate([np.zeros(0, "<u4"), *(file.indices for file in files)]),
        np.concatenate([np.zeros(0, np.uint8), *(file.vertices for file in files)]),
    )
