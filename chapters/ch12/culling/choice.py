"""The choice of a frame's tests and of what draws its solid objects, from settings, scene and device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast

from backends.contract import Capabilities, Plan
from common.errors import SettingError, UnsupportedError
from common.scene import Scene

from ..meshlets.unit_code import OF_MESHLETS
from ..shading import views
from ..shading.settings import ShadingSettings
from .settings import CullingSettings, Geometry, Mode

FEW_INSTANCES = 64
FEW_TRIANGLES = 50_000
"""A scene that has fewer of both is drawn whole: the kernels would take longer than its triangles."""

FEW_TRIANGLES_EACH = 4
"""A scene with fewer triangles for each instance is drawn whole: testing an instance takes as long as drawing it."""


class Settings(Protocol):
    """The settings of culling."""

    culling: CullingSettings
    shading: ShadingSettings


@dataclass(frozen=True)
class Choice:
    """The tests of a frame, and what draws solid objects; `mode` "off" with `geometry` "classic" is chapter 5."""

    mode: Mode
    geometry: Geometry
    samples: int = 1
    """Samples of a pixel in the depth that the pyramid is built from."""
    levels: bool = False
    """Whether any mesh has levels of detail to choose from."""

    @property
    def level(self) -> int:
        """The number of the mode in shaders."""
        return ("off", "frustum", "cone", "occlusion").index(self.mode)

    @property
    def defines(self) -> tuple[tuple[str, int], ...]:
        """The defines of the tests in shaders (`tests.glsl`)."""
        samples = (("SAMPLES", self.samples),) if self.samples > 1 else ()
        return (("CULLING", self.level), *samples, *self.level_defines)

    @property
    def level_defines(self) -> tuple[tuple[str, int], ...]:
        """The define of shaders that read the level of a draw (`levels.glsl`)."""
        return (("LEVELS", 1),) if self.levels else ()

    @property
    def runs(self) -> bool:
        """Whether any kernel runs."""
        return self.levels or (self.mode, self.geometry) != ("off", "classic")

    @property
    def two_phases(self) -> bool:
        """Whether solid objects are drawn in two phases."""
        return self.mode == "occlusion"


def is_small(scene: Scene) -> bool:
    """Whether a scene is too small for culling to gain anything."""
    triangles = int(scene.meshes["index_count"][scene.instances.mesh].sum(dtype="int64")) // 3
    count = len(scene.instances)
    return (count < FEW_INSTANCES and triangles < FEW_TRIANGLES) or triangles < FEW_TRIANGLES_EACH * count


def overlay_of(settings: Settings) -> str:
    """Return what the overlay shows, or "off": a view that counts has no colours for it."""
    view = settings.shading.view
    counts = view in views.NAMES and views.VIEWS[views.number_of(view)].shown == "count"
    return "off" if counts else settings.culling.overlay


def _is_about_culling(settings: Settings) -> bool:
    """Whether a view or an overlay is asked for that shows little without culling."""
    return settings.shading.view == "survivors" or overlay_of(settings) != "off"


def _is_about_meshlets(settings: Settings) -> bool:
    """Whether a view or an overlay is asked for that shows little without meshlets."""
    return settings.shading.view in OF_MESHLETS or overlay_of(settings) == "spheres"


def wants_meshlets(scene: Scene, settings: Settings) -> bool:
    """Whether the scene's meshes are cut into meshlets, whatever the device is."""
    geometry, mode = settings.culling.geometry, settings.culling.mode
    if geometry == "auto":
        asked = _is_about_meshlets(settings) or _is_about_culling(settings)
        return asked or not is_small(scene) or mode not in ("auto", "off")
    return geometry != "classic"


def choose(scene: Scene, settings: Settings, plan: Plan, capabilities: Capabilities) -> Choice:
    """Return what a frame does.

    Raises UnsupportedError if the device lacks what `geometry` names, and SettingError for an overlay of a pyramid that
    the frame does not build.
    """
    mode, geometry = settings.culling.mode, settings.culling.geometry
    if mode == "auto":
        mode = "occlusion" if _is_about_culling(settings) or not is_small(scene) else "off"
    if settings.shading.view == "overdraw" and mode == "occlusion":
        mode = "cone"  # this view counts what is hidden, and writes no depth
    if overlay_of(settings) == "pyramid" and mode != "occlusion":
        raise SettingError(
            f"With culling={mode} there is no depth pyramid for culling_overlay=pyramid to show: set culling=occlusion."
        )
    if geometry == "mesh" and not plan.native("mesh-shader"):
        raise UnsupportedError(
            f"geometry=mesh needs mesh shaders, which {capabilities.device} is used without: set geometry=auto, which "
            "chooses what there is."
        )
    if geometry == "auto":
        whole = mode == "off" and not _is_about_meshlets(settings)
        geometry = "classic" if whole or not plan.native("multi-draw") else _with_meshlets(plan, capabilities)
    if geometry == "compute" and not plan.native("multi-draw"):
        raise UnsupportedError(
            f"geometry=compute draws many meshlets with one call, which {capabilities.device} is used without: "
            "set geometry=classic."
        )
    return Choice(cast(Mode, mode), cast(Geometry, geometry), settings.shading.msaa)


def _with_meshlets(plan: Plan, capabilities: Capabilities) -> Geometry:
    """Return the path with meshlets: mesh shaders on a GPU that has them.

    A software driver runs a mesh shader for each meshlet at four times the cost of its vertices. On an NVIDIA H100
    mesh shaders take 1.09 times the time of the compute path, for less memory: no command is written.
    """
    return "mesh" if plan.native("mesh-shader") and not capabilities.is_software else "compute"
