"""The overlay of culling: bounds as lines over the picture, in the colour of what became of them, or the depth pyramid.

Lines are narrow rectangles, drawn twice: faint everywhere, and strong where nothing is in front of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access, Pass

from ..frames.commands import Commands
from ..pipelines.description import Built, PipelineDescription
from ..scene.pass_parts import PassParts
from ..shading import views
from .memory import CullingMemory
from .passes import PYRAMIDS, SHOWN, CullingPass

SEGMENTS = 24
"""Lines of a circle."""

FAINT, STRONG = 0.25, 1.0
"""Opacity of lines behind the nearest surface, and in front of it."""

SHAPES = ("boxes", "spheres", "frustum", "pyramid")
"""The shapes of `overlay.vert`, in the order of their numbers."""

VERTICES = {"boxes": 6 * 12, "spheres": 6 * 3 * SEGMENTS, "frustum": 6 * 12, "pyramid": 3}
"""Vertices of each shape: six for a line."""


class OverlayPass(CullingPass):
    """Draws over what the forward pass has drawn: `under` is that pass, or the one that draws the late phase.

    Of the graphs only the forward one has this pass; no frame draws it unless it is asked for.
    """

    name = "overlay"

    def __init__(self, parts: PassParts, memory: CullingMemory, under: Pass, pyramid: bool) -> None:
        super().__init__(memory, memory.overlay != "off")
        self._settings, self._draws_pipelines = parts.settings, parts.pipelines
        self._instances = len(parts.scene.instances)
        self._built: dict[tuple[str, float], Built] = {}
        if not self._needed:
            return
        memory.overlay_pipeline = lambda: next(iter(self._built.values()))
        depth, samples = views.depth_target(parts.settings), parts.settings.shading.msaa
        self.reads = (Access(depth, "depth", samples=samples),)
        self.reads += (Access(PYRAMIDS[0], "storage", stages=SHOWN),) if pyramid else ()
        color = next(access for access in under.writes if access.use == "color")
        plain = f"{color.resource}_plain"
        under.writes = tuple(
            replace(access, resource=plain) if access is color else access for access in under.writes
        )
        self.writes = (replace(color, of=plain, clear=None),)

    def create(self) -> None:
        """Build the pipelines. They bind no set of the scene: all that they read is in a set of culling."""
        kind = self._memory.overlay
        keys = [(shape, opacity) for shape in (kind, "frustum") for opacity in (FAINT, STRONG)]
        keys = [("pyramid", STRONG)] if kind == "pyramid" else keys
        built = self._draws_pipelines.get([self._describe(*key) for key in keys])
        self._built = dict(zip(keys, built, strict=True))

    def _describe(self, shape: str, opacity: float) -> PipelineDescription:
        view, choice = views.of(self._settings), self._memory.choice
        flags = {"LIGHT": view is None or view.shown == "light", "TESTED": choice.runs}
        return PipelineDescription(
            shaders=(
                "culling/overlay.vert",
                "culling/overlay_pyramid.frag" if shape == "pyramid" else "culling/overlay.frag",
            ),
            defines=(
                ("SHAPE", SHAPES.index(shape)),
                ("OPACITY", opacity),
                ("SEGMENTS", f"{SEGMENTS}u"),
                *choice.defines,
                *((name, 1) for name, on in flags.items() if on),
            ),
            color=self._settings.shading.color_format,
            depth="test",
            blend="over" if opacity < STRONG else None,
            samples=self._settings.shading.msaa,
            name=f"overlay of {shape}",
        )

    def record(self, commands: Commands) -> None:
        """Record the draws."""
        memory = self._memory
        counts = {"boxes": self._instances, "spheres": memory.spheres, "pyramid": 1}
        counts["frustum"] = int(memory.view.is_frozen)
        for (shape, _), pipeline in self._built.items():
            if counts[shape]:
                memory.draw_overlay(commands, pipeline, VERTICES[shape], counts[shape])

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on."""
        return self._memory.revision, self._memory.level, self._memory.view.is_frozen
