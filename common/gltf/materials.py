"""Materials, textures and samplers of a glTF file as `common.scene` has them, and which images they need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from common.gltf.document import Document, Object
from common.scene import AlphaMode, Material, Sampler, TextureRef

Filter = Literal["nearest", "linear"]
Wrap = Literal["repeat", "clamp", "mirror"]

_MIN_FILTERS: dict[int | None, tuple[Filter, Filter | None]] = {
    9728: ("nearest", None),
    9729: ("linear", None),
    9984: ("nearest", "nearest"),
    9985: ("linear", "nearest"),
    9986: ("nearest", "linear"),
    9987: ("linear", "linear"),
    None: ("linear", "linear"),
}
"""minFilter -> (filter inside a level, filter between levels)."""
_WRAPS: dict[int | None, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat", None: "repeat"}
_ALPHA_MODES: dict[str, AlphaMode] = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}

_SLOTS = 2  # uv sets that a vertex carries


@dataclass(frozen=True)
class MaterialKey:
    """A material as a primitive needs it: number in the file (None: the default one), and `unlit` forced."""

    index: int | None
    unlit: bool = False


def texture_infos(entry: Object) -> list[Object]:
    """Return the texture uses of a material, as JSON."""
    surface = entry.get("pbrMetallicRoughness") or {}
    uses = (
        surface.get("baseColorTexture"),
        surface.get("metallicRoughnessTexture"),
        entry.get("normalTexture"),
        entry.get("occlusionTexture"),
        entry.get("emissiveTexture"),
    )
    return [use for use in uses if use]


def uv_set(info: Object) -> int:
    """Return the TEXCOORD set of a texture use; KHR_texture_transform may override it."""
    transform = (info.get("extensions") or {}).get("KHR_texture_transform") or {}
    number: int = transform["texCoord"] if "texCoord" in transform else info.get("texCoord", 0)
    return number


class Materials:
    """Builds the materials that are used; textures count the images of the file until `build`."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._entries = document.items("materials")

    def uv_sets(self, index: int | None) -> tuple[int, int]:
        """Return which TEXCOORD sets fill `uv0` and `uv1` of a mesh with this material.

        That is (0, 1) unless the material samples a set from 2 up; then the sets that it does sample.
        """
        if index is None:
            return 0, 1
        used = sorted({uv_set(info) for info in texture_infos(self._entries[index])})
        if not used or used[-1] < _SLOTS:
            return 0, 1
        if len(used) > _SLOTS:
            self._document.warn(
                f"materials[{index}] samples more than two uv sets; from the third on the second is used."
            )
        return used[0], used[1] if len(used) > 1 else used[0]

    def sampled_sets(self, index: int | None) -> list[int]:
        """Return the TEXCOORD sets of the textures that this material samples, ascending."""
        if index is None:
            return []
        uses = texture_infos(self._entries[index])
        return sorted({uv_set(info) for info in uses if self._texture(index, info) is not None})

    def normal_texture(self, index: int | None) -> TextureRef | None:
        """Return the use of the normal map, whose uv directions the tangents follow."""
        return None if index is None else self._texture(index, self._entries[index].get("normalTexture"))

    def images(self, keys: list[MaterialKey]) -> list[int]:
        """Return the numbers in the file of all images that these materials sample, ascending."""
        used = set()
        for index in {key.index for key in keys if key.index is not None}:
            for info in texture_infos(self._entries[index]):
                texture = self._texture(index, info)
                if texture is not None:
                    used.add(texture.image)
        return sorted(used)

    def build(self, keys: list[MaterialKey], places: Mapping[int, int]) -> list[Material]:
        """Return the materials of `keys`; `places` has the image in the scene by the number in the file."""
        return [self._material(key, places) for key in keys]

    def _material(self, key: MaterialKey, places: Mapping[int, int]) -> Material:
        if key.index is None:
            return Material(name="default", unlit=key.unlit)
        index, entry = key.index, self._entries[key.index]
        surface = entry.get("pbrMetallicRoughness") or {}
        extensions = entry.get("extensions") or {}
        strength = (extensions.get("KHR_materials_emissive_strength") or {}).get("emissiveStrength", 1.0)
        red, green, blue = (
            max(0.0, float(value) * strength) for value in entry.get("emissiveFactor", (0, 0, 0))
        )
        base = surface.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        normal, occlusion = entry.get("normalTexture") or {}, entry.get("occlusionTexture") or {}

        def texture(info: Object | None) -> TextureRef | None:
            reference = self._texture(index, info)
            return None if reference is None else replace(reference, image=places[reference.image])

        return Material(
            name=entry.get("name") or f"material {index}",
            base_color=(_unit(base[0]), _unit(base[1]), _unit(base[2]), _unit(base[3])),
            metallic=_unit(surface.get("metallicFactor", 1.0)),
            roughness=_unit(surface.get("roughnessFactor", 1.0)),
            emissive=(red, green, blue),
            normal_scale=float(normal.get("scale", 1.0)),
            occlusion_strength=_unit(occlusion.get("strength", 1.0)),
            alpha_mode=_ALPHA_MODES[entry.get("alphaMode", "OPAQUE")],
            alpha_cutoff=float(entry.get("alphaCutoff", 0.5)),
            double_sided=bool(entry.get("doubleSided", False)),
            unlit=key.unlit or "KHR_materials_unlit" in extensions,
            base_color_texture=texture(surface.get("baseColorTexture")),
            metallic_roughness_texture=texture(surface.get("metallicRoughnessTexture")),
            normal_texture=texture(normal or None),
            occlusion_texture=texture(occlusion or None),
            emissive_texture=texture(entry.get("emissiveTexture")),
        )

    def _texture(self, material: int, info: Object | None) -> TextureRef | None:
        """Return a use of a texture, or None where its texture has no image that Strata can read."""
        if info is None:
            return None
        entry = self._document.items("textures")[info["index"]]
        if "source" not in entry:
            self._document.warn(
                f"textures[{info['index']}] has no source that Strata can read and was left out."
            )
            return None
        sampler = self._document.items("samplers")[entry["sampler"]] if "sampler" in entry else {}
        smaller, between = _MIN_FILTERS[sampler.get("minFilter")]
        transform = (info.get("extensions") or {}).get("KHR_texture_transform") or {}
        offset, scale = transform.get("offset", (0.0, 0.0)), transform.get("scale", (1.0, 1.0))
        wanted = uv_set(info)
        sets = self.uv_sets(material)
        return TextureRef(
            image=entry["source"],
            sampler=Sampler(
                mag="nearest" if sampler.get("magFilter") == 9728 else "linear",
                min=smaller,
                mipmap=between,
                wrap_u=_WRAPS[sampler.get("wrapS")],
                wrap_v=_WRAPS[sampler.get("wrapT")],
            ),
            uv_set=0 if wanted == sets[0] else 1,
            offset=(float(offset[0]), float(offset[1])),
            rotation=float(transform.get("rotation", 0.0)),
            scale=(float(scale[0]), float(scale[1])),
        )


def _unit(value: float) -> float:
    """Factors outside [0, 1] break the standard and, as reflectance, the conservation of energy."""
    return min(max(float(value), 0.0), 1.0)
