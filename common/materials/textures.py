"""The textures of a list of materials, converted, and the list as it names the files that they became."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.materials.convert import MOST, Converted, Kind, TextureRequest, convert_textures
from common.materials.merge import TextureNames
from common.materials.records import (
    MATERIAL_HEIGHT_MAP,
    NO_TEXTURE,
    SLOTS,
    MaterialList,
    slots_of,
    with_slots,
)

_KINDS: dict[str, Kind] = {
    "occlusion": "data",
    "emissive": "emissive",
    "albedo": "color",
    "metallic_roughness": "data",
    "normal": "normal",
}


def texture_requests(materials: MaterialList) -> list[dict[str, TextureRequest]]:
    """Return by role what each material needs converted: no entry where it has no texture, and none for opacity.

    A map of opacity goes into the alpha of the albedo; without an albedo it makes one that is white. Raises ValueError
    where a slot names no texture of the list.
    """
    requests = []
    for record, names in zip(materials.records, materials.resolved(), strict=True):
        heights = bool(record["flags"] & MATERIAL_HEIGHT_MAP)
        wanted = {}
        for role, kind in _KINDS.items():
            opacity = names["opacity"] if role == "albedo" else ""
            if names[role] or opacity:
                own: Kind = "data" if role == "normal" and heights else kind
                wanted[role] = TextureRequest(names[role], opacity, own)
        requests.append(wanted)
    return requests


def convert_materials(
    materials: MaterialList,
    folder: Path,
    out: Path,
    most: int = MOST,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[MaterialList, list[Converted]]:
    """Convert all textures that materials name relative to `folder` into `out`; return the list with the new names.

    Its slots for opacity are empty. Two materials of one albedo and different maps of opacity have a texture each.

    Raises:
        UserError, ValueError: as `convert_textures` and `texture_requests` do.
    """
    wanted = texture_requests(materials)
    done = convert_textures(
        (request for by_role in wanted for request in by_role.values()), folder, out, most, progress
    )
    names = TextureNames()
    slots = np.full_like(slots_of(materials.records), NO_TEXTURE)
    for number, by_role in enumerate(wanted):
        for column, role in enumerate(SLOTS):
            if role in by_role:
                slots[number, column] = names.add(done[by_role[role]].file)
    return MaterialList(with_slots(materials.records, slots), tuple(names)), list(done.values())
