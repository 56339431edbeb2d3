"""The study shader-chain on OpenGL: two framebuffers in turn, and textures bound by the names in the shader."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.program_interface import interface_of
from backends.gl.resources import Image, bind_texture
from backends.gl.targets import begin
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import Built, PipelineDescription
from ..stage_gl import Stage
from . import COPY, EMPTY, STUDY, TEXELS, Pass, Settings, chain, check, original, shaders, stored, textures

Units = dict[int, Image]
"""What a pass binds: an image for each of its texture units."""


class Renderer(Stage):
    """A chain of passes, and a last one that shows what has become of the picture."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    original = staticmethod(original)  # yours may stand here
    chain = staticmethod(chain)
    textures = staticmethod(textures)

    def create(self) -> None:
        """Link a program for each different pass; equal ones share theirs."""
        self._chain = self.chain(self.settings)
        wanted = [
            PipelineDescription(shaders(described), described.defines, depth=None, name=described.fragment)
            for described in [*self._chain, COPY]
        ]
        self._pipelines = self.pipelines.get(wanted)
        self._sampler = self.sampler(TEXELS, "texels")
        self._more = {name: self.texture(pixels, "2d", name) for name, pixels in self.textures().items()}

    def create_sized(self) -> None:
        """Make the two targets, or the only one of a chain of one, and find out what each pass reads."""
        form, count = self.settings.format, len(self._chain)
        begun = self.texture(stored(self.original(self.size), form), "2d", "original", form, sized=True)
        targets = [
            self.target(f"target {i}", form, "result" if i == (count - 1) % 2 else "")
            for i in range(min(count, 2))
        ]
        self._framebuffers = [self.framebuffer_of(target, None, target.name) for target in targets]
        # What a pass reads: the original first, then what the one before has written.
        sources = [begun, *(targets[i % 2] for i in range(count))]
        self._units = [
            self._units_of(described, pipeline, {"source": source, "original": begun, **self._more})
            for described, pipeline, source in zip(
                [*self._chain, COPY], self._pipelines, sources, strict=True
            )
        ]

    def _units_of(self, reader: Pass, pipeline: Built, known: dict[str, Image]) -> Units:
        """Return what a pass binds: what its shader declares, found by name. The linked program tells its units."""
        declared = interface_of(self.device, pipeline.handle)
        units = {
            slot.name: int(where.removeprefix("texture unit "))
            for where, slot in declared.items()
            if where.startswith("texture unit ")
        }
        check(reader, units, known)
        return {unit: known[name] for name, unit in units.items()}

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Do the chain. A pass sees all that passes before it drew; only to read its own target is forbidden."""
        self.device.fn.glBindVertexArray(self.no_vertices)
        for i, described in enumerate(self._chain):
            with self.device.label(described.fragment):
                begin(self.device, self._framebuffers[i % 2], (EMPTY,))
                self._fill(i)
        self.begin()
        self._fill(len(self._chain))

    def _fill(self, number: int) -> None:
        self.pipelines.bind(self._pipelines[number], cull=False, front="counter_clockwise")
        for unit, image in self._units[number].items():
            bind_texture(self.device, unit, image.view, self._sampler)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work.draws += 1
        self.work.triangles += 1
