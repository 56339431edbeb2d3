"""Merged lists of materials: against dictionaries of names, for lists by lot and for each of the six slots."""

from __future__ import annotations

import numpy as np
import pytest

from common.errors import SceneError
from common.materials.merge import TextureNames, merged
from common.materials.records import (
    NO_TEXTURE,
    SLOTS,
    MaterialList,
    from_bytes,
    new_records,
    slots_of,
    to_bytes,
)

merging = pytest.mark.feature("materials/merge-lists")


def by_lot(rng: np.random.Generator, count: int, names: tuple[str, ...]) -> MaterialList:
    """Materials whose slots, all six, name any of `names` or nothing."""
    made = new_records(count)
    made["albedo"] = rng.random((count, 4))
    made["flags"] = rng.integers(0, 16, count)
    for name in SLOTS.values():
        slots = rng.integers(-1, len(names), count)
        made[name] = np.where(slots < 0, NO_TEXTURE, slots).astype(np.uint64)
    return MaterialList(made, names)


def meant(one: MaterialList) -> list[list[str]]:
    """The file in each slot, slot by slot: what must not change. Written without the code's own way to them."""
    return [
        ["" if int(record[f]) == 0xFFFFFFFF else one.textures[int(record[f])] for f in SLOTS.values()]
        for record in one.records
    ]


LISTS = [
    by_lot(np.random.default_rng(seed), count, names)
    for seed, (count, names) in enumerate(
        [
            (20, ("wood.png", "stone.png", "leaf.png")),
            (0, ("never.png",)),
            (30, ("leaf.png", "wood.PNG", "wood.png", "", "größe.png", "leaf.png")),
            (5, ()),
            (25, ("größe.png", "a/stone.png", "stone.png")),
        ]
    )
]


@merging
def test_every_slot_means_the_file_that_it_meant_before():
    done = merged(LISTS)
    assert meant(done.materials) == [slots for one in LISTS for slots in meant(one)]
    assert done.first.tolist() == [0, 20, 20, 50, 55] and len(done.materials.records) == 80
    for field in ("albedo", "flags", "opacity", "emissive"):
        assert np.array_equal(
            done.materials.records[field], np.concatenate([o.records[field] for o in LISTS])
        )
    names = done.materials.textures
    assert names == (
        "wood.png",
        "stone.png",
        "leaf.png",
        "never.png",
        "wood.PNG",
        "größe.png",
        "a/stone.png",
    )
    assert done.materials.resolved() == [dict(zip(SLOTS, one, strict=True)) for one in meant(done.materials)]
    assert meant(from_bytes(to_bytes(done.materials))) == meant(done.materials)


@merging
def test_a_list_more_changes_no_index_that_was_given():
    for count in range(1, len(LISTS)):
        before, after = merged(LISTS[:count]).materials, merged(LISTS[: count + 1]).materials
        assert after.textures[: len(before.textures)] == before.textures
        assert np.array_equal(slots_of(after.records)[: len(before.records)], slots_of(before.records))
    nested = merged([merged(LISTS[:3]).materials, merged(LISTS[3:]).materials])
    assert to_bytes(nested.materials) == to_bytes(merged(LISTS).materials)
    assert to_bytes(merged([LISTS[0]]).materials) == to_bytes(LISTS[0])
    assert to_bytes(merged([]).materials) == to_bytes(MaterialList(new_records(0)))


@merging
def test_equal_names_share_one_index_for_ever():
    rng = np.random.default_rng(5)
    texts = [f"{stem}.png" for stem in rng.integers(0, 60, 500)]
    names, given = TextureNames(), {}
    for text in texts:
        index = names.add(text)
        assert given.setdefault(text, index) == index
        assert list(names)[index] == text
    assert sorted(given.values()) == list(range(len(names))) == list(range(len(set(texts))))
    assert list(names) == list(dict.fromkeys(texts))
    assert [TextureNames(names).add(text) for text in given] == list(given.values())


@merging
def test_an_empty_name_is_no_texture_and_no_minus_one():
    names = TextureNames(["a.png"])
    assert names.add("") == NO_TEXTURE == 0xFFFFFFFF and len(names) == 1 and "" not in list(names)
    made = new_records(1)
    made["normal_texture"] = names.add("")
    assert meant(merged([MaterialList(made, tuple(names))]).materials) == [[""] * 6]


@merging
@pytest.mark.parametrize("slot", [3, 2**32, 2**64 - 1])
@pytest.mark.parametrize("role", SLOTS)
def test_a_slot_that_names_nothing_is_refused(slot, role):
    """A -1 of 64 bits among them, which is not the guard."""
    made = LISTS[0].records.copy()
    made[SLOTS[role]][7] = slot
    with pytest.raises(
        SceneError,
        match=rf"^b.mtl cannot be merged: material 7 has a slot for {role} that names none of the 3 textures$",
    ):
        merged([LISTS[0], MaterialList(made, LISTS[0].textures)], ["a.mtl", "b.mtl"])
