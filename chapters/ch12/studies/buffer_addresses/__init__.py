"""Study: a hit fetches its vertices by address. Meshes lie anywhere, and a table of addresses is all that shaders know.

A ray may hit any mesh. What a hit shader knows is the number of the instance and of the triangle, so every vertex of
the scene must be in reach. Descriptors can do that if all meshes share a buffer (as the chapter's pages), or by an
array of buffers. Here a table has three 64-bit addresses for each instance: of indices, of positions, and of normals
and colours. The shader adds the offset of a word to an address, makes a pointer from the sum
(GL_EXT_buffer_reference), and reads. The structures are built from the same addresses.

A sum of two 64-bit numbers is one of 32-bit halves with a carry, so no device needs 64-bit integers for that. Nothing
checks where an address leads: `robustBufferAccess` bounds descriptors alone.

The meshes lie in one buffer, behind gaps of a size by lot, each at a multiple of 4 that is no place for a descriptor;
the vertices of each are in an order by lot. The study buffer-address of chapter 2 reads vertices one by one as a draw
asks for them; here every ray asks for another three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.lessons import OWN, Study
from common.scene import Scene
from common.settings import knob

from ..seen import camera_scene

STUDY = Study(
    title="buffer addresses",
    idea="A hit has the number of an instance, a table has its addresses, and vertices may lie anywhere.",
    order=4,
    features=("ray-tracing/buffer-device-address",),
    scene=OWN,
)

FOLDER = "studies/buffer_addresses"
RAYGEN, MISS, CLOSEST = f"{FOLDER}/start.rgen", f"{FOLDER}/sky.rmiss", f"{FOLDER}/fetch.rchit"

ENTRY = np.dtype(
    [("indices", np.uint64), ("positions", np.uint64), ("attributes", np.uint64), ("spare", np.uint64)]
)
"""The entry of an instance in the table: where three parts of its mesh begin."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    meshes: int = knob(12, "meshes, each with a place of its own in memory", minimum=1, maximum=64)


@dataclass(frozen=True)
class Mesh:
    """Indices (T, 3), positions (V, 3), normals (V, 3), and a colour (V,) of four bytes each."""

    indices: NDArray[np.uint32]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    colors: NDArray[np.uint32]

    @property
    def attributes(self) -> NDArray[np.uint32]:
        """Normals and colours as (V, 4) words."""
        return np.concatenate([self.normals.view(np.uint32), self.colors[:, None]], axis=1)


def own_scene() -> Scene:
    """Return a camera before the meshes."""
    return camera_scene("meshes", (0.0, 1.2, 6.5), (0.0, 0.0, 0.0), math.radians(40.0))


def meshes(settings: Settings) -> list[Mesh]:
    """Return spheres with waves, each of another fineness, in rows; their vertices are in an order by lot."""
    random = np.random.default_rng(21)
    columns = math.ceil(math.sqrt(settings.meshes * 4 / 3))
    rows = -(-settings.meshes // columns)
    waved = []
    for number in range(settings.meshes):
        row, column = divmod(number, columns)
        segments, rings = int(random.integers(12, 40)), int(random.integers(8, 24))
        middle = np.array([(column - (columns - 1) / 2), (rows - 1) / 2 - row, 0.0]) * 4.4 / columns
        waved.append(_sphere(random, segments, rings, middle, 1.9 / columns))
    return waved


def _sphere(
    random: np.random.Generator, segments: int, rings: int, middle: NDArray[np.float64], radius: float
) -> Mesh:
    v, u = (it.reshape(-1) for it in np.mgrid[: rings + 1, : segments + 1])
    polar, around = v / rings * np.pi, u / segments * 2 * np.pi
    normals = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=1
    )
    waves = 1 + 0.12 * np.sin(5 * around) * np.sin(polar) ** 2
    corner = v[: -segments - 1] * (segments + 1) + u[: -segments - 1]
    a = corner[u[: -segments - 1] < segments]
    b, c, d = a + 1, a + segments + 1, a + segments + 2
    row = a // (segments + 1)  # at the poles one of two triangles has no area
    upper, lower = row > 0, row < rings - 1
    indices = np.concatenate([np.stack([a, c, b], axis=1)[upper], np.stack([b, c, d], axis=1)[lower]])
    turned = random.permutation(len(v))
    place = np.argsort(turned)  # where each vertex has gone
    colors = random.integers(0, 256, (2, 3)) / 255
    mixed = colors[0] + (colors[1] - colors[0]) * (np.sin(3 * around) * np.sin(polar) > 0)[:, None]
    bytes_ = np.concatenate([np.rint(255 * mixed), np.full((len(v), 1), 255)], axis=1).astype(np.uint8)
    return Mesh(
        place[random.permutation(indices)].astype(np.uint32),
        (middle + radius * waves[:, None] * normals)[turned].astype(np.float32),
        normals[turned].astype(np.float32),
        bytes_[turned].copy().view(np.uint32)[:, 0],
    )


def arena(listed: list[Mesh]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Return the words of the buffer, and (M, 3) the bytes at which the parts of each mesh begin, behind gaps."""
    random = np.random.default_rng(22)
    parts: list[NDArray[np.uint32]] = []
    begins, end = [], 0
    for mesh in listed:
        for part in (mesh.indices, mesh.positions.view(np.uint32), mesh.attributes):
            gap = random.integers(0, 2**32, int(random.integers(1, 40)) | 1, dtype=np.uint32)
            parts += [gap, part.reshape(-1)]
            begins.append(4 * (end + len(gap)))
            end += len(gap) + part.size
    return np.concatenate(parts), np.array(begins).reshape(-1, 3)


def table(begins: NDArray[np.int64], address: int) -> NDArray[np.void]:
    """Return the table of a buffer that lies at `address`: an ENTRY for each mesh."""
    entries = np.zeros(len(begins), ENTRY)
    for name, offsets in zip(("indices", "positions", "attributes"), begins.T, strict=True):
        entries[name] = np.uint64(address) + offsets.astype(np.uint64)
    return entries
