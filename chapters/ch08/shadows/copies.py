"""The parts of drawn faces that a frame copies into pages: entries of `shadow_copies`, round by round. No device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .faces import UNUSED
from .layout import NONE
from .lists import Schedule
from .model import CUBE_FACES, TILE, Places

GROUP_TEXELS = 32
"""Texels along each side of what a work group of store.comp copies."""

GROUPS = TILE // GROUP_TEXELS

Int = NDArray[np.intp]
_NO_ENTRIES = np.zeros((0, 4), np.uint32)


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
        self.words = self.faces = np.zeros(0, np.intp)
        """(N,) The words, and the faces of which they are tiles."""
        self.rounds = self.entries = _NO_ENTRIES
        """(R, 4) and (N, 4) the words of `shadow_rounds` and `shadow_copies` (layout.py)."""

    def choose(self, faces: np.ndarray, due: NDArray[np.bool_], assigned: Int, table: np.ndarray) -> None:
        """Choose all tiles of the faces that are `due` (F,), and those that have memory since this frame."""
        self.rounds = self.entries = _NO_ENTRIES
        wanted = np.zeros(len(table), bool)
        wanted[assigned] = True
        fine = wanted[: self._coarse_word]
        fine |= due[self._face]
        fine &= (table[: self._coarse_word] != NONE) & (faces["light"][self._face] != UNUSED)
        words = np.flatnonzero(fine)
        numbers = self._face[words]
        # Of a face with fewer tiles than words the rest is empty, and so are words of faces that a light does not have.
        coarse = self._coarse + np.arange(CUBE_FACES)[:, None]  # (6, pages)
        coarse = np.minimum(coarse, len(faces) - 1)
        at = self._coarse_word + np.arange(len(self._coarse))
        its_own = faces["first"][coarse] == at
        chosen = (
            its_own & (faces["light"][coarse] != UNUSED) & (table[at] != NONE) & (wanted[at] | due[coarse])
        )
        _, page = np.nonzero(chosen)
        self.words = np.concatenate([words, at[page]])
        self.faces = np.concatenate([numbers, coarse[chosen]])
        tile = self.words - faces["first"][self.faces].astype(np.intp)
        row, column = np.divmod(tile, np.maximum(faces["tiles"][self.faces].astype(np.intp), 1))
        self._tiles = column | row << 16
        self._places = table[self.words]

    def place(self, due: Schedule) -> None:
        """Order what was chosen by rounds, whose layers are known now."""
        if not len(due.faces):
            return
        of_face = np.zeros(int(due.faces.max()) + 1, np.intp)
        of_face[due.faces] = due.places
        layers = of_face[self.faces]
        order = np.argsort(layers, kind="stable")
        layers = layers[order]
        first = np.array([turn.first for turn in due.rounds])
        number = np.searchsorted(first, layers, side="right") - 1
        counts = np.bincount(number, minlength=len(first))
        self.entries = np.stack(
            [
                (layers - first[number]) | self.faces[order] << 16,
                self._tiles[order],
                self._places[order],
                np.zeros(len(order), np.intp),
            ],
            axis=1,
        ).astype(np.uint32)
        self.rounds = np.zeros((len(first), 4), np.uint32)
        self.rounds[:, :2], self.rounds[:, 2] = GROUPS, counts
        self.rounds[:, 3] = np.cumsum(counts) - counts
