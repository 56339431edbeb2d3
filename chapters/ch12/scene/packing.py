"""The scene's arrays as shaders read them: instances, materials, lights, and which variant each material needs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from common import layouts
from common.environment import ENERGIES
from common.errors import SceneError
from common.scene import Material, Pose, Scene

from ..meshlets.unit_code import UNIT_CODE
from ..visibility.model import material_flags

MATERIAL = np.dtype(
    [
        ("base_color", np.float32, 4),
        ("emissive", np.float32, 4),
        ("factors", np.float32, 4),
        ("uv_rows", np.float32, (10, 4)),
        ("maps", np.uint32, 8),
    ]
)
LIGHT = np.dtype(
    [
        ("position", np.float32, 3),
        ("kind", np.uint32),
        ("direction", np.float32, 3),
        ("inverse_range2", np.float32),
        ("color", np.float32, 3),
        ("end_distance2", np.float32),
        ("cone", np.float32, 4),
    ]
)
LIGHT_KINDS = {"point": 0, "spot": 1, "directional": 2}

ROLES = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive")
"""Texture roles in the order of their numbers in a material's record."""

LARGEST = float(np.finfo(np.float32).max)
NEAREST_END, FARTHEST = 1e18, 1e19
"""Bounds of 1 / range and of the distance where a light ends: their squares are still numbers of 32 bits."""


@dataclass(frozen=True)
class Variant:
    """What the shaders of one material and mesh are built with; `defines` is sorted, so equal variants are equal."""

    defines: tuple[tuple[str, int], ...]
    alpha_mode: str
    double_sided: bool
    roles: tuple[str, ...]

    def has(self, define: str) -> bool:
        """Whether the shaders are built with `define`."""
        return any(name == define for name, _ in self.defines)


def material_variant(
    material: Material, scene: Scene, everything: bool = False, energy: str | None = None
) -> Variant:
    """Return the variant for `material` in `scene`; with `everything`, one that has all that any scene may need.

    A role without a texture has no descriptor and no fetch. `everything` is the same picture by more work: tests hold
    the two against each other. `energy` is how an environment's light is shared out, None without an environment.
    """
    shaded = everything or not material.unlit
    textures = material.textures()
    roles = tuple(role for role in ROLES if role in textures or everything)
    if material.unlit:
        shaded = False
        roles = tuple(role for role in roles if role == "base_color")
    used = [textures[role] for role in roles if role in textures]
    flags = {
        "SHADED": shaded,
        "LIT": shaded and (everything or bool(scene.lights)),
        "TEXTURED": bool(roles),
        "UV1": scene.uv1 is not None and (everything or any(texture.uv_set == 1 for texture in used)),
        "VERTEX_COLOR": scene.colors is not None,
        "NORMAL_MAP": "normal" in roles,
        "ALPHA_MASK": material.alpha_mode == "mask",
        "ALPHA_BLEND": material.alpha_mode == "blend",
        "DOUBLE_SIDED": material.double_sided,
    }
    flags |= {f"{role.upper()}_MAP": True for role in roles}
    values = {name: 1 for name, on in flags.items() if on}
    if shaded and energy is not None:
        values |= {"ENVIRONMENT": 1, "ENERGY": ENERGIES.index(energy)}
    defines = tuple(sorted(values.items()))
    return Variant(defines, material.alpha_mode, material.double_sided, roles)


_OF_THE_SHAPE = ("ALPHA_MASK", "BASE_COLOR_MAP", "TEXTURED", "UV1", "VERTEX_COLOR", UNIT_CODE)
"""What decides where a masked surface is; where an opaque one is, its positions say alone."""


def shape_alone(variant: Variant) -> Variant:
    """Return the variant that draws the same pixels without colour: nothing is shaded here."""
    if variant.alpha_mode != "mask":
        return replace(variant, defines=tuple(it for it in variant.defines if it[0] == UNIT_CODE), roles=())
    textured = variant.has("BASE_COLOR_MAP")
    needed = [
        (name, value)
        for name, value in variant.defines
        if name in _OF_THE_SHAPE and (textured or name not in ("TEXTURED", "UV1"))
    ]
    return replace(variant, defines=tuple(needed), roles=("base_color",) if textured else ())


def check_materials(scene: Scene) -> None:
    """Raise SceneError if something that is drawn has a material that is not there."""
    for mesh in np.unique(scene.instances.mesh).tolist():
        material, count = int(scene.meshes["material"][mesh]), len(scene.materials)
        if material >= count:
            raise SceneError(
                f"Mesh {mesh} has material {material}, but there are {count} materials, counted from 0: give the scene "
                "that material, or the mesh another one."
            )


def pack_materials(materials: list[Material], maps: np.ndarray) -> np.ndarray:
    """Return (M,) MATERIAL records; `maps` (M, 8) uint32 says which texture each role samples, see textures.glsl."""
    records = np.zeros(len(materials), MATERIAL)
    records["maps"] = maps
    rows = records["uv_rows"].reshape(-1, len(ROLES), 2, 4)
    rows[..., :3] = np.eye(2, 3)
    if not materials:
        return records
    records["base_color"] = [material.base_color for material in materials]
    records["emissive"][:, :3] = np.clip([material.emissive for material in materials], 0.0, LARGEST)
    records["emissive"][:, 3] = [material.alpha_cutoff for material in materials]
    records["factors"] = [
        (material.metallic, material.roughness, material.normal_scale, material.occlusion_strength)
        for material in materials
    ]
    for number, material in enumerate(materials):
        for name, texture in material.textures().items():
            role = ROLES.index(name)
            rows[number, role, :, :3] = texture.matrix()
            rows[number, role, 0, 3] = texture.uv_set
        rows[number, 0, 1, 3] = material_flags(material, ROLES)
    return records


def pack_instances(scene: Scene, pose: Pose, previous: Pose | None) -> np.ndarray:
    """Return (I,) Instance records at `pose`; `previous` is the pose that was rendered before, if any was."""
    records = np.zeros(len(scene.instances), layouts.dtype("Instance"))
    if len(records):
        mesh = scene.instances.mesh
        layouts.fill_instances(
            records,
            pose.world_from_object,
            (previous or pose).world_from_object,
            origin=scene.origin,
            object_bounds=np.stack(
                [scene.meshes["bounds_min"][mesh], scene.meshes["bounds_max"][mesh]], axis=1
            ),
            mesh=mesh,
            material=scene.meshes["material"][mesh],
            visible=scene.instances.visible,
            deforming=np.isin(mesh, [deformation.mesh for deformation in scene.deformations]),
        )
    return records


def view_depth(centers: np.ndarray, view_from_world: np.ndarray) -> np.ndarray:
    """Return how far ahead of the camera world-space points (B, 3) are, in metres (B,)."""
    return -(centers @ view_from_world[2, :3] + view_from_world[2, 3])


def back_to_front(centers: np.ndarray, view_from_world: np.ndarray) -> np.ndarray:
    """Return the order in which transparent objects with world-space `centers` (B, 3) are drawn: farthest first.

    Equal distances keep the scene's order, so that the picture does not depend on the sort.
    """
    return np.argsort(-view_depth(centers, view_from_world), kind="stable")
