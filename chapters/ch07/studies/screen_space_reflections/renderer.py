"""The study's renderer on either API: the chapter's frame, with two passes between lighting and what is transparent."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from backends.contract import check_arguments
from common.scene import Scene

from ...frames.frame import OUTPUTS
from ...graph.plan import graph_name
from ...renderer import Renderer as ChapterRenderer
from . import Settings
from .passes import ResolvePass, TracePass, readers_of


class Reflecting(ChapterRenderer):
    """Draws what the chapter draws, and reflections.

    The forward graph, which views and several samples a pixel need, has no G-buffer and draws none.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Settings | None = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        **more: Any,
    ) -> None:
        settings, outputs = check_arguments(scene, settings, Settings, outputs, OUTPUTS)
        super().__init__(scene, size, settings, without, outputs, **more)

    def _create(self) -> None:
        super()._create()
        if graph_name(self._settings) == "forward":
            return
        file = self._plan.file
        own = {name: self._plan.passes[of] for name, of in file.passes.items()}
        self.insert_pass(self.make_pass(TracePass))
        self.insert_pass(self.make_pass(ResolvePass), readers_of(own))
