"""Pages of geometry: every stream and index of a scene as words of a few large buffers, from which shaders fetch.

A page is at most 128 MiB, which is what any device lets a shader see of one storage buffer (Vulkan's smallest
`maxStorageBufferRange` is 2^27 bytes, OpenGL's smallest `GL_MAX_SHADER_STORAGE_BLOCK_SIZE` 2^24; devices of today have
at least 2^27). No mesh crosses a page, and draws are grouped by page. Within a page the streams lie one after the
other, so that meshes that share vertices share them here too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import SceneError
from common.scene import Pose, Scene

from . import geometry
from .geometry import STREAMS

PAGE_BYTES = 128 << 20

MESH = np.dtype([("streams", np.uint32, 8)])
"""The record of a mesh in shaders: the first word of each stream in its page, in the order of STREAMS; then that of
its indices, and the number of the page."""

_WORD = 4


@dataclass(frozen=True, eq=False)
class Page:
    """One buffer: the meshes (numbers) whose geometry it holds, which part of the scene's pools that is, and where.

    `vertices` and `indices` are [first, last) in the pools; `offsets` are bytes, by stream and for "indices".
    """

    meshes: np.ndarray
    vertices: tuple[int, int]
    indices: tuple[int, int]
    offsets: dict[str, int]
    size: int


def plan_pages(scene: Scene, streams: Sequence[str], page_bytes: int = PAGE_BYTES) -> list[Page]:
    """Return the pages of a scene, meshes in the order of their vertices; SceneError for a mesh larger than a page."""
    meshes = scene.meshes
    first_vertex = meshes["first_vertex"].astype(np.int64)
    first_index = meshes["first_index"].astype(np.int64)
    starts = np.stack([first_vertex, first_index], axis=1)
    ends = starts + np.stack([meshes["vertex_count"], meshes["index_count"]], axis=1)
    pages: list[Page] = []
    held: list[int] = []
    low, high = np.zeros(2, np.int64), np.zeros(2, np.int64)
    for mesh in np.argsort(first_vertex, kind="stable").tolist():
        wider = (np.minimum(low, starts[mesh]), np.maximum(high, ends[mesh])) if held else None
        if wider is None or _layout(streams, *wider)[1] > page_bytes:
            if held:
                pages.append(_page(streams, held, low, high))
            held, wider = [], (starts[mesh], ends[mesh])
            if _layout(streams, *wider)[1] > page_bytes:
                size = math.ceil(_layout(streams, *wider)[1] / 2**20)
                raise SceneError(
                    f"Mesh {mesh} takes {size} MiB, and a page of geometry holds {page_bytes // 2**20}: "
                    "split it into several."
                )
        held.append(mesh)
        low, high = wider
    if held:
        pages.append(_page(streams, held, low, high))
    return pages


def _layout(streams: Sequence[str], low: np.ndarray, high: np.ndarray) -> tuple[dict[str, int], int]:
    vertices, indices = (high - low).tolist()
    sizes = {name: _WORD * STREAMS[name][1] * vertices for name in streams}
    return geometry.stream_offsets({**sizes, "indices": _WORD * indices})


def _page(streams: Sequence[str], meshes: list[int], low: np.ndarray, high: np.ndarray) -> Page:
    offsets, size = _layout(streams, low, high)
    (first_vertex, first_index), (last_vertex, last_index) = low.tolist(), high.tolist()
    return Page(np.array(meshes), (first_vertex, last_vertex), (first_index, last_index), offsets, size)


def page_arrays(scene: Scene, page: Page) -> Iterator[tuple[int, np.ndarray]]:
    """Yield (byte offset, array) of everything that a page's buffer holds."""
    arrays = geometry.arrays(scene, [name for name in page.offsets if name != "indices"])
    for name, array in arrays.items():
        first, last = page.indices if name == "indices" else page.vertices
        yield page.offsets[name], array[first:last]


def mesh_records(scene: Scene, pages: Sequence[Page]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (M,) MESH records, and by mesh the number of its page and its first index there, (M,) uint32 each."""
    records = np.zeros(len(scene.meshes), MESH)
    page_of = np.zeros(len(records), np.uint32)
    first_index = np.zeros(len(records), np.uint32)
    for number, page in enumerate(pages):
        rows = scene.meshes[page.meshes]
        vertex = rows["first_vertex"].astype(np.int64) - page.vertices[0]
        for place, (name, (_, floats)) in enumerate(STREAMS.items()):
            if name in page.offsets:
                records["streams"][page.meshes, place] = page.offsets[name] // _WORD + floats * vertex
        page_of[page.meshes] = number
        first = rows["first_index"].astype(np.int64) - page.indices[0]
        first_index[page.meshes] = page.offsets["indices"] // _WORD + first
        records["streams"][page.meshes, 6:] = np.stack(
            [first_index[page.meshes], page_of[page.meshes]], axis=1
        )
    return records, page_of, first_index


def deformed(scene: Scene, pose: Pose, pages: Sequence[Page]) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield (page, byte offset in it, bytes) of every run of vertices that `pose` changes."""
    for number, page in enumerate(pages):
        own = {mesh: changed for mesh, changed in pose.vertices.items() if mesh in page.meshes}
        offsets = {
            name: at - page.vertices[0] * _WORD * STREAMS[name][1]
            for name, at in page.offsets.items()
            if name != "indices"
        }
        for offset, raw in geometry.deformed(scene, replace(pose, vertices=own), list(offsets), offsets):
            yield number, offset, raw
