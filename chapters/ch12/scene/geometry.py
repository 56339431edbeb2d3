"""Where vertices lie: all streams and the indices of a scene in one buffer, each at its own aligned offset."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from common.scene import Pose, Scene

from .packing import Variant

STREAMS: dict[str, tuple[int, int]] = {
    # name: (shader location, floats per vertex)
    "positions": (0, 3),
    "normals": (1, 3),
    "tangents": (2, 4),
    "uv0": (3, 2),
    "uv1": (4, 2),
    "colors": (5, 4),
}

DEFORMED = ("positions", "normals", "tangents")
"""Streams that a skin or morph targets change."""

ALIGNMENT = 256
"""Offset of every stream: a multiple of what any device asks of any use of a buffer."""


def used_streams(variants: list[Variant]) -> list[str]:
    """Return the vertex streams that some variant reads, in the order of their locations."""
    needed = {"positions"}
    for variant in variants:
        for define, stream in (
            ("SHADED", "normals"),
            ("NORMAL_MAP", "tangents"),
            ("TEXTURED", "uv0"),
            ("UV1", "uv1"),
            ("VERTEX_COLOR", "colors"),
        ):
            if variant.has(define):
                needed.add(stream)
    return [name for name in STREAMS if name in needed]


def stream_offsets(sizes: dict[str, int], alignment: int = ALIGNMENT) -> tuple[dict[str, int], int]:
    """Return the aligned byte offset of each stream in a shared buffer, and the buffer's size."""
    offsets: dict[str, int] = {}
    end = 0
    for name, size in sizes.items():
        offsets[name] = (end + alignment - 1) // alignment * alignment
        end = offsets[name] + size
    return offsets, end


def arrays(scene: Scene, streams: list[str]) -> dict[str, np.ndarray]:
    """Return what is uploaded: the streams by name, and "indices"."""
    return {**{name: getattr(scene, name) for name in streams}, "indices": scene.indices}


def deformed(
    scene: Scene, pose: Pose, streams: list[str], offsets: dict[str, int]
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield (byte offset in the shared buffer, bytes) of every run of vertices that `pose` changes."""
    for mesh, changed in pose.vertices.items():
        first = int(scene.meshes["first_vertex"][mesh])
        for name, array in zip(DEFORMED, changed, strict=True):
            if name in streams:
                raw = np.ascontiguousarray(array, np.float32).view(np.uint8).reshape(-1)
                yield offsets[name] + first * 4 * STREAMS[name][1], raw


def deformed_bytes(scene: Scene) -> int:
    """Return how many bytes `deformed` yields at most."""
    vertices = sum(int(scene.meshes["vertex_count"][d.mesh]) for d in scene.deformations)
    return vertices * 4 * sum(STREAMS[name][1] for name in DEFORMED)
