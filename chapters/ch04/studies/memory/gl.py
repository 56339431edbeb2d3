"""The study memory on OpenGL: images of the same size and format share a texture, one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from backends.gl.resources import Image

from ...graph.frame_graph import compile_graph
from ...graph.memory.gl_images import GraphImages
from ..glow import declared
from ..glow.gl_stage import GlowStage
from . import STUDY, Settings


class Renderer(GlowStage):
    """The frame with images that share textures."""

    study = STUDY
    settings_class: type = Settings

    def passes_in_order(self) -> Sequence[str]:
        """Compile the frame, and return the order of its passes."""
        self._graph = compile_graph(declared(), self.size)
        return [step.name for step in self._graph.steps]

    def images(self) -> Mapping[str, Image]:
        """Return the textures of the graph, by name."""
        images = self.keep_sized(
            GraphImages(self.device, self._graph, self.settings.share), GraphImages.close
        )
        self.counts = {
            "passes": len(self._graph.steps),
            "transient_bytes": images.size,
            "transient_bytes_alone": images.alone,
        }
        return images.by_name(self._graph)
