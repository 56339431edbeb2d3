"""The buffer of a frame's shadows, and the places of tiles in the pages; needs no device.

    shadow_of      a word a light record: 0, or 1 + its first face, and its number of faces from bit 24 on
    shadow_drawn   a word a layer of the frame's rounds: bits 0 to 11 the number of a face, 12 to 15 its place among the
                   faces of its light, from 16 on the number of its list; NO_FACE for none
    shadow_lists   a word a list of casters (lists.py): the first face of its light, and the number of its faces from
                   bit 24 on; 0 for none
    shadow_blended a bit for each material: whether it is blended
    shadow_moving  a bit for each instance: whether it is a mover (movers/model.py)
    shadow_rounds  four words a round: the work groups of its copy, and the first word of its first copy in
                   shadow_table
    shadow_asks    four words for each pass that reports what the picture needs: its work groups, 0 if it does not
    shadow_filter  four numbers of the filter (model.filter_words)
    shadow_places  eight numbers: where faces and tiles of suns and lamps are, and the tests of casters
                   (model.place_words)
    shadow_faces   FACE records
    shadow_table   a word a tile of each face: its place in the pages, in tiles; NONE if it has no memory; behind them
                   four words a part of a face that is copied into a page: the layer with the number of the face from
                   bit 16 on, the tile of the face (column, row from bit 16 on), the page, and the page of
                   which it takes the nearer depth, or NONE

A face of `size` texels has (size / TILE)^2 tiles, row by row. The table lets each tile lie anywhere in the pages. A
word has the column in bits 0 to 7, the row in 8 to 15, the layer from 16 on, and COPIED if the frame draws the tile.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .faces import FACE
from .model import bit_words, padded

NO_FACE = 0xFFFFFFFF
"""The word of a layer to which nothing is drawn."""

NONE = 0xFFFFFFFF
"""The word of a tile without memory."""

COPIED = np.uint32(1 << 31)
"""The bit of a tile that the frame draws; set for the view that shows it."""

ASKS, ASK_BYTES = 3, 16

WIDEST = 128
"""Tiles in a row of the pages: 16,384 texels, which is the side of the largest image of every device that is used."""


@dataclass(frozen=True)
class BlockLayout:
    """The byte offsets of the parts, for some lights, faces, materials, instances, copies and tiles."""

    lights: int
    faces: int
    materials: int
    instances: int
    copied: int
    tiles: int

    @cached_property
    def drawn(self) -> int:
        """The first byte of `shadow_drawn`."""
        return 4 * padded(self.lights)

    @cached_property
    def lists(self) -> int:
        """The first byte of `shadow_lists`."""
        return self.drawn + 16 * padded(self.faces)

    @cached_property
    def blended(self) -> int:
        """The first byte of `shadow_blended`."""
        return self.lists + 16 * padded(self.faces)

    @cached_property
    def moving(self) -> int:
        """The first byte of `shadow_moving`."""
        return self.blended + 4 * bit_words(self.materials)

    @cached_property
    def rounds(self) -> int:
        """The first byte of `shadow_rounds`."""
        return self.moving + 4 * bit_words(self.instances)

    @cached_property
    def asks(self) -> int:
        """The first byte of `shadow_asks`."""
        return self.rounds + 32 * padded(self.faces)

    @cached_property
    def filter(self) -> int:
        """The first byte of `shadow_filter`."""
        return self.asks + ASK_BYTES * ASKS

    @cached_property
    def records(self) -> int:
        """The first byte of the records."""
        return self.filter + 48

    @cached_property
    def table(self) -> int:
        """The first byte of the table."""
        return self.records + FACE.itemsize * padded(self.faces)

    @cached_property
    def copies(self) -> int:
        """The first byte of the copies."""
        return self.table + 4 * max(1, self.tiles)

    @cached_property
    def size(self) -> int:
        """Bytes of the whole buffer."""
        return self.copies + 16 * self.copied


def pages_size(tiles: int) -> tuple[int, int]:
    """Return columns and rows of the smallest image with room for some tiles, about as high as it is wide."""
    width = min(WIDEST, max(1, int(np.ceil(np.sqrt(tiles)))))
    return width, max(1, -(-tiles // width))
