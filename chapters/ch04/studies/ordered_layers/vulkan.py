"""The study ordered-layers on Vulkan: a pass for each item, or for each row of them, and hand-written barriers."""

from __future__ import annotations

from typing import Any, NamedTuple

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import Image
from common.scene import Sampler
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Sets, Texture
from ..stage_vulkan import Stage
from . import CLEAR, SCREEN, SHADERS, STUDY, Item, LayerWork, Settings, defines, items, passes_of


class Target(NamedTuple):
    """How passes to a target begin, the first of a frame and those after it, and what makes it readable at last."""

    first: tuple[Any, Rendering]
    again: tuple[Any, Rendering]
    after: Any


class Renderer(Stage):
    """Items in a list, from back to front."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    items = staticmethod(items)  # yours may stand here

    def create(self) -> None:
        """Make a pipeline for each item that is enabled; for others nothing is made."""
        listed = self.items(self.settings)
        self._passes = passes_of(listed, self.settings.merge)
        self._enabled = [item for item in listed if item.enabled]
        wanted = [
            PipelineDescription(
                SHADERS, defines(item), color="rgba8", depth=None, blend="over", name=f"{item.name}"
            )
            for item in self._enabled
        ]
        self._pipelines = dict(zip(self._enabled, self.pipelines.get(wanted), strict=True))
        self._texels = self.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), "texels")

    def create_sized(self) -> None:
        """Make the targets of items that have one, and the sets of those that read them."""
        own = dict.fromkeys(item.output for item in self._enabled if item.output != SCREEN)
        images = {name: self.target(name, "rgba8") for name in own}
        self._targets_of = {SCREEN: self._target(self.picture, "copy_source", "color")}
        self._targets_of |= {
            name: self._target(image, "sampled", "sampled") for name, image in images.items()
        }
        self._sets: dict[Item, Any] = {}
        for item in self._enabled:
            if item.reads:
                layout = self._pipelines[item].sets[0]
                assert layout is not None  # a shader that reads declares it
                held = {0: Texture(images[item.reads].view, self._texels)}
                allocated: Sets = self.descriptors.create([(layout, held, f"set of {item.name}")])
                self.keep_sized(allocated, self.descriptors.destroy)
                self._sets[item] = vk.array("VkDescriptorSet", allocated.handles)

    def _target(self, image: Image, read_as: str, leaves: str) -> Target:
        """Return what passes to an image need; it was read as `read_as` in the frame before."""

        def barrier(before: str, after: str, discard: bool = False) -> Any:
            return barriers(image_barrier(image.handle, image.aspect, before, after, discard=discard))

        return Target(
            (barrier(read_as, "color", discard=True), Rendering(self.size, image, None, CLEAR)),
            (barrier(leaves, "color"), Rendering(self.size, image, None)),
            barrier("color", leaves) if leaves != "color" else None,
        )

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record each pass with its items; the first to a target clears it, later ones draw on what is there."""
        self.work = work = LayerWork()
        begun = set()
        for output, drawn in self._passes:
            target = self._targets_of[output]
            ready, rendering = target.again if output in begun else target.first
            begun.add(output)
            commands.barrier(ready)
            commands.begin_rendering(rendering)
            for item in drawn:
                commands.begin_label(item.name)
                self._draw_item(commands, item)
                commands.end_label()
            commands.end_rendering()
            if target.after is not None:
                commands.barrier(target.after)
            work.passes += 1
        work.draws = work.triangles = len(self._enabled)

    def _draw_item(self, commands: Commands, item: Item) -> None:
        pipeline = self._pipelines[item]
        commands.bind_pipeline(pipeline)
        if item in self._sets:
            commands.bind_set(pipeline, 0, self._sets[item])
        commands.draw_triangle()
