"""The parts of drawn faces that a frame copies into pages: the copies of each round. No device."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..shadows.faces import UNUSED
from ..shadows.layout import NONE
from ..shadows.lists import Schedule
from ..shadows.model import CUBE_FACES, TILE, Places

GROUP_TEXELS = 32
"""Texels along each side of what a work group of store.comp copies."""

GROUPS = TILE // GROUP_TEXELS

Int = NDArray[np.intp]
_NO_ENTRIES = np.zeros((0, 4), np.uint32)


class Due(NamedTuple):
    """(F,) Which faces show other casters than before, movers apart; which show movers elsewhere; which touch any."""

    still: NDArray[np.bool_]
    moved: NDArray[np.bool_]
    touched: NDArray[np.bool_]


class Copies:
    """What is copied in a frame: the words of tiles, each with its face."""

    def __init__(self, places: Places) -> None:
        self._coarse_word = places.coarse_word
        cascades = np.arange(places.suns)[:, None] * places.sun_stride + np.arange(places.cascades)
        lamps = places.first_lamp + np.arange(places.lamps)[:, None] * places.lamp_stride
        of_words = [
            np.repeat(cascades.reshape(-1), places.sun_side**2),
            np.repeat((lamps + np.arange(CUBE_FACES)).reshape(-1), places.lamp_side**2),
        ]
        self._face = np.concatenate(of_words)
        suns = np.arange(places.suns) * places.sun_stride + places.cascades
        first = lamps[:, 0] + places.coarse * CUBE_FACES
        self._coarse = np.concatenate([suns, first])  # the first face of each coarse page
        self.words = np.zeros(0, np.intp)
        """(N,) The words of the table whose tiles are drawn."""
        self.faces = np.zeros(0, np.intp), np.zeros(0, np.intp)
        """The faces that are drawn: with casters that stand still, and with movers."""
        self.rounds = self.entries = _NO_ENTRIES
        """(R, 4) and (N, 4) the words of rounds and of copies (layout.py)."""

    def choose(self, faces: np.ndarray, due: Due, assigned: Int, table: np.ndarray) -> None:
        """Choose what is drawn to which tiles; `assigned` are the words that have memory since this frame.

        `table` has the tiles of all words, and behind them those without movers. A tile that has both is drawn without
        movers to the second, and joined with movers into the first. Else its face is drawn twice into one tile.
        """
        self.rounds = self.entries = _NO_ENTRIES
        count = len(table) // 2
        shown, kept = table[:count], table[count:]
        new = np.zeros(len(table), bool)
        new[assigned] = True
        words, numbers = self._held(faces, shown)
        has_kept, is_new = kept[words] != NONE, new[words] | new[words + count]
        still = due.still[numbers] | is_new | (due.moved[numbers] & ~has_kept)
        moving = due.moved[numbers] | (still & (has_kept | due.touched[numbers]))
        self._chosen = []
        for chosen, movers in ((still, False), (moving, True)):
            word, number = words[chosen], numbers[chosen]
            tile = word - faces["first"][number].astype(np.intp)
            row, column = np.divmod(tile, np.maximum(faces["tiles"][number].astype(np.intp), 1))
            apart = np.where(kept[word] != NONE, kept[word], shown[word])
            to, source = (shown[word], apart) if movers else (apart, np.full(len(word), NONE, np.uint32))
            self._chosen.append((number, column | row << 16, to, source))
        self.words = words[still | moving]
        self.faces = np.unique(self._chosen[0][0]), np.unique(self._chosen[1][0])

    def _held(self, faces: np.ndarray, shown: np.ndarray) -> tuple[Int, Int]:
        """Return the words with memory that are tiles of faces, and these faces; six of a cube share a coarse page."""
        fine = shown[: self._coarse_word] != NONE
        # Of a face with fewer tiles than words the rest has no memory, nor have faces that a light does not have.
        words = np.flatnonzero(fine & (faces["light"][self._face] != UNUSED))
        coarse = np.minimum(self._coarse + np.arange(CUBE_FACES)[:, None], len(faces) - 1)  # (6, pages)
        at = self._coarse_word + np.arange(len(self._coarse))
        own = (faces["first"][coarse] == at) & (faces["light"][coarse] != UNUSED) & (shown[at] != NONE)
        _, page = np.nonzero(own)
        return np.concatenate([words, at[page]]), np.concatenate([self._face[words], coarse[own]])

    def place(self, rounds: Schedule, still: int) -> None:
        """Order what was chosen by rounds, whose layers are known now.

        The first `still` of `rounds.faces` are drawn without movers, the others with nothing else.
        """
        entries, all_layers = [], []
        for part, (number, tile, to, source) in zip(
            (slice(still), slice(still, None)), self._chosen, strict=True
        ):
            of_face = np.zeros(int(number.max(initial=0)) + 1, np.intp)
            of_face[rounds.faces[part]] = rounds.places[part]
            layer = of_face[number]
            order = np.argsort(layer, kind="stable")
            entries.append(np.stack([number, tile, to, source], axis=1)[order])
            all_layers.append(layer[order])
        layers, rows = np.concatenate(all_layers), np.concatenate(entries)
        first = np.array([turn.first for turn in rounds.rounds])
        number = np.searchsorted(first, layers, side="right") - 1
        counts = np.bincount(number, minlength=len(first))
        self.entries = rows.astype(np.uint32)
        self.entries[:, 0] = (layers - first[number]) | rows[:, 0].astype(np.intp) << 16
        self.rounds = np.zeros((len(first), 4), np.uint32)
        self.rounds[:, :2], self.rounds[:, 2] = GROUPS, counts
        self.rounds[:, 3] = np.cumsum(counts) - counts
