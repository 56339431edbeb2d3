"""Lists of textured, clipped triangles as user interfaces make them: a plain record that either backend draws.

Nothing here knows which library made a list, so a recorded one is a test fixture like any other.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.paths import write_whole

VERTEX = np.dtype([("position", "<f4", 2), ("uv", "<f4", 2), ("color", "u1", 4)])
"""One vertex, 20 bytes: place in the list's units, texture coordinates, and display codes with straight alpha."""

FONT = 0
"""The texture of the glyphs, which every list may use."""

GREY = 1 << 16
"""Added to a texture's number it shows the texture's red as grey and opaque: for depth, masks and tables."""

Clip = tuple[float, float, float, float]


@dataclass(frozen=True)
class Command:
    """Triangles with one texture inside one rectangle: `count` indices from `first` on, each plus `base`.

    `clip` is left, top, right and bottom in the list's units.
    """

    clip: Clip
    texture: int
    first: int
    count: int
    base: int = 0


@dataclass(frozen=True, eq=False)
class TextureUpdate:
    """Pixels (h, w, 4) uint8 that replace a part of a texture from (x, y) on, row 0 on top.

    `size` is the (width, height) of the whole texture; one that has another size, or none yet, is made anew.
    """

    texture: int
    size: tuple[int, int]
    pixels: NDArray[np.uint8]
    x: int = 0
    y: int = 0

    def __post_init__(self) -> None:
        """Refuse pixels that do not lie inside the texture."""
        height, width = self.pixels.shape[:2]
        inside = 0 <= self.x <= self.size[0] - width and 0 <= self.y <= self.size[1] - height
        if self.pixels.shape != (height, width, 4) or self.pixels.dtype != np.uint8 or not inside:
            raise ValueError(
                f"pixels {self.pixels.shape} {self.pixels.dtype} at ({self.x}, {self.y}) are no part of a texture "
                f"of {self.size[0]}x{self.size[1]}"
            )

    @property
    def whole(self) -> bool:
        """Whether nothing of an older texture is left."""
        return self.pixels.shape[1::-1] == self.size


@dataclass(frozen=True, eq=False)
class DrawList:
    """What is drawn over a picture, in the order of its commands.

    `extent` (width, height) from `origin` on, in the units of the vertices, covers the whole target; y points down.
    `vertices` (N,) VERTEX and `indices` (M,) uint32 belong to all commands together. Drawing blends display codes:
    rgb = source * alpha + target * (1 - alpha), alpha = source + target * (1 - source).
    """

    extent: tuple[float, float]
    vertices: NDArray[Any] = field(default_factory=lambda: np.zeros(0, VERTEX))
    indices: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    commands: tuple[Command, ...] = ()
    updates: tuple[TextureUpdate, ...] = ()
    dropped: tuple[int, ...] = ()  # textures that no list will use again
    origin: tuple[float, float] = (0.0, 0.0)

    def transform(self) -> NDArray[np.float32]:
        """Return (4,) scale and offset that take positions to clip coordinates, -1 at the left and at the top."""
        scale = 2.0 / np.asarray(self.extent, np.float64)
        offset = -1.0 - np.asarray(self.origin, np.float64) * scale
        return np.concatenate([scale, offset]).astype(np.float32)

    def scissor(self, command: Command, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
        """Return x, y, width and height in pixels of a command's clip on a target of `size`; None where it is empty.

        Edges go to the nearest pixel, so that clips that touch neither overlap nor leave a gap, whatever the scale.
        """
        edges = []
        for axis in (0, 1):
            scale = size[axis] / self.extent[axis]
            for edge in (command.clip[axis], command.clip[axis + 2]):
                edges.append(min(max(round((edge - self.origin[axis]) * scale), 0), size[axis]))
        left, right, top, bottom = edges
        return (left, top, right - left, bottom - top) if left < right and top < bottom else None

    def check(self) -> None:
        """Raise ValueError for a command that reaches outside the indices or vertices, before a GPU reads there."""
        if self.vertices.dtype != VERTEX or self.indices.dtype != np.uint32:
            raise ValueError(
                f"vertices {self.vertices.dtype} and indices {self.indices.dtype} are of other types"
            )
        for number, command in enumerate(self.commands):
            end = command.first + command.count
            if not 0 <= command.first <= end <= len(self.indices) or command.count % 3:
                raise ValueError(
                    f"command {number} uses indices {command.first} to {end} of {len(self.indices)}"
                )
            used = self.indices[command.first : end]
            if used.size and not 0 <= command.base <= int(used.max()) + command.base < len(self.vertices):
                raise ValueError(f"command {number} uses a vertex outside the {len(self.vertices)} there are")


# --- on disk ----------------------------------------------------------------------------------------------------------


def save(path: Path, recorded: DrawList) -> None:
    """Write a list as .npz."""
    commands = np.array(
        [(*c.clip, c.texture, c.first, c.count, c.base) for c in recorded.commands], np.float64
    )
    arrays: dict[str, Any] = {
        "extent": np.array([*recorded.extent, *recorded.origin]),
        "vertices": recorded.vertices,
        "indices": recorded.indices,
        "commands": commands.reshape(-1, 8),
        "dropped": np.array(recorded.dropped, np.int64),
    }
    for number, update in enumerate(recorded.updates):
        arrays[f"update{number}"] = np.array([update.texture, *update.size, update.x, update.y])
        arrays[f"pixels{number}"] = update.pixels
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)
    write_whole(path, data.getvalue())


def load(path: Path) -> DrawList:
    """Return the list in a file that `save` wrote; raises ValueError if its parts do not fit together."""
    with np.load(path, allow_pickle=False) as arrays:
        extent = [float(value) for value in arrays["extent"]]
        commands = tuple(
            Command((row[0], row[1], row[2], row[3]), *(int(value) for value in row[4:]))
            for row in arrays["commands"].tolist()
        )
        updates: list[TextureUpdate] = []
        while f"update{len(updates)}" in arrays:
            number = len(updates)
            texture, width, height, x, y = (int(value) for value in arrays[f"update{number}"])
            updates.append(TextureUpdate(texture, (width, height), arrays[f"pixels{number}"], x, y))
        draw_list = DrawList(
            (extent[0], extent[1]),
            arrays["vertices"],
            arrays["indices"],
            commands,
            tuple(updates),
            tuple(arrays["dropped"].tolist()),
            (extent[2], extent[3]),
        )
    draw_list.check()
    return draw_list
