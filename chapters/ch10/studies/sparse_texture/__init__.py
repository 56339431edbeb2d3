"""Study: a texture of 1024 x 1024 texels, few with memory, and a page table of the GPU or of the program.

A sparse image has an address for each of its tiles, and memory for those that a queue has bound. A fetch returns a
code that says whether all texels it read have memory. What is read without memory is up to the device, so the code
decides here, and the texel is not looked at: there the picture is grey.

Where there is no sparse residency, the same can be written by hand: a table says for each tile which page of a pool
holds it, or none. A fetch then reads the table first. Both ways give the same picture, bit for bit.

A spot moves over the texture, and the tiles nearest to it have memory. A tile that keeps its memory keeps its content.
Memory that goes to another tile is written anew. With `shared`, the tiles of the first column all have the same page.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="sparse texture",
    idea="A texture has addresses for all its tiles and memory for some; a code tells which texels have any.",
    order=3,
    features=("sparse/page-pool",),
)

TILE = 128
"""Texels along an edge of a tile: with 32 bits each, a page of 64 KiB."""

ACROSS = 8
"""Tiles along an edge of the texture."""

TILES = ACROSS * ACROSS
PAGE_BYTES = 4 * TILE * TILE
NONE = 0xFFFFFFFF
"""The page of a tile without memory."""

FOLDER = "studies/sparse_texture"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNELS = (f"{FOLDER}/fill.comp", f"{FOLDER}/count.comp")

TEXELS = Sampler(mag="nearest", min="nearest", mipmap=None, wrap_u="clamp", wrap_v="clamp")

FILL = np.dtype([("tile", np.uint32), ("page", np.uint32), ("content", np.uint32), ("unused", np.uint32)])
"""A page to write: the tile it belongs to, its number in the pool, and the tile whose pattern it gets."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    pages: int = knob(20, "pages of memory", minimum=1, maximum=TILES)
    shared: bool = knob(True, "whether the tiles of the first column have one page together")
    way: str = knob(
        "sparse", "who translates: the GPU, or a table in the shader", choices=("sparse", "table")
    )


@dataclass
class PageWork(Work):
    """What a frame did: tiles that were `bound` and `unbound`, that have memory after it, and the bytes of the pool."""

    dispatches: int = 0
    bound: int = 0
    unbound: int = 0
    tiles: int = 0
    bytes: int = 0


def wanted(settings: Settings, time: float) -> NDArray[np.bool_]:
    """Return (TILES,) which tiles have memory at a time: the shared ones, and as many as there are pages for, the
    nearest to the spot first.
    """
    y, x = np.divmod(np.arange(TILES), ACROSS)
    middle = 0.5 * ACROSS * (1.0 + 0.55 * np.array([math.cos(time), math.sin(time)]))
    distance = np.hypot(x + 0.5 - middle[0], y + 0.5 - middle[1])
    near = np.zeros(TILES, bool)
    alone = np.arange(TILES)
    if settings.shared:
        near[x == 0] = True
        alone = alone[x > 0]
    nearest = alone[np.argsort(distance[alone], kind="stable")]
    near[nearest[: settings.pages - int(settings.shared)]] = True
    return near


class Residency:
    """Which page each tile has, from frame to frame; `page` is (TILES,) uint32, NONE without memory."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.page = np.full(TILES, NONE, np.uint32)
        self.content = np.arange(TILES, dtype=np.uint32)  # whose pattern a tile shows
        if settings.shared:
            self.content[::ACROSS] = 0

    def update(self, time: float) -> tuple[NDArray[np.intp], np.ndarray]:
        """Give pages to the tiles that are wanted, and return (N,) the tiles whose page is another now, and the FILL
        records of the pages to write.

        A tile that stays keeps its page. Page 0 is the shared one, if there is one.
        """
        before, has = self.page.copy(), wanted(self.settings, time)
        self.page[~has] = NONE
        if self.settings.shared:
            self.page[::ACROSS] = 0
        free = np.setdiff1d(np.arange(self.settings.pages, dtype=np.uint32), self.page)
        new = np.flatnonzero(has & (self.page == NONE))
        self.page[new] = free[: len(new)]
        changed = np.flatnonzero(self.page != before)
        written = changed[(self.page[changed] != NONE) & (self.content[changed] == changed)]
        fills = np.zeros(len(written), FILL)
        fills["tile"], fills["page"], fills["content"] = written, self.page[written], self.content[written]
        return changed, fills

    def table(self) -> np.ndarray:
        """Return (TILES, 2) uint32 for the shaders: the page of each tile, and the tile whose pattern it shows."""
        return np.stack([self.page, self.content], axis=-1)

    def work_of(self, changed: NDArray[np.intp], fills: np.ndarray) -> PageWork:
        """Return the counters of a frame in which these tiles changed."""
        has = self.page != NONE
        return PageWork(
            draws=1,
            triangles=1,
            dispatches=1 + int(len(fills) > 0),
            bound=int(has[changed].sum()),
            unbound=int((~has[changed]).sum()),
            tiles=int(has.sum()),
            bytes=self.settings.pages * PAGE_BYTES,
        )


def defines(sparse: bool) -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders."""
    return (("SPARSE", int(sparse)), ("TILE", TILE), ("ACROSS", ACROSS))


def told(counts: np.ndarray) -> dict[str, int]:
    """Return counters of a frame: texels that have memory by the codes, and those among them with a wrong value."""
    resident, wrong = counts.reshape(TILES, 2).sum(axis=0, dtype=int).tolist()
    return {"resident_texels": resident, "wrong_texels": wrong}
