"""The study's renderer on either API: the chapter's frame, with passes of layers in place of sorted objects."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from backends.contract import check_arguments
from common.errors import SettingError
from common.scene import Scene

from ...frames.commands import DrawGroup, SceneBinding
from ...frames.frame import OUTPUTS
from ...graph.plan import graph_name
from ...renderer import Renderer as ChapterRenderer
from . import Settings
from .passes import peeling_passes


class Peeling(ChapterRenderer):
    """Draws what the chapter draws, and layers of blended objects by peeling.

    Raises SettingError for the forward graph, which draws blended objects in the pass of the solid ones.
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
        if settings.transparency.mode != "sorted" or graph_name(settings) == "forward":
            raise SettingError(
                "The study depth-peeling composites layers itself, behind a G-buffer: leave transparency=sorted, and "
                "set graph=deferred, msaa=1 and view=picture."
            )
        super().__init__(scene, size, settings, without, outputs, **more)

    @staticmethod
    def draw(commands: Any, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene that also bind what the pass samples."""
        raise NotImplementedError

    def _create(self) -> None:
        super()._create()
        sorted_objects = self._plan.passes["transparent"]
        with self._changing():
            self._plan.switch("transparent", False)
            count = self.settings.peeling.layers
            for layer_pass in peeling_passes(self._parts, count, sorted_objects, self.draw):
                self._plan.insert(layer_pass)
            self._rebuild()
