"""The common base of the renderers on both APIs: arguments, choice of passes, constants, reading, resizing.

Renderers derive from it and add the frame itself: the order of the passes, and the barriers between them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, Self

import numpy as np

from backends.contract import (
    Capabilities,
    Pass,
    Plan,
    Reloaded,
    check_arguments,
    check_moment,
    check_names,
    check_size,
    resolve,
)
from common.errors import StaleFrameError
from common.scene import Pose, Scene
from common.scene.pose import evaluate_pose
from common.settings import replaced
from common.view.camera import View, exposure

from .. import LESSON
from ..environment.model import files_at_start
from ..post.resolve import ResolvePass
from ..post.tonemap import TonemapPass
from ..scene.constants import frame_constants
from ..scene.data import SceneData
from ..scene.default_light import DefaultLight
from ..scene.pass_parts import PassParts
from ..scene.scene_draws import SceneDrawLists
from ..settings import Settings
from ..shading.forward import ForwardPass
from ..shading.instance_id import InstanceIdPass
from ..shading.samples import choose_samples
from .frame import OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of


class FrameStream:
    """One stream of frames of one view of one scene; see `backends.contract.Renderer`.

    A renderer creates `_frames`, `_data` and `_pipelines` for its API, and calls `_begin_stream`.
    """

    PARTS: tuple[str, ...]
    """Attributes that `close` closes, in this order; opening may have failed before some were set."""

    device: Any
    passes: list[Pass]
    inspection: Any
    _frames: Any
    _data: SceneData
    _pipelines: Any
    _readbacks: list[dict[str, Any]]

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Settings | None = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        validate: bool = False,
        device: Any = None,
        presents: bool = False,
        inspect: bool = False,
    ) -> None:
        off = self._take(scene, settings, without, outputs, presents, inspect)
        self.device = device if device is not None else self._open_device(validate, off)
        try:
            self._enter()
            self._follow_device(size, off)
            self._create()
        except BaseException:
            self.close()
            raise

    # --- creation ---

    def _open_device(self, validate: bool, without: Iterable[str]) -> Any:
        """Return a new device, which the renderer owns and closes (`_owned`)."""
        raise NotImplementedError

    def _create(self) -> None:
        """Create everything that lasts as long as the renderer, and call `_make_passes` and `_create_targets`."""
        raise NotImplementedError

    def _take(
        self,
        scene: Scene,
        settings: Settings | None,
        without: Iterable[str],
        outputs: Collection[str],
        presents: bool,
        inspect: bool,
    ) -> tuple[str, ...]:
        """Store the arguments of a renderer, and return the names in `without`. Raises UserError for wrong ones."""
        self.settings, outputs = check_arguments(scene, settings, Settings, outputs, OUTPUTS)
        off = check_names(without, "without")
        self._light = DefaultLight(scene, self.settings)
        self.scene = self._light.scene
        self.outputs = tuple(name for name in OUTPUTS if name in outputs or inspect)
        self._inspects = inspect
        # Targets that are copied after the passes: to the CPU, or to a window.
        self._handed_on = {*(SOURCES[name] for name in self.outputs), *(["color"] if presents else [])}
        self._owned: list[Any] = []
        self._closed = False
        return off

    def _follow_device(self, size: tuple[int, int], without: Iterable[str]) -> None:
        """Choose what depends on the device: the path of each feature, the picture size, the samples per pixel."""
        self.capabilities: Capabilities = self.device.capabilities
        off = {*without, *self.device.without}
        self.plan: Plan = resolve(LESSON.needs.required, LESSON.needs.optional, self.capabilities, off)
        self.size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        self.samples, short = choose_samples(self.settings, self._offered(), self.capabilities.device)
        if short:
            self.plan = self.plan.falling_short("msaa", f"{self.samples} samples a pixel", short)

    def _offered(self) -> set[int]:
        """Return the sample counts that the targets of the forward pass can have."""
        raise NotImplementedError

    def _begin_stream(self) -> None:
        self._index = 0
        self._reset = "first frame"
        self._previous: tuple[View, float] | None = None
        self._last: Any = None
        # Weak references, to invalidate a frame's images when its slot is used again; they keep no frame alive.
        self._in_slot: list[Callable[[], Frame | None]] = [lambda: None] * SLOTS

    def _make_passes(self) -> None:
        """Create all passes, and build the pipelines of those that the frame consists of."""
        scene, settings = self.scene, replaced(self.settings, msaa=self.samples)
        self._draws = SceneDrawLists(scene, self._data)
        parts = PassParts(scene, settings, self._data, self._draws, self._pipelines)
        self._forward, self._instance_id = ForwardPass(parts), InstanceIdPass(parts)
        self._resolve, self._tonemap = ResolvePass(parts), TonemapPass(parts)
        self.passes = [self._forward]
        id_outputs = {access.resource for access in self._instance_id.writes} & set(self.outputs)
        if id_outputs and InstanceIdPass.needed(scene, settings):
            self.passes.append(self._instance_id)
        if {"color", "color_hdr"} & self._handed_on and ResolvePass.needed(scene, settings):
            self.passes.append(self._resolve)
        if "color" in self._handed_on:
            self.passes.append(self._tonemap)
        for gpu_pass in self.passes:
            gpu_pass.create()
        self._make_sets()

    def _make_sets(self) -> None:
        """Create the scene's descriptor sets for the pipelines of all passes; OpenGL has none."""

    # --- every frame ---

    def _check_frame(self, view: View, time: float) -> None:
        """Raise StaleFrameError if the renderer is closed, and UserError for an invalid view or time."""
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)

    def _use_again(self, slot: Any) -> None:
        """Invalidate the images of the frame that was in `slot` before: the new frame overwrites them."""
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")

    def _update(self, slot: Any, view: View, time: float, reset: str) -> int:
        """Write the data that this frame's shaders read; return the bytes written."""
        scene, data = self.scene, self._data
        if data.follow_materials():
            for gpu_pass in (self._forward, self._instance_id):
                if gpu_pass in self.passes:
                    gpu_pass.create()
            self._make_sets()
            data.followed()
        previous = self._previous
        if reset:  # the previous view and pose are not valid for this frame
            previous = None
            data.records.forget_pose()
        pose = self._light.pose(evaluate_pose(scene, time), view)
        constants = frame_constants(
            scene,
            self.size,
            view,
            time,
            previous=previous,
            index=self._index,
            ambient=self._light.ambient(),
            environment=data.environment,
        )
        data.write_frame(slot.index, constants)
        written = constants.nbytes + data.records.write(data.slots[slot.index], pose, exposure(view.ev100))
        written += self._deform(slot, pose)
        written += self._draws.prepare(slot.index, view)
        data.update_textures(slot.index, view)
        self._last = self._state(view, time)
        return written

    def _deform(self, slot: Any, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        raise NotImplementedError

    def _end_frame(self, frame: Frame, view: View, time: float, work: dict[str, int], written: int) -> None:
        """Store the counters of the frame, and keep its view and time as the previous ones."""
        counts = {
            "passes": len(self.passes),
            "passes_skipped": 4 - len(self.passes),
            "samples": self.samples,
            "instances": self._draws.visible,
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
        }
        counts |= self._object_counts() | {"history_resets": int(frame.reset != "")}
        frame.work = work | counts
        self._index += 1
        self._reset = ""
        self._previous = view, time

    def _object_counts(self) -> dict[str, int]:
        """Return the number of API objects of each kind."""
        raise NotImplementedError

    # --- for callers ---

    @property
    def prepared_ms(self) -> dict[str, float]:
        """Milliseconds of each preparation on the GPU before the first frame; see the contract."""
        return self._data.prepared_ms

    def _state(self, view: View, time: float) -> tuple[Any, float, Any]:
        return view, time if self.scene.animations else 0.0, dict(self.scene.revision)

    def idle(self, view: View, time: float = 0.0) -> bool:
        """Whether a frame now would equal the last one: same view, same scene, and nothing moves by itself."""
        return bool(self._last == self._state(view, time))

    def reset_history(self, reason: str) -> None:
        """Start again at frame 0; the next frame does not use the previous view and pose."""
        self._index = 0
        self._reset = reason or "asked for"
        self._previous = None
        self._last = None

    @property
    def shader_files(self) -> frozenset[Path]:
        """All files that the texts of the shaders depend on; see `backends.contract.Renderer`."""
        files: frozenset[Path] = self._pipelines.files | files_at_start(self.scene, self.settings)
        return files

    def _reloaded(self, rebuilt: tuple[str, ...], changed: Collection[Path]) -> Reloaded:
        """Return the result of a reload: the `rebuilt` pipelines, and changed files that are only read at the start."""
        if rebuilt:
            self._last = None  # the same view gives another picture now
        return Reloaded(rebuilt, files_at_start(self.scene, self.settings).intersection(changed))

    def read(self, slot: Any, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        inspected = self.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), OUTPUTS, name)
        self._enter()
        self._frames.wait(slot)
        readback = (self._readbacks[slot.index] | inspected).get(name)
        if readback is None:  # an empty scene has no instances, and no pass that draws them
            return np.zeros(self.size[::-1], np.uint32 if name == "instance_id" else np.float32)
        return output_of(name, readback.read(), exposed)

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size == self.size:
            return
        self._enter()
        self._let_go("the size of the picture has changed since")
        self._destroy_targets()
        self.size = size
        self._create_targets()
        self.reset_history(self._reset or "resize")

    def _enter(self) -> None:
        """Prepare for calls of the API: OpenGL makes its context current."""

    def _create_targets(self) -> None:
        """Create everything that depends on the picture size."""
        raise NotImplementedError

    def _destroy_targets(self) -> None:
        """Free the targets; no frame is in flight."""
        raise NotImplementedError

    def _let_go(self, why: str) -> None:
        """Wait until no frame is in flight, and invalidate the images of all frames."""
        for slot in self._frames.slots:
            self._frames.wait(slot)
            last = self._in_slot[slot.index]()
            if last is not None:
                last.let_go(why)

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self._enter()
        if hasattr(self, "_in_slot"):  # otherwise opening failed, and there are no frames
            self._let_go("its renderer was closed")
        self._free()
        for name in self.PARTS:
            component = getattr(self, name, None)
            if component is not None:
                component.close()
        for owned in reversed(self._owned):
            owned.close()

    def _free(self) -> None:
        """Free what `close` itself does not; no frame is in flight."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
