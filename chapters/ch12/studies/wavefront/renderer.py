"""The study's renderer on either API: the chapter's frame, whose paths are traced by kernels over queues."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from backends.contract import check_arguments
from common.scene import Scene

from ...frames.frame import OUTPUTS
from ...paths.technique import PathTechnique
from ...rays.technique import RayTechnique
from ...renderer import Renderer as ChapterRenderer
from . import Settings
from .technique import WavePaths, WaveRays

_INSTEAD: dict[type, type] = {RayTechnique: WaveRays, PathTechnique: WavePaths}


class Wavefront(ChapterRenderer):
    """Draws what the chapter draws with its path tracer."""

    TECHNIQUES = tuple(_INSTEAD.get(kind, kind) for kind in ChapterRenderer.TECHNIQUES)  # type: ignore[assignment]

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
