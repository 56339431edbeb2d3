"""The study shader-chain on Vulkan: pipelines and sets by reflection, and the barriers of two targets in turn."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import Image
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import Built, PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import COPY, EMPTY, STUDY, TEXELS, Pass, Settings, chain, check, original, shaders, stored, textures


class Renderer(Stage):
    """A chain of passes, and a last one that shows what has become of the picture."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    original = staticmethod(original)  # yours may stand here
    chain = staticmethod(chain)
    textures = staticmethod(textures)

    def create(self) -> None:
        """Make a pipeline for each different pass; equal ones share theirs."""
        self._chain = self.chain(self.settings)
        wanted = [self._described(described, self.settings.format) for described in self._chain]
        *self._pipelines, self._show = self.pipelines.get([*wanted, self._described(COPY, "rgba8")])
        self._sampler = self.sampler(TEXELS, "texels")
        self._more = {name: self.texture(pixels, "2d", name) for name, pixels in self.textures().items()}

    @staticmethod
    def _described(described: Pass, format: str) -> PipelineDescription:
        return PipelineDescription(
            shaders(described), described.defines, color=format, depth=None, name=described.fragment
        )

    def create_sized(self) -> None:
        """Make the two targets, or the only one of a chain of one, and what each pass reads and waits for."""
        form, count = self.settings.format, len(self._chain)
        begun = self.texture(stored(self.original(self.size), form), "2d", "original", form, sized=True)
        last = (count - 1) % 2
        targets = [
            self.target(f"target {i}", form, "result" if i == last else "", leaves="sampled")
            for i in range(min(count, 2))
        ]
        # What a pass reads: the original first, then what the one before has written.
        sources = [begun, *(targets[i % 2] for i in range(count))]
        self._sets = [
            self._set(described, pipeline, {"source": source, "original": begun, **self._more})
            for described, pipeline, source in zip(
                [*self._chain, COPY], [*self._pipelines, self._show], sources, strict=True
            )
        ]
        self._renderings = [Rendering(self.size, target, None, EMPTY) for target in targets]
        self._before: list[Any] = []
        for i in range(count + 1):
            written = [self._barrier(targets[(i - 1) % 2], "color", "sampled")] if i else []
            if i < count:
                # All reads of the overwritten target must be over: those of a pass of this chain, and of the previous
                # frame, which also copied the result.
                reader = "copy_source" if i == last and i < 2 else "sampled"
                written.append(self._barrier(targets[i % 2], reader, "color", discard=True))
            self._before.append(barriers(*written))

    @staticmethod
    def _barrier(image: Image, before: str, after: str, discard: bool = False) -> Any:
        return image_barrier(image.handle, image.aspect, before, after, discard=discard)

    def _set(self, reader: Pass, pipeline: Built, known: dict[str, Image]) -> Any:
        """Return the set of a pass: what its shader declares, found by name."""
        layout = pipeline.sets[0]
        assert layout is not None  # a pass that reads nothing is no effect
        check(reader, [binding.name for binding in layout.bindings], known)
        held = {
            binding.number: Texture(known[binding.name].view, self._sampler) for binding in layout.bindings
        }
        sets = self.descriptors.create([(layout, held, f"set of {reader.fragment}")])
        self.keep_sized(sets, self.descriptors.destroy)
        return vk.array("VkDescriptorSet", sets.handles)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the chain: before each pass, one barrier for what it reads and what it writes."""
        for i, (described, pipeline) in enumerate(zip(self._chain, self._pipelines, strict=True)):
            commands.begin_label(described.fragment)
            commands.barrier(self._before[i])
            commands.begin_rendering(self._renderings[i % 2])
            self._fill(commands, pipeline, self._sets[i])
            commands.end_rendering()
            commands.end_label()
        commands.barrier(self._before[-1])
        self.begin(commands)
        self._fill(commands, self._show, self._sets[-1])
        self.end(commands)

    def _fill(self, commands: Commands, pipeline: Built, held: Any) -> None:
        commands.bind_pipeline(pipeline)
        commands.bind_set(pipeline, 0, held)
        commands.draw_triangle()
        self.work.draws += 1
        self.work.triangles += 1
