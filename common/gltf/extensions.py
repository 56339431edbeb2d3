"""What a glTF file uses beyond the standard, where, and what Strata draws in its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from common.gltf.document import REQUIRED_ADVICE, SUPPORTED

_LOBE = "the metallic-roughness surface without it"
INSTEAD: Mapping[str, str] = MappingProxyType(
    {
        "EXT_lights_image_based": "light from --environment FILE alone",
        "EXT_meshopt_compression": "the uncompressed data, where the file has it as well",
        "EXT_texture_webp": "the PNG or JPEG that the texture names as well; without one, no texture",
        "KHR_animation_pointer": "what it moves stands still",
        "KHR_draco_mesh_compression": "the uncompressed data, where the file has it as well",
        "KHR_materials_anisotropy": "highlights that are round",
        "KHR_materials_clearcoat": "the surface below the coat",
        "KHR_materials_diffuse_transmission": "no light that comes through",
        "KHR_materials_dispersion": _LOBE,
        "KHR_materials_ior": "an index of refraction of 1.5",
        "KHR_materials_iridescence": _LOBE,
        "KHR_materials_pbrSpecularGlossiness": "its metallic-roughness surface, or rough white metal",
        "KHR_materials_sheen": _LOBE,
        "KHR_materials_specular": "a reflectance of 4 % head-on for all that is no metal",
        "KHR_materials_transmission": "a surface that lets nothing through but by its alpha",
        "KHR_materials_variants": "the material that each mesh names",
        "KHR_materials_volume": "a surface without anything inside",
        "KHR_node_visibility": "every node, hidden ones too",
        "KHR_texture_basisu": "the PNG or JPEG that the texture names as well; without one, no texture",
        "KHR_xmp_json_ld": "the same: it tells about the file and draws nothing",
        "MSFT_lod": "the finest level, always",
        "MSFT_texture_dds": "the PNG or JPEG that the texture names as well; without one, no texture",
    }
)
"""What is drawn of a file that uses an extension which the loader ignores."""
UNKNOWN = "what the standard alone says of it"


@dataclass(frozen=True)
class ExtensionUse:
    """An extension that a file names: whether it is required, how many objects of which lists have it.

    `instead` is what is drawn in its place, "" where Strata has it; `advice` is what to do if nothing can be drawn.
    """

    name: str
    required: bool
    uses: Mapping[str, int]
    instead: str

    @property
    def supported(self) -> bool:
        """Whether Strata draws it."""
        return self.name in SUPPORTED

    @property
    def advice(self) -> str:
        """What to do, where the file cannot be drawn without it."""
        return REQUIRED_ADVICE.get(self.name, "export it without this extension")


def extensions_of(root: Mapping[str, Any]) -> list[ExtensionUse]:
    """Return the extensions of a document, by name: those that it lists and those that its objects have.

    `root` may be any JSON object: what has not the form of glTF is passed over.
    """
    required, listed = _names(root.get("extensionsRequired")), _names(root.get("extensionsUsed"))
    uses: dict[str, dict[str, set[object]]] = {}
    for part, entries in root.items():
        objects = enumerate(entries) if isinstance(entries, list) else [(0, entries)]
        for number, entry in objects:
            for name in _inside({part: entry} if part == "extensions" else entry):
                uses.setdefault(name, {}).setdefault(part, set()).add(number)
    return [
        ExtensionUse(
            name,
            name in required,
            {part: len(numbers) for part, numbers in uses.get(name, {}).items() if part != "extensions"},
            "" if name in SUPPORTED else INSTEAD.get(name, UNKNOWN),
        )
        for name in sorted({*required, *listed, *uses})
    ]


def _names(value: Any) -> set[str]:
    return {name for name in value if isinstance(name, str)} if isinstance(value, list) else set()


def _inside(value: Any) -> Iterator[str]:
    """Give the names in all objects called `extensions` in a JSON value, at any depth; `extras` are the user's own."""
    stack = [value]
    while stack:
        item = stack.pop()
        if isinstance(item, list):
            stack.extend(item)
        elif isinstance(item, dict):
            extensions = item.get("extensions")
            if isinstance(extensions, dict):
                yield from (name for name in extensions if isinstance(name, str))
            stack.extend(inner for key, inner in item.items() if key != "extras")
