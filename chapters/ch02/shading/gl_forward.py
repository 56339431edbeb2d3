"""The forward pass: every object of the scene is drawn once and lit by all lights while it is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from backends.contract import Access
from common.scene import Scene
from common.view.camera import View

from ..frames.gl_commands import Commands, DrawGroup
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.draw_lists import Batch
from ..scene.gl_data import SceneData
from ..scene.packing import Variant
from ..scene.scene_draws import SceneDraws
from ..settings import Settings
from . import views
from .gl_sky import Sky
from .samples import coverage_defines


class ForwardPass:
    """Opaque objects, then alpha-masked ones, in the order of the scene; then transparent ones from the farthest on."""

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
        self._draws = SceneDraws(scene, data)
        self._groups: dict[tuple[int, int, bool, int, int], DrawGroup] = {}
        self.slot = 0
        self.used: list[int] = []

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background."""
        return True

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the pipeline that draws materials of `variant`."""
        return GraphicsPipeline(
            shaders=("shading/forward.vert", "shading/forward.frag"),
            defines=(
                *variant.defines,
                *self._data.texture_defines(variant),
                *coverage_defines(variant, self._settings),
            ),
            depth=views.depth_use(self._settings, variant),
            blend=views.blending(self._settings, variant),
            name=f"forward {' '.join(name.lower() for name, _ in variant.defines)}",
        )

    def create(self) -> None:
        """Build the pipelines of all materials that are drawn, and no other; again when one became another kind."""
        self.used = np.unique(self._scene.meshes["material"][self._scene.instances.mesh]).tolist()
        kinds = dict.fromkeys(self._data.variants[material] for material in self.used)
        self._pipelines.get([self.describe(variant) for variant in kinds])
        if self._sky is not None:
            self._sky.create()
        self._draws.forget()
        self._groups.clear()

    def prepare(self, slot: int, view: View) -> int:
        """Choose what this frame draws and in which order, and write it to the slot; return the bytes written."""
        self.slot = slot
        return self._draws.prepare(slot, view)

    @property
    def visible(self) -> int:
        """How many instances of the scene are visible."""
        return self._draws.visible

    @property
    def solid(self) -> list[DrawGroup]:
        """What this frame draws of opaque and masked objects."""
        return [self._group(batch) for batch in self._draws.solid]

    def _group(self, batch: Batch) -> DrawGroup:
        """Return a batch with everything that has to be bound for it: the same for all batches of its state."""
        key = (self.slot, batch.material, batch.mirrored, batch.page, batch.textures)
        if key not in self._groups:
            data = self._data
            variant = data.variants[batch.material]
            page, vertex_array = data.bound_page(self.slot, batch.page)
            self._groups[key] = DrawGroup(
                batch=batch,
                pipeline=self._pipelines.get([self.describe(variant)])[0],
                cull=not variant.double_sided,
                front="clockwise" if batch.mirrored else "counter_clockwise",
                page=page,
                vertex_array=vertex_array,
                textures=data.texture_set(batch.textures) if variant.roles else (),
            )
        return replace(self._groups[key], batch=batch)

    def record(self, commands: Commands) -> None:
        """Make the draws of this frame."""
        records = self._data.slots[self.slot].commands
        commands.draw_groups(self.solid, records)
        if self._sky is not None:
            self._sky.record(commands)
        commands.draw_groups([self._group(batch) for batch in self._draws.transparent(self.slot)], records)
