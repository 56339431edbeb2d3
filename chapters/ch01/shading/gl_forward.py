"""The forward pass: every object of the scene is drawn once and lit by all lights while it is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.contract import Access
from common import layouts
from common.scene import Scene

from ..frames.gl_commands import Commands, DrawGroup
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene import packing
from ..scene.draw_lists import NOTHING, Range, build_draw_lists
from ..scene.gl_data import SceneData
from ..scene.packing import Variant
from ..settings import Settings
from . import views
from .gl_sky import Sky
from .samples import coverage_defines


class ForwardPass:
    """Opaque objects, then alpha-masked ones, the nearest first; then transparent ones from the farthest on."""

    name = "forward"

    def __init__(self, scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines) -> None:
        self._scene, self._settings = scene, settings
        self._data, self._pipelines = data, pipelines
        grey = views.background(settings, settings.background)
        self.reads: tuple[Access, ...] = ()
        samples = settings.msaa
        color, depth = "color_hdr" if samples == 1 else "color_msaa", views.depth_target(settings)
        clear = (grey, grey, grey, 1.0)
        self.writes = (
            Access(color, "color", format=settings.color_format, clear=clear, samples=samples),
            Access(depth, "depth", format="d32f", clear=(0.0,), samples=samples),
        )
        self._sky = Sky(settings, data, pipelines) if Sky.needed(scene, settings) else None
        self._key: Any = None
        self.lists = self._unsorted = NOTHING
        self.slot = 0
        self.used: list[int] = []
        self.order: list[int] = []

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background."""
        return True

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the pipeline that draws materials of `variant`."""
        return GraphicsPipeline(
            shaders=("shading/forward.vert", "shading/forward.frag"),
            defines=variant.defines + coverage_defines(variant, self._settings),
            depth=views.depth_use(self._settings, variant),
            blend=views.blending(self._settings, variant),
            name=f"forward {' '.join(name.lower() for name, _ in variant.defines)}",
        )

    def create(self) -> None:
        """Build the pipelines of all materials that are drawn, and no other; again when one became another kind."""
        self.used = np.unique(self._scene.meshes["material"][self._scene.instances.mesh]).tolist()
        self._pipelines.get([self.describe(self._data.variants[material]) for material in self.used])
        if self._sky is not None:
            self._sky.create()
        self._key = None

    def prepare(self, slot: int, view_from_world: np.ndarray, instances: np.ndarray, visibility: int) -> None:
        """Choose what this frame draws and in which order. `instances` are the packed records of the slot."""
        mirrored = (instances["flags"] & layouts.INSTANCE_MIRRORED) != 0
        key = (visibility, mirrored.tobytes())
        if key != self._key:
            self._unsorted = build_draw_lists(self._scene, self._data.variants, mirrored, self._group)
            self._key = key
        self.slot = slot
        # Sorted from the scene's order every time: what stands at one depth must not depend on the frame before.
        self.lists = self._unsorted.nearest_first(
            packing.view_depth(instances["bounds_centre"][:, :3], view_from_world)
        )
        some = self.lists.transparent_instances
        if len(some):
            centers = instances["bounds_centre"][some, :3]
            self.order = packing.back_to_front(centers, view_from_world).tolist()

    def _group(self, ranges: Sequence[Range], material: int, mirrored: bool) -> DrawGroup:
        variant = self._data.variants[material]
        return DrawGroup(
            pipeline=self._pipelines.get([self.describe(variant)])[0],
            cull=not variant.double_sided,
            front="clockwise" if mirrored else "counter_clockwise",
            material=material,
            textures=self._data.textures_of(material),
            draws=[self._data.draw(one) for one in ranges],
        )

    def record(self, commands: Commands) -> None:
        """Make the draws of this frame."""
        vertices = self._data.slots[self.slot].vertex_array
        commands.draw_groups(self.lists.solid, vertices)
        if self._sky is not None:
            self._sky.record(commands)
        if self.lists.transparent:
            commands.draw_groups([self.lists.transparent[index] for index in self.order], vertices)
