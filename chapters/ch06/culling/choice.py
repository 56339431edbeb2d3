"""The choice of a frame's tests and of what draws its solid objects, from settings, scene and device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast

from backends.contract import Capabilities, Plan
from common.errors import UnsupportedError
from common.scene import Scene

from ..shading.settings import ShadingSettings
from .settings import CullingSettings, Geometry, Mode

FEW_INSTANCES = 64
FEW_TRIANGLES = 50_000
"""A scene that has fewer of both is drawn whole: the kernels would take longer than its triangles."""


class Settings(Protocol):
    """The settings of culling."""

    culling: CullingSettings
    shading: ShadingSettings


@dataclass(frozen=True)
class Choice:
    """The tests of a frame, and what draws solid objects; `mode` "off" with `geometry` "classic" is chapter 5."""

    mode: Mode
    geometry: Geometry

    @property
    def level(self) -> int:
        """The number of the mode in shaders."""
        return ("off", "frustum", "cone", "occlusion").index(self.mode)

    @property
    def runs(self) -> bool:
        """Whether any kernel runs."""
        return (self.mode, self.geometry) != ("off", "classic")

    @property
    def two_phases(self) -> bool:
        """Whether solid objects are drawn in two phases."""
        return self.mode == "occlusion"


def is_small(scene: Scene) -> bool:
    """Whether a scene is too small for culling to gain anything."""
    triangles = int(scene.meshes["index_count"][scene.instances.mesh].sum(dtype="int64")) // 3
    return len(scene.instances) < FEW_INSTANCES and triangles < FEW_TRIANGLES


def wants_meshlets(scene: Scene, settings: Settings) -> bool:
    """Whether the scene's meshes are cut into meshlets, whatever the device is."""
    geometry = settings.culling.geometry
    if geometry == "auto":
        return not is_small(scene) or settings.culling.mode not in ("auto", "off")
    return geometry != "classic"


def choose(scene: Scene, settings: Settings, plan: Plan, capabilities: Capabilities) -> Choice:
    """Return what a frame does. Raises UnsupportedError if the device lacks what `geometry` names."""
    mode, geometry = settings.culling.mode, settings.culling.geometry
    small = is_small(scene)
    if mode == "auto":
        mode = "off" if small else "occlusion"
    if settings.shading.view == "overdraw" and mode == "occlusion":
        mode = "cone"  # this view counts what is hidden, and writes no depth
    if geometry == "mesh" and not plan.native("mesh-shader"):
        raise UnsupportedError(
            f"geometry=mesh needs mesh shaders, which {capabilities.device} is used without: set geometry=compute."
        )
    if geometry == "auto":
        geometry = (
            "classic" if mode == "off" or not plan.native("multi-draw") else _fastest(plan, capabilities)
        )
    if geometry == "compute" and not plan.native("multi-draw"):
        raise UnsupportedError(
            f"geometry=compute draws many meshlets with one call, which {capabilities.device} is used without: "
            "set geometry=classic."
        )
    return Choice(cast(Mode, mode), cast(Geometry, geometry))


def _fastest(plan: Plan, capabilities: Capabilities) -> Geometry:
    """Return the faster of the two paths with meshlets, as measured (`strata bench 6`).

    A software driver runs a mesh shader for each meshlet at four times the cost of its vertices.
    """
    return "mesh" if plan.native("mesh-shader") and not capabilities.is_software else "compute"
