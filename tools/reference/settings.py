"""From a chapter's settings to those of the path tracer, and what the chapter leaves out by design."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

import chapters
from chapters import studies
from common.errors import SettingError
from common.scene import Material, Scene
from common.settings import apply_overrides, flat, knobs, preset, replaced

TRACER = 12
"""The chapter whose path tracer traces the references of all chapters."""

OF_LIGHT = (
    *("ambient", "default_light", "light_cutoff", "background", "sky", "aperture", "focus_distance"),
    *("shadow_near", "energy", "environment_intensity", "environment_turn", "environment_size"),
    *("fog", "fog_density", "fog_height", "fog_falloff", "fog_albedo", "fog_anisotropy"),
    *("fog_noise", "fog_noise_size", "fog_noise_period", "fog_wind"),
)
"""Knobs that say what light there is and what is seen of it: the path tracer has them as the chapter has."""

OF_TABLES = ("environment_detail", "irradiance_source", "table_size", "table_samples")
"""How exact the maps and tables are that paths look up; those of the preset `reference`."""

OF_PATHS = ("path_bounces", "path_roulette", "path_strategy", "path_lights", "path_sequence", "ray_way")
"""Knobs of the path tracer that --set turns for every chapter."""

BOUNCES = 1024
"""Reflections of a path at most: as many as there may be, since each limit takes light away. Roulette ends paths."""

OPTIONS = {
    "path_error": "--error",
    "path_limit": "--paths",
    "path_filter": "--filter",
    "path_seed": "--seed",
}
"""Knobs of the path tracer that have an option of their own."""

ROUGH = 0.3
"""Roughness above which metals lose more than a hundredth of what they reflect between their facets."""

BY_ITSELF = ("path_tracer", "path_samples", "path_average", "path_first")
"""Knobs of the path tracer that follow from how sums are merged."""


def keyed(name: str) -> bool:
    """Whether the sums of paths depend on a knob of the path tracer's chapter."""
    return name in (*OF_LIGHT, *OF_TABLES, *OF_PATHS, "path_filter", "path_seed")


def chapter_settings(which: chapters.Whole, overrides: Iterable[str] = ()) -> tuple[Any, tuple[str, ...]]:
    """Return a chapter's settings after texts "key=value", and those texts that are for the path tracer.

    Raises SettingError for a knob that is wrong, or that nothing traced depends on.
    """
    kind = chapters.settings_class(which)
    own: list[str] = []
    of_paths: list[str] = []
    for text in overrides:
        name = text.partition("=")[0].strip().replace("-", "_")
        if name in OPTIONS:
            raise SettingError(f"setting {name} is given by {OPTIONS[name]}: leave it out of --set.")
        if name in BY_ITSELF:
            raise SettingError(f"setting {name} is the command's own: leave it out of --set.")
        if name not in OF_PATHS and name not in OF_LIGHT and name in knobs(kind):
            raise SettingError(
                f"{studies.spoken(which)} draws otherwise with setting {name}, and paths find the same light: "
                "leave it out."
            )
        (of_paths if name in OF_PATHS else own).append(text)
    return apply_overrides(preset(kind, "reference"), own), tuple(of_paths)


def tracer_settings(settings: Any, filter: str, seed: int, overrides: Iterable[str] = ()) -> Any:
    """Return the settings of the path tracer for a chapter's `settings`; `overrides` are texts for OF_PATHS.

    Raises SettingError for a value that a knob does not take.
    """
    kind = chapters.settings_class(TRACER)
    chosen: Any = apply_overrides(replaced(preset(kind, "reference"), path_bounces=BOUNCES), overrides)
    of_light = {name: value for name, value in flat(settings).items() if name in OF_LIGHT}
    return replaced(
        chosen,
        **of_light,
        path_tracer=True,
        path_average=False,
        path_filter=filter,
        path_seed=seed,
        loading="wait",
    )


def differences(which: chapters.Whole, settings: Any, scene: Scene) -> str:
    """Return what is in a reference and, by design, not in the chapter's picture, in a sentence or two; or ""."""
    values = flat(settings)
    if values.get("path_tracer"):
        return ""
    light = import_module(f"{chapters.package_of(which)}.scene.default_light").DefaultLight(scene, settings)
    is_lit_from_afar = scene.environment is not None and values.get("environment_intensity", 1.0) > 0.0
    missing = []
    if values.get("shadows", "off") == "off" and values.get("rays", "off") != "whole":
        missing.append("no shadows")
    else:
        missing += ["no shadows of the default light"] * (light.on and values.get("rays", "off") != "whole")
        missing += ["no shadows of blended surfaces"] * any(map(_casts_blended, scene.materials))
    missing.append("no light that one surface sends to another")
    missing += ["no shadows of the environment's light"] * is_lit_from_afar
    missing += ["no shadows of ambient light"] * (light.ambient() > 0.0)
    if scene.medium is not None:
        missing.append("no fog between surfaces and lights" if values.get("fog") else "no fog")
    text = " and ".join([*([", ".join(missing[:-1])] if missing[1:] else []), missing[-1]])
    spoken = studies.spoken(which) + (" without path_tracer" if "path_tracer" in values else "")
    text = f"{spoken[:1].upper()}{spoken[1:]} draws by design {text}: the reference has them."
    # With an environment, paths have the chapter's compensation of energy, and reflect all of the ambient light, too.
    keeps_energy = is_lit_from_afar and values.get("energy", "gltf") != "gltf"
    if light.ambient() > 0.0 and not keeps_energy and any(map(_is_rough_metal, scene.materials)):
        text += " Its rough metals reflect all of the ambient light, and those of the reference a part of it."
    return text


def _casts_blended(material: Material) -> bool:
    return material.alpha_mode == "blend" and not material.unlit


def _is_rough_metal(material: Material) -> bool:
    return material.metallic > 0.0 and material.roughness > ROUGH and not material.unlit
