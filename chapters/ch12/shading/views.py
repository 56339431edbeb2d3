"""Views: one quantity shown in place of the picture, as it is: no exposure, no tone curve, one sample a pixel.

A view is a define of the forward pass's fragment shader, `VIEW=n` with n its place in this list; what it does is in
shading/views.glsl. Without a view there is no such define, and every pipeline is what it would be without this file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

from common.scene import Material, Scene
from common.view.camera import View, exposure

from ..meshlets.unit_code import unit_defines
from ..post.settings import PostSettings
from ..scene.packing import Variant, material_variant, shape_alone
from ..shadows.views import SHADOWS
from .prepass import has_prepass

if TYPE_CHECKING:
    from .settings import ShadingSettings

PICTURE = "picture"
"""The value of the setting `view` without a view."""


class Settings(Protocol):
    """The settings of views."""

    shading: ShadingSettings
    post: PostSettings


@dataclass(frozen=True)
class Quantity:
    """One view. `shown`: light gets an sRGB code, values are codes themselves, counts become heat.

    `defines` are those of a material's variant that the view reads, besides what decides where the surface is.
    """

    name: str
    sentence: str
    shown: Literal["light", "value", "count"]
    defines: tuple[str, ...] = ()


VIEWS = (
    Quantity(
        "base-color",
        "Base colour: factor times texture times vertex colour, without any light.",
        "light",
        ("BASE_COLOR_MAP", "VERTEX_COLOR"),
    ),
    Quantity(
        "normal",
        "Shading normal in the world, after the normal map: x, y and z from -1 to 1 as red, green and blue.",
        "value",
        ("SHADED", "NORMAL_MAP", "DOUBLE_SIDED"),
    ),
    Quantity(
        "roughness",
        "Roughness: black is a mirror, white is chalk; unlit materials are black.",
        "value",
        ("METALLIC_ROUGHNESS_MAP", "UNLIT"),
    ),
    Quantity(
        "metalness",
        "Metalness: white is metal; unlit materials are black.",
        "value",
        ("METALLIC_ROUGHNESS_MAP", "UNLIT"),
    ),
    Quantity(
        "occlusion",
        "How much light from everywhere arrives: white is all of it, dark is what the occlusion map takes away.",
        "value",
        ("OCCLUSION_MAP",),
    ),
    Quantity(
        "emissive",
        "Light that the surface itself sends out, in nits: up to 1 as it is, brighter light by its hue alone.",
        "light",
        ("EMISSIVE_MAP", "UNLIT"),
    ),
    Quantity(
        "depth",
        "Distance ahead of the camera, near is bright: s / (s + distance), s an eighth of the scene's diagonal.",
        "value",
    ),
    Quantity(
        "uv", "Texture coordinates of the first set: the fractions of u and v as red and green.", "value"
    ),
    Quantity(
        "mip-level",
        "Level of the base colour's mip chain that is read: black is the finest, white is 12; grey has no texture.",
        "count",
        ("BASE_COLOR_MAP",),
    ),
    Quantity(
        "triangle-id",
        "Each triangle in a colour of its own, drawn by lot from its number and its object's: the same in every frame.",
        "value",
    ),
    Quantity(
        "overdraw",
        "How often each pixel is shaded if nothing hides anything: blue is 2, green 6, red 10, white 12 and more.",
        "count",
    ),
    Quantity(
        "light-count",
        "How many lights reach the surface by range, cone and cutoff: blue is 2, green 6, red 10, white 12 and more.",
        "count",
        ("SHADED", "LIT"),
    ),
    Quantity(
        "non-finite",
        "Magenta where material, normal or light is NaN or infinite, over the picture at a quarter of its light.",
        "light",
    ),
    Quantity(
        "meshlets",
        "Each meshlet in a colour of its own, the same in every frame; what is drawn as a whole mesh is grey.",
        "value",
    ),
    Quantity(
        "survivors",
        "Blue: drawn by the early phase, orange: added by the late one; whole meshes are darker, blended ones grey.",
        "value",
        ("ALPHA_BLEND",),
    ),
    Quantity(
        "lights-evaluated",
        "How many lights the lists name for a pixel: blue is 2, red 10, white 12 and more.",
        "count",
        ("SHADED", "LIT"),
    ),
    *(Quantity(name, sentence, "value", ("SHADED", "LIT")) for name, sentence in SHADOWS.items()),
    Quantity(
        "fog-slices",
        "The slice of the grid of froxels that holds the surface: each one in a colour of its own; grey without fog.",
        "value",
    ),
    Quantity(
        "fog-transmittance",
        "The part of a surface's light that the medium lets through: white is all of it.",
        "value",
    ),
)
"""The quantities that a view can show. A new view goes to the end: numbers are part of compiled shaders."""

NAMES = tuple(view.name for view in VIEWS)
CHOICES = (PICTURE, *NAMES)

_OF_ROLES = ("TEXTURED", "UV1")
"""The parts of a material's variant that its textures need."""


def number_of(view: str) -> int:
    """Return the number by which shaders know a view; ValueError for another name."""
    return NAMES.index(view)


def of(settings: Settings) -> Quantity | None:
    """Return the view that is asked for, None for the picture."""
    return None if settings.shading.view == PICTURE else VIEWS[number_of(settings.shading.view)]


def variant_of(material: Material, scene: Scene, settings: Settings, energy: str | None) -> Variant:
    """Return what the shaders of `material` are built with; see `packing.material_variant`.

    Under a view that is what its quantity needs and no more: textures, lights and vertex streams that it does not read
    are not uploaded.
    """
    # A texture that stands in for none has no mip level to show: under a view `skip_unused` is always on.
    everything = not settings.shading.skip_unused and is_lit(settings)
    whole = material_variant(material, scene, everything, energy)
    view = of(settings)
    if view is None:
        return whole
    numbered = ("VIEW", number_of(view.name))
    if view.name == "non-finite":  # anything may be wrong, and so everything is computed
        return replace(whole, defines=tuple(sorted((*whole.defines, numbered))))
    shape = shape_alone(whole)
    kept = {name: value for name, value in whole.defines if name in view.defines}
    roles = tuple(role for role in whole.roles if role in shape.roles or f"{role.upper()}_MAP" in kept)
    if roles:
        kept |= {name: value for name, value in whole.defines if name in _OF_ROLES}
    if view.name == "uv":
        kept["TEXTURED"] = 1
    if view.name == "normal":
        kept["SHADED"] = 1
    if "UNLIT" in view.defines and material.unlit:
        kept["UNLIT"] = 1
    defines = {**dict(shape.defines), **kept, **dict([numbered]), **unit_defines(settings)}
    return replace(whole, defines=tuple(sorted(defines.items())), roles=roles)


def blending(settings: Settings, variant: Variant) -> Literal["over", "add"] | None:
    """Return the blending of a view: a view shows one surface at each pixel, or counts all of them."""
    if settings.shading.view == PICTURE:
        return "over" if variant.alpha_mode == "blend" else None
    return "add" if settings.shading.view == "overdraw" else None


def is_lit(settings: Settings) -> bool:
    """Whether light is computed at all."""
    return settings.shading.view in (PICTURE, "non-finite")


def has_lit(scene: Scene, settings: Settings) -> bool:
    """Whether any material of a scene takes light from its lights: there are none for unlit ones, or for most views."""
    view = of(settings)
    lit = view is None or view.name == "non-finite" or "LIT" in view.defines
    return lit and any(not material.unlit for material in scene.materials)


def mends_texels(settings: Settings) -> bool:
    """Whether texels that are NaN or infinite are replaced before the GPU sees them."""
    return settings.shading.view != "non-finite"


def depth_use(settings: Settings, variant: Variant) -> Literal["write", "test", "equal"]:
    """Return what a fragment does with depth; where all are counted none writes it, and so none hides another."""
    if variant.alpha_mode != "blend" and has_prepass(settings):
        return "equal"
    return "test" if variant.alpha_mode == "blend" or settings.shading.view == "overdraw" else "write"


def depth_target(settings: Settings) -> str:
    """Return the target of the forward pass's depth: "depth" where it is the frame's, and one that others may read.

    If it has several samples, or no pass writes it, the output is the depth of the instance-id pass.
    """
    if settings.shading.msaa > 1:
        return "depth_msaa"
    return "depth_empty" if settings.shading.view == "overdraw" else "depth"


def background(settings: Settings, grey: float) -> float:
    """Return the grey where nothing was drawn: black under a view."""
    return grey if settings.shading.view == PICTURE else 0.0


def shown_exposure(settings: Settings, view: View) -> float:
    """Return the factor between the linear colour that is stored and what it stands for: 1 under a view."""
    return exposure(view.ev100) if settings.shading.view == PICTURE else 1.0


def tonemap_defines(settings: Settings) -> tuple[tuple[str, int | float | str], ...]:
    """Return what tonemap.frag is built with."""
    view = of(settings)
    if view is None:
        curve, white = settings.post.tone_curve, settings.post.tone_white
        if curve == "reinhard":
            return (("REINHARD", 1), ("WHITE", white))
        return ((curve.upper(), 1),) if curve != "none" else ()
    if view.shown == "count":
        return (("VIEW_COUNT", 1), ("COUNT_FULL", settings.shading.view_white))
    return (("VIEW_VALUE", 1),) if view.shown == "value" else ()
