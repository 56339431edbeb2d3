"""An image as it is copied to the GPU: rows of bytes, made from a file's pixels on any thread."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.images import blocks
from common.numerics.allocators import align_up
from common.scene import Scene

from ..scene.textures import texels
from ..scene.textures.texels import Key, Shape


@dataclass(frozen=True, eq=False)
class Upload:
    """`rows` are those of each level that is copied, level 0 first: (rows, bytes of a row) uint8.

    Where `shape` has more levels than there are `rows`, the GPU makes them; `srgb` says that it averages light.
    """

    name: str
    shape: Shape
    srgb: bool
    rows: tuple[NDArray[np.uint8], ...]

    @property
    def nbytes(self) -> int:
        """Bytes to copy."""
        return sum(level.nbytes for level in self.rows)

    def without_bytes(self) -> Upload:
        """Return the same with as many levels and nothing in them: for what is still to be done after the copy."""
        return replace(self, rows=(_NOTHING,) * len(self.rows))


_NOTHING = np.zeros((0, 0), np.uint8)


def block_rows(upload: Upload) -> int:
    """Return how many rows of texels one row of bytes holds."""
    return blocks.BLOCK if blocks.is_compressed(upload.shape.format) else 1


MOST_LEVELS = 16
"""Of an image: no device takes a side of more than 32768 texels."""


def level_places(levels: Sequence[NDArray[np.uint8]], alignment: int) -> tuple[list[int], int]:
    """Return where each level begins when they are written one behind the other, and where the last one ends."""
    starts, end = [], 0
    for level in levels:
        starts.append(align_up(end, alignment))
        end = starts[-1] + level.nbytes
    return starts, end


LEVEL_COST = 128 << 10
"""Bytes that a frame could copy in the time in which it makes one mip level: of tiny images those are the work."""


def cost(upload: Upload) -> int:
    """Return what an image takes of a frame's budget beside its bytes: for making it, and the levels not copied."""
    return LEVEL_COST * (1 + upload.shape.levels - len(upload.rows))


def is_late(upload: Upload, spent: int, budget: int | None) -> bool:
    """Whether a frame that has spent so much of its budget leaves an image's levels to the next one."""
    made_here = upload.shape.levels > len(upload.rows)
    return made_here and budget is not None and spent > 0 and spent + cost(upload) > budget


def upload_of(scene: Scene, role: str, key: Key, mended: bool, features: Collection[str]) -> Upload:
    """Return what is copied for `key`, which some texture in `role` has: a chain that the image brings, or level 0.

    `features` are the optional ones of the device.
    For any thread. Raises what the image's decoder raises.
    """
    shape, chain = texels.shape_of(scene, key, features), texels.chain_of(scene, key, features)
    if chain is not None:
        return Upload(scene.images[key[1]].name, shape, key[2], chain.levels)
    made = texels.texels_of(scene, role, key, mended)
    height, width = made.pixels.shape[:2]
    if (width, height) != (shape.width, shape.height):
        raise ValueError(f"it is {width}x{height} pixels now, and was {shape.width}x{shape.height}")
    rows = np.ascontiguousarray(made.pixels).view(np.uint8).reshape(height, -1)
    return Upload(made.name, shape, made.srgb, (rows,))


def upload_bytes(scene: Scene, key: Key) -> int:
    """Return about how many bytes `upload_of` will return, as far as that is known before."""
    if key[0] == "neutral":
        return 8
    image = scene.images[key[1]]
    return image.width * image.height * (4 if image.dtype == np.uint8 else 8)
