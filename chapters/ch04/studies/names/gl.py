"""The study names on OpenGL: a texture for each name. OpenGL waits by itself where a draw samples a target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from backends.gl.resources import Image, create_image, destroy_image

from ..glow import FORMAT, Pass, passes, size_of
from ..glow.gl_stage import GlowStage
from . import STUDY, Settings, frame


class Renderer(GlowStage):
    """The frame in an order that follows from its names."""

    study = STUDY
    settings_class: type = Settings

    def described(self) -> Mapping[str, Pass]:
        """Return the declared passes by name."""
        return passes(self.settings.show)

    def passes_in_order(self) -> Sequence[str]:
        """Return the order of the passes."""
        ordered, wiring = frame(self.settings)
        self.counts = {"passes": len(ordered), "passes_skipped": len(wiring.left_out)}
        return ordered

    def images(self) -> Mapping[str, Image]:
        """Return a texture of its own for each name."""
        written = [self.passes_by_name[name] for name in self._order if self.passes_by_name[name].writes]
        return {
            described.writes: self._image(described.writes, size_of(described, self.size))
            for described in written
        }

    def _image(self, name: str, size: tuple[int, int]) -> Image:
        image = create_image(self.device, FORMAT, size, name)
        return self.keep_sized(image, lambda image: destroy_image(self.device, image))
