"""Fog outside of its passes: the block of each frame, the store, and until when a history changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Scene

from ..environment import model as environment
from ..frames.backend.backend import Backend
from ..hdr.model import automatic
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .memory import BLOCK, OF_FRAME, FogMemory
from .passes import FOG_PASSES, LIT, FogPass, HalfPass, InjectPass, NoisePass, read_fog

WIND_LENGTH = math.hypot(*model.WIND)

SHADERS = "shaders"
"""The reason of a reset after a reload: kernels of a view at rest would not run again by themselves."""

HALF_WITHOUT_EFFECT = (
    "fog_half has no effect without a G-buffer: the depth of surfaces is not known before they are lit."
)


class FogTechnique(Technique):
    """Owns what all shaders see of fog.

    The share of a frame in the history is 1 / n in frame n of a view without changes, so the history is their mean.
    After REST_FRAMES it stays as it is: the next frame makes the other image equal, and later ones have no work. While
    something changes, the share is that of the settings.
    """

    name = "fog"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        if model.wanted(settings):
            model.check(scene, settings)
        self._knobs, self._by_paths = settings.fog, settings.paths.path_tracer
        self._memory: FogMemory | None = None
        self._own: tuple[FogPass, ...] = ()
        self._age = self._still = 0
        self._state: Any = None
        self._size: tuple[int, int] | None = None
        self._noise_sent = self._visible = False
        self._passes: Any = None
        self._shadows: Any = None
        self._cloth: Any = None
        self._drawn, self._moment = 0, 0.0

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the passes, and the memory, which becomes a part of the scene's bindings."""
        self._parts, self._backend = parts, backend
        self._own = tuple(kind(parts) for kind in FOG_PASSES)
        self.passes = {gpu_pass.name: gpu_pass for gpu_pass in self._own}
        (self._noise,) = (own for own in self._own if isinstance(own, NoisePass))
        (self._inject,) = (own for own in self._own if isinstance(own, InjectPass))
        (self._half,) = (own for own in self._own if isinstance(own, HalfPass))
        if not model.needed(parts.scene, parts.settings):
            return
        if FogPass.needed(parts.scene, parts.settings):
            read_fog([gpu_pass for name, gpu_pass in passes.items() if name in LIT])
        without = model.half_in_use(parts.settings) and not HalfPass.needed(parts.scene, parts.settings)
        if without and HALF_WITHOUT_EFFECT not in parts.scene.warnings:
            parts.scene.warnings.append(HALF_WITHOUT_EFFECT)
        self._medium = model.medium_of(parts.scene, self._knobs)
        self._blows, self._halves = model.noise_in_use(parts.settings), model.half_in_use(parts.settings)
        self._adapts = bool(automatic(parts.settings))
        self._memory = parts.data.fog = backend.part(__package__).FogMemory(
            backend, model.table_bytes(parts.settings) if model.tables_in_use(parts.settings) else 0
        )
        self._block = block = self._fixed_block()
        self._bytes = block.reshape(1).view(np.uint8).data  # of the same memory
        self._make_store((1, 1))

    def _fixed_block(self) -> np.ndarray:
        """Return the block with all that no frame changes."""
        scene, knobs, medium = self._parts.scene, self._knobs, self._medium
        block = np.zeros((), BLOCK)
        near, far = model.range_of(scene, knobs)
        self._extent = model.Extent(medium, far)
        block["range"] = near, np.log2(far / near), far, knobs.fog_anisotropy
        block["size"] = *model.grid_of(knobs), len(medium.boxes)
        block["constant"] = *medium.albedo, medium.extinction
        block["height"] = *medium.albedo, medium.height_extinction
        periods = 1.0 / (knobs.fog_noise_period * scene.length_scale)
        self._wind_speed = float(knobs.fog_wind * periods)
        base = medium.height_base - scene.origin[1]
        block["shape"] = base, medium.height_falloff, knobs.fog_noise, periods
        block["bounds"][:3] = (scene.bounds[1] - scene.bounds[0]) / 2
        block["bounds"][3] = knobs.fog_half_tolerance
        self._dither = knobs.fog_dither / 255
        for record, box in zip(block["boxes"], medium.boxes, strict=False):
            record["center"] = *(np.array(box.center) - scene.origin), box.extinction
            record["half_size"][:3], record["albedo"][:3] = box.half_size, box.albedo
        if scene.environment is not None and environment.needed(scene, self._parts.settings):
            mean = mean_radiance(scene.environment.radiance)
            block["ambient"][:3] = mean * self._parts.settings.environment.intensity
        return block

    # --- every frame ---

    def prepare(self, frame: FrameInfo) -> int:
        """Write the block of the slot; return the bytes written."""
        if self._memory is None:
            return 0
        if frame.passes is not self._passes or frame.size != self._size:
            self._follow(frame)
        if self._noise_sent:
            self._noise.due = False
        if self._shadows is not None and len(self._shadows.schedule.faces):
            self._drawn += 1  # the last frame drew shadow maps, which froxels read
        wind, was_visible = self._wind(frame.time), self._visible
        if self._moves or (self._cloth is not None and self._cloth.busy(frame.time)):
            self._moment = frame.time  # that of the last frame in which something moved
        state = frame.view, self._moment, wind, dict(self.scene.revision), self._drawn
        if state == self._state:
            self._still += 1
        else:
            self._state, self._still = state, 0
            self._visible = self._extent.in_view(frame.view, frame.picture[0] / frame.picture[1])
        visible = self._visible
        rests = self._still > model.REST_FRAMES and not self._adapts
        active = visible and not rests
        if self._inject.active != active:
            for own in self._own:
                own.active = active
        numbers = self._age & 255, self._still > 0, visible, was_visible
        OF_FRAME.pack_into(self._bytes, 0, *wind, self._share(), self._dither, *numbers)
        self._age = self._age + 1 if visible else 0
        self._noise_sent = self._noise.due and visible
        return self._memory.write(frame.slot, self._bytes)

    def _follow(self, frame: FrameInfo) -> None:
        """Find what follows from the passes of the frame and the size of the picture, which seldom change."""
        if self._halves and self._size != frame.size:
            self._make_store(frame.size)
            self._show_store(frame)
        named = {gpu_pass.name: gpu_pass for gpu_pass in frame.passes}
        self._passes, self._size = frame.passes, frame.size
        self._moves, self._shadows, self._cloth = (
            bool(self.scene.animations),
            named.get("shadows"),
            named.get("cloth"),
        )
        self._state = None  # without a filter, as an example: kernels of a view at rest run again
        self._half.size = frame.size
        columns = -(-frame.size[0] // 2) if "fog_half" in named else 0
        self._block["places"] = 0, self._places.froxels, self._places.pixels, columns

    def _make_store(self, size: tuple[int, int]) -> None:
        """Make the store for a picture of `size` pixels."""
        assert self._memory is not None, "there is fog"
        model.check_device(self._parts.settings, self._backend.device.capabilities.limits, size)
        self._places, self._size = model.places_of(self._parts.settings, size), size
        self._memory.make(self._places.words)

    def _show_store(self, frame: FrameInfo) -> None:
        """Let shaders see another store."""
        parts = self._parts
        self._backend.make_sets(frame.passes)
        self._backend.frames.forget()
        parts.draws.revision += 1
        parts.draws.binding = parts.draws.binding._replace(frame=parts.data.binding(frame.slot).frame)

    def _share(self) -> float:
        """Return the share of this frame in the history."""
        if self._still >= model.REST_FRAMES:
            return 0.0
        return max(1.0 / (self._age + 1), min(self._knobs.fog_share, 1.0 / (self._still + 1)))

    def _wind(self, time: float) -> tuple[float, float, float]:
        """Return the shift of the noise in periods, 0 to 1: wrapped in float64, so that it loses no digits."""
        if not self._blows:
            return (0.0, 0.0, 0.0)
        periods = self._wind_speed * time / WIND_LENGTH
        x, y, z = model.WIND
        return x * periods % 1.0, y * periods % 1.0, z * periods % 1.0

    def resting(self, time: float) -> bool:
        """Whether the history stays as it is, and no wind blows."""
        if self._memory is None or self._state is None or self._by_paths:
            return True
        rests = self._still >= model.REST_FRAMES or not (self._knobs.fog_temporal and self._visible)
        return rests and self._wind(time) == self._state[2]

    def reset(self, reason: str) -> None:
        """Begin the history anew; with other shaders the noise, too."""
        self._age, self._state = 0, None
        if reason == SHADERS:
            self._noise.due, self._noise_sent = True, False

    def close(self) -> None:
        """Free the memory."""
        if self._memory is not None:
            self._memory.close()


def mean_radiance(radiance: np.ndarray) -> np.ndarray:
    """Return the mean (3,) of a panorama (H, 2H, 3) over all directions."""
    rows = len(radiance)
    weights = np.diff(-np.cos(np.arange(rows + 1) * np.pi / rows)) / 2
    mean: np.ndarray = weights @ radiance.mean(axis=1, dtype=np.float64)
    return mean
