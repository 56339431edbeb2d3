"""The materials of the atrium, by name, and the textures they share."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from assets import pictures, textures
from assets.gltf_writer import GltfBuilder, Texture
from assets.noise import Bytes

LAMP_NITS = 6000.0  # of a lantern's flame
PANE_NITS = 2400.0  # where it shines through the pierced panes

BANNER_DYES = {"crimson": (0.52, 0.035, 0.045), "saffron": (0.80, 0.38, 0.05), "teal": (0.03, 0.27, 0.30)}


def add_materials(scene: GltfBuilder, px: int, occlusion: Bytes) -> dict[str, int]:
    """Add all materials with textures of `px` pixels (a power of two, 512 or less for the finest).

    Returns their indices by name. `occlusion` (H, W) is the occlusion of floors, walls and ceilings over the building's
    plan, for the second uv set.
    """
    fine, coarse = px, px // 2
    sets: dict[str, tuple[Callable[..., textures.Maps], int]] = {
        "limestone": (textures.limestone, fine),
        "wall": (textures.worn_wall, fine),
        "floor": (textures.floor_tiles, fine),
        "zellige": (textures.zellige, fine),
        "wood": (textures.wood, fine),
        "roof": (textures.roof_tiles, coarse),
        "bronze": (textures.bronze, coarse),
        "damask": (pictures.damask, coarse),
    }
    single: dict[str, tuple[Callable[..., Bytes], tuple[int, ...]]] = {
        "leaves": (pictures.leaves, (coarse,)),
        "lattice": (pictures.lattice, (coarse,)),
        "stained_glass": (pictures.stained_glass, (coarse,)),
        "filigree": (pictures.filigree, (px // 4,)),
        "garden": (pictures.garden, (px, px * 5 // 8)),
        "sky": (pictures.sky, (px, coarse)),
        "meadow": (pictures.meadow, (coarse,)),
    }
    with ThreadPoolExecutor() as pool:  # numpy works outside the interpreter's lock
        made_sets = {name: pool.submit(make, size) for name, (make, size) in sets.items()}
        made_single = {name: pool.submit(make, *sizes) for name, (make, sizes) in single.items()}
    image: dict[str, int] = {}
    for name, made in made_sets.items():
        image[f"{name}_base"] = scene.add_image(f"{name}_base", made.result().base)
        image[f"{name}_normal"] = scene.add_image(f"{name}_normal", made.result().normal)
        image[f"{name}_surface"] = scene.add_image(f"{name}_surface", made.result().surface)
    for name, picture in made_single.items():
        image[name] = scene.add_image(name, picture.result())
    image["plan_occlusion"] = scene.add_image("plan_occlusion", occlusion)
    plan = Texture(image["plan_occlusion"], uv_set=1)

    def maps(name: str, transform: dict[str, Any] | None = None) -> dict[str, Texture]:
        """Return the textures of a set by role; its surface map holds occlusion too."""
        surface = Texture(image[f"{name}_surface"], transform=transform)
        return {
            "base": Texture(image[f"{name}_base"], transform=transform),
            "surface": surface,
            "normal": Texture(image[f"{name}_normal"], transform=transform),
            "occlusion": surface,
        }

    material: dict[str, int] = {}

    def add(name: str, **values: Any) -> None:
        material[name] = scene.add_material(name, **values)

    add("limestone", **maps("limestone"))
    add("column_stone", color=(1.0, 0.90, 0.84), roughness=0.55, **maps("limestone"))
    add("voussoirs", **maps("limestone"))  # red and cream come from the vertices
    add("wall", **{**maps("wall"), "occlusion": plan})
    add("outer_wall", **maps("wall"))
    add("floor", metallic=0.0, **{**maps("floor"), "occlusion": plan})
    add("zellige", **maps("zellige"))
    add("dado", **{**maps("zellige"), "occlusion": plan})
    # The same mosaic, twice as fine and turned by 45 degrees, without a second picture.
    turned = {"offset": [0.25, 0.0], "rotation": 0.785400390625, "scale": [2, 2]}
    add("fountain_mosaic", **maps("zellige", turned))
    add("wood", **maps("wood"))
    add("ceiling", **{**maps("wood"), "occlusion": plan})
    add("roof_tiles", **maps("roof"))
    add("bronze", metallic=1.0, **maps("bronze"))
    add("gold", color=(1.0, 0.80, 0.42), metallic=1.0, roughness=0.6, normal=maps("bronze")["normal"])
    add("iron_lattice", base=Texture(image["lattice"]), roughness=0.6, alpha="MASK", double_sided=True)
    add("leaves", base=Texture(image["leaves"]), roughness=0.65, alpha="MASK", double_sided=True)
    for name, dye in BANNER_DYES.items():
        add(f"cloth_{name}", color=dye, double_sided=True, **maps("damask"))
    add(
        "stained_glass",
        base=Texture(image["stained_glass"]),
        roughness=0.12,
        alpha="BLEND",
        double_sided=True,
    )
    add("water", color=(0.05, 0.20, 0.21, 0.45), roughness=0.06, alpha="BLEND")
    add(
        "lantern_glass",
        color=(0.80, 0.52, 0.26, 0.42),
        roughness=0.15,
        emission=Texture(image["filigree"]),
        emissive_nits=(PANE_NITS, PANE_NITS, PANE_NITS),
        alpha="BLEND",
    )
    add("flame", color=(0.0, 0.0, 0.0), emissive_nits=(LAMP_NITS, LAMP_NITS * 0.66, LAMP_NITS * 0.30))
    add("terracotta", color=(0.52, 0.22, 0.12), roughness=0.85)
    add("soil", color=(0.055, 0.035, 0.022), roughness=1.0)
    add("pebbles", color=(0.42, 0.39, 0.35), roughness=0.7)
    add("bark", color=(0.75, 0.72, 0.68), **maps("wood"))
    add("orange_peel", color=(0.85, 0.29, 0.02), roughness=0.45)
    add("paper", color=(0.90, 0.86, 0.76), roughness=0.9, double_sided=True)
    add("garden_backdrop", base=Texture(image["garden"]), unlit=True)
    add("sky_backdrop", base=Texture(image["sky"]), unlit=True)
    add("meadow", base=Texture(image["meadow"]), roughness=1.0)
    add("gravel", color=(0.56, 0.44, 0.29), roughness=1.0)
    return material
