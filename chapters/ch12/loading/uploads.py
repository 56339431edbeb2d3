"""Images for the copy to the GPU: rows of bytes, made from the pixels of a file on any thread."""

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
    """`rows` has (rows, bytes of a row) uint8 for each level that is copied, level 0 first.

    The GPU makes the further levels of `shape`; with `srgb` it averages linear light.
    """

    name: str
    shape: Shape
    srgb: bool
    rows: tuple[NDArray[np.uint8], ...]

    @property
    def nbytes(self) -> int:
        """The number of bytes to copy."""
        return sum(level.nbytes for level in self.rows)

    def without_bytes(self) -> Upload:
        """Return the same with empty levels, for the work after the copy."""
        return replace(self, rows=(_NOTHING,) * len(self.rows))


_NOTHING = np.zeros((0, 0), np.uint8)


def block_rows(upload: Upload) -> int:
    """Return the number of rows of texels in one row of bytes: more than 1 for block compression."""
    return blocks.BLOCK if blocks.is_compressed(upload.shape.format) else 1


MOST_LEVELS = 16
"""The largest number of levels: no device has images of more than 32768 texels on a side."""


def level_places(levels: Sequence[NDArray[np.uint8]], alignment: int) -> tuple[list[int], int]:
    """Return the offset of each level if all are written in order, and the end of the last one."""
    starts, end = [], 0
    for level in levels:
        starts.append(align_up(end, alignment))
        end = starts[-1] + level.nbytes
    return starts, end


LEVEL_COST = 128 << 10
"""Bytes that take as long to copy as one mip level takes to make: for tiny images, levels are most of the work."""


def cost(upload: Upload) -> int:
    """Return the cost of an image beside its bytes, in bytes of a frame's budget: its creation, and levels to make."""
    return LEVEL_COST * (1 + upload.shape.levels - len(upload.rows))


def is_late(upload: Upload, spent: int, budget: int | None) -> bool:
    """Whether a frame that has spent so much of its budget leaves an image's levels to the next frame."""
    made_here = upload.shape.levels > len(upload.rows)
    return made_here and budget is not None and spent > 0 and spent + cost(upload) > budget


def upload_of(scene: Scene, role: str, key: Key, mended: bool, features: Collection[str]) -> Upload:
    """Return the upload of image `key` for a texture in `role`: the levels in the file, or level 0.

    `features` are the optional features of the device. Runs on any thread. Raises the errors of the image's decoder.
    """
    shape, chain = texels.shape_of(scene, key, features), texels.chain_of(scene, key, features)
    if chain is not None:
        return Upload(scene.images[key[1]].name, shape, key[2], chain.levels)
    image = texels.texels_of(scene, role, key, mended)
    height, width = image.pixels.shape[:2]
    if (width, height) != (shape.width, shape.height):
        raise ValueError(f"it is {width}x{height} pixels now, and was {shape.width}x{shape.height}")
    rows = np.ascontiguousarray(image.pixels).view(np.uint8).reshape(height, -1)
    return Upload(image.name, shape, image.srgb, (rows,))


def upload_bytes(scene: Scene, key: Key) -> int:
    """Return the approximate size of the result of `upload_of`, without decoding."""
    if key[0] == "neutral":
        return 8
    image = scene.images[key[1]]
    return image.width * image.height * (4 if image.dtype == np.uint8 else 8)
