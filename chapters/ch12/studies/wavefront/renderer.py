"""The study's renderer on either API: the chapter's frame, whose paths are traced by kernels over queues."""

from __future__ import annotations

from ...paths.technique import PathTechnique
from ...rays.technique import RayTechnique
from ..of_paths import PathStudy
from . import Settings
from .technique import WavePaths, WaveRays

_INSTEAD: dict[type, type] = {RayTechnique: WaveRays, PathTechnique: WavePaths}


class Wavefront(PathStudy):
    """Draws what the chapter draws with its path tracer."""

    KIND = Settings
    TECHNIQUES = tuple(_INSTEAD.get(kind, kind) for kind in PathStudy.TECHNIQUES)  # type: ignore[assignment]
