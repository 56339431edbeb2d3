"""Lists of materials made one: each texture once, and every slot still means the file that it meant before.

A texture's index is given once and never changes, so that a list that grows invalidates nothing that was handed out:
not the slots of records, not descriptors that were written for them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.materials.records import NO_TEXTURE, RECORD_DTYPE, MaterialList, fault_of, slots_of, with_slots


class TextureNames:
    """A list of names that only grows and holds each of them once. Names are equal if all their characters are."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._places: dict[str, int] = {}
        for name in names:
            self.add(name)

    def add(self, name: str) -> int:
        """Return the index of a name, which is appended if it is new; of an empty name NO_TEXTURE, not -1."""
        return self._places.setdefault(name, len(self._places)) if name else NO_TEXTURE

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)


@dataclass(frozen=True)
class MaterialMerge:
    """One list of materials, and `first` (L,): where those of each list begin in it, in the order that they had."""

    materials: MaterialList
    first: NDArray[np.int64]


def merged(lists: Sequence[MaterialList], names: Sequence[str] = ()) -> MaterialMerge:
    """Return the materials of all lists, one list after another; `names` are for the sentence of an error.

    Textures stand in the order in which they are named first, also those that no material uses. All six slots are
    rewritten, that for opacity too: one that is forgotten goes on to count in the list that it came from. A slot in
    which an empty name stood is empty afterwards.

    Raises:
        SceneError: a slot names no texture of its list, or a number of a record is not what it may be.
    """
    together = TextureNames()
    records = [np.zeros(0, RECORD_DTYPE)]
    for number, materials in enumerate(lists):
        if fault := fault_of(materials.records, len(materials.textures)):
            name = names[number] if number < len(names) else f"material list {number}"
            raise SceneError(f"{name} cannot be merged: {fault}")
        # The last entry is for empty slots, whose number would be far beyond the table.
        new = np.array([*(together.add(texture) for texture in materials.textures), NO_TEXTURE], np.uint64)
        slots = slots_of(materials.records)
        place = np.where(slots == NO_TEXTURE, len(materials.textures), slots).astype(np.int64)
        records.append(with_slots(materials.records, new[place]))
    counts = [len(materials.records) for materials in lists]
    first = np.cumsum([0, *counts], dtype=np.int64)[: len(lists)]
    return MaterialMerge(MaterialList(np.concatenate(records), tuple(together)), first)
