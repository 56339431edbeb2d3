"""Bloom: light that a lens spreads widely, by a pyramid of halved pictures.

    color_lensed -> bloom_1 -> bloom_2 -> ... -> bloom_K    each half as large; the first one keeps what is bright
    bloom_K -> bloom_up_K-1 -> ... -> bloom_up_1            each level and the wider ones, averaged
    color_lensed, bloom_up_1 -> color_focused               the picture, with a part of its bright light spread

The graph's file names the passes of all levels. A frame leaves out those beyond `bloom_levels`: the first pass on the
way up then reads the widest level instead of what a further pass would write.
"""

from __future__ import annotations

from backends.contract import Access, Sources
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .model import MOST_LEVELS, has_bloom


class BloomPass(FullscreenPass):
    """The common base: one triangle over an image of the picture's format. `level` halves the size that often."""

    sources = Sources()
    shader: str

    def __init__(self, parts: PassParts, level: int) -> None:
        super().__init__(parts)
        self._level = level
        self._format = parts.settings.shading.color_format

    def needed(self, scene: Scene, settings: Settings) -> bool:  # type: ignore[override]
        """Whether light spreads, and as far as this level."""
        return has_bloom(settings) and self._level <= settings.hdr.bloom_levels

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        hdr = self._settings.hdr
        return PipelineDescription(
            shaders=("post/fullscreen.vert", self.shader),
            defines=(
                ("LEVEL", self._level),
                ("LEVELS", hdr.bloom_levels),
                ("THRESHOLD", hdr.bloom_threshold),
                ("STRENGTH", hdr.bloom),
            ),
            color=self._format,
            depth=None,
            name=self.name,
        )

    def _target(self, name: str, instead: str = "") -> tuple[Access, ...]:
        return (Access(name, "color", format=self._format, scale=0.5**self._level, instead=instead),)


class BloomDownPass(BloomPass):
    """Halves the level before, and at the first level keeps what is above the threshold."""

    shader = "hdr/bloom_down.frag"

    def __init__(self, parts: PassParts, level: int) -> None:
        super().__init__(parts, level)
        self.name = f"bloom_down_{level}"
        self.reads = (Access(f"bloom_{level - 1}" if level > 1 else "color_hdr", "sampled"),)
        self.writes = self._target(f"bloom_{level}")


class BloomUpPass(BloomPass):
    """Adds to a level what is in the wider ones, in equal parts."""

    shader = "hdr/bloom_up.frag"

    def __init__(self, parts: PassParts, level: int) -> None:
        super().__init__(parts, level)
        self.name = f"bloom_up_{level}"
        wider = f"bloom_up_{level + 1}" if level + 1 < MOST_LEVELS else f"bloom_{MOST_LEVELS}"
        self.reads = (Access(f"bloom_{level}", "sampled"), Access(wider, "sampled"))
        self.writes = self._target(f"bloom_up_{level}", instead=f"bloom_{level}")

    def needed(self, scene: Scene, settings: Settings) -> bool:  # type: ignore[override]
        """Whether there is a wider level."""
        return has_bloom(settings) and self._level < settings.hdr.bloom_levels


class BloomMixPass(BloomPass):
    """Replaces a part of the picture's bright light by the mean of all levels."""

    name = "bloom"
    shader = "hdr/bloom.frag"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts, 0)
        self.reads = (Access("color_hdr", "sampled"), Access("bloom_up_1", "sampled"))
        self.writes = self._target("color_bloomed", instead="color_hdr")


def bloom_passes(parts: PassParts) -> tuple[BloomPass, ...]:
    """Return the passes of all levels."""
    down = (BloomDownPass(parts, level) for level in range(1, MOST_LEVELS + 1))
    up = (BloomUpPass(parts, level) for level in range(1, MOST_LEVELS))
    return (*down, *up, BloomMixPass(parts))
