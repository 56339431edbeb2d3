"""The forward pass: every object of the scene is drawn once and lit by all lights while it is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from backends.contract import Access
from backends.vulkan import api as vk
from common.scene import Scene
from common.view.camera import View

from ..frames.vulkan_commands import Commands, DrawGroup
from ..pipelines.vulkan import Built, GraphicsPipeline, Pipelines
from ..scene.draw_lists import Batch
from ..scene.packing import Variant
from ..scene.scene_draws import SceneDraws
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from . import views
from .samples import coverage_defines
from .vulkan_sky import Sky


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
        self._sky = Sky(settings, pipelines) if Sky.needed(scene, settings) else None
        self._draws = SceneDraws(scene, data)
        self._groups: dict[tuple[int, int, bool, int, int], DrawGroup] = {}
        self.used: list[int] = []
        self.built: list[Built] = []
        self.slot = 0

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
            color=self._settings.color_format,
            depth=views.depth_use(self._settings, variant),
            blend=views.blending(self._settings, variant),
            samples=self._settings.msaa,
            name=f"forward {' '.join(name.lower() for name, _ in variant.defines)}",
        )

    def create(self) -> None:
        """Build the pipelines of all materials that are drawn, and no other; again when one became another kind."""
        self.used = np.unique(self._scene.meshes["material"][self._scene.instances.mesh]).tolist()
        kinds = dict.fromkeys(self._data.variants[material] for material in self.used)
        self.built = self._pipelines.get([self.describe(variant) for variant in kinds])
        if self._sky is not None:
            self.built.append(self._sky.create())
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
            page_set, index_buffer = data.bound_page(self.slot, batch.page)
            self._groups[key] = DrawGroup(
                batch=batch,
                pipeline=self._pipelines.get([self.describe(variant)])[0],
                cull=vk.VK_CULL_MODE_NONE if variant.double_sided else vk.VK_CULL_MODE_BACK_BIT,
                front=vk.VK_FRONT_FACE_CLOCKWISE if batch.mirrored else vk.VK_FRONT_FACE_COUNTER_CLOCKWISE,
                page_set=page_set,
                index_buffer=index_buffer,
                texture_set=data.texture_set(batch.textures) if variant.roles else None,
            )
        return replace(self._groups[key], batch=batch)

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        frame_set, records = self._data.frame_set(self.slot), self._data.slots[self.slot].commands
        commands.draw_groups(self.solid, frame_set, records)
        if self._sky is not None:
            self._sky.record(commands, frame_set)
        transparent = [self._group(batch) for batch in self._draws.transparent(self.slot)]
        commands.draw_groups(transparent, frame_set, records)
