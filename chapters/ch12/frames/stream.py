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
    FrameInfo,
    Pass,
    Plan,
    Reloaded,
    Technique,
    check_arguments,
    check_moment,
    check_names,
    check_size,
    resolve,
)
from common.errors import StaleFrameError
from common.scene import Pose, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View

from .. import LESSON
from ..environment.model import files_at_start
from ..loading.loading import Loading
from ..scene.constants import frame_constants
from ..scene.data import SceneData
from ..scene.default_light import DefaultLight
from ..scene.scene_draws import SceneDrawLists
from ..settings import Settings
from ..shading.samples import choose_samples
from ..taa.scale import drawn_size
from ..tasks.workers import ALONE
from .backend.backend import open_backend
from .frame import ALL_OUTPUTS, OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of


class FrameStream:
    """One stream of frames of one view of one scene; see `backends.contract.Renderer`.

    A renderer creates `_frames`, `_data` and `_pipelines` for its API, and calls `_begin_stream`.
    """

    API = "vulkan"
    _draws: SceneDrawLists
    TECHNIQUES: tuple[type[Technique], ...]
    device: Any
    passes: list[Pass]
    _frames: Any
    _data: SceneData
    _pipelines: Any

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
        self._api = open_backend(self.API, device, validate, off)
        self.device = self._api.device
        try:
            self._enter()
            self._follow_device(size, off)
            self._create()
        except BaseException:
            self.close()
            raise

    # --- creation ---

    def _create(self) -> None:
        """Create everything that lasts as long as the renderer."""
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
        self.settings, outputs = check_arguments(scene, settings, Settings, outputs, ALL_OUTPUTS)
        off = check_names(without, "without")
        self._source = scene
        self.techniques: dict[str, Technique] = {}
        for kind in self.TECHNIQUES:
            self.techniques[kind.name] = technique = kind(scene, self.settings)
            scene = technique.scene
        self._light = DefaultLight(scene, self.settings)
        self.scene = self._light.scene
        wanted = {*outputs, *(OUTPUTS if inspect else ())}
        self.outputs = tuple(name for name in ALL_OUTPUTS if name in wanted)
        self._inspects = inspect
        # Targets that are copied after the passes: to the CPU, or to a window.
        self._handed_on = {*(SOURCES[name] for name in self.outputs), *(["color"] if presents else [])}
        self._loading = Loading.of(self.settings.loading, presents)
        self._closed = False
        return off

    def _follow_device(self, size: tuple[int, int], without: Iterable[str]) -> None:
        """Choose what depends on the device: the path of each feature, the picture size, the samples per pixel."""
        self.capabilities: Capabilities = self.device.capabilities
        off = {*without, *self.device.without}
        self.plan: Plan = resolve(LESSON.needs.required, LESSON.needs.optional, self.capabilities, off)
        self.size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        self.samples, short = choose_samples(
            self.settings,
            self._api.offered_samples(self.settings.shading.color_format),
            self.capabilities.device,
        )
        if short:
            self.plan = self.plan.falling_short("msaa", f"{self.samples} samples a pixel", short)

    def _begin_stream(self) -> None:
        self._index = 0
        self._reset = "first frame"
        self._previous: tuple[View, float] | None = None
        self._last: Any = None
        # Weak references, to invalidate a frame's images when its slot is used again; they keep no frame alive.
        self._in_slot: list[Callable[[], Frame | None]] = [lambda: None] * SLOTS

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
            self._create_passes()
            self._frames.forget()
            data.followed()
        previous = self._previous
        if reset:  # the previous view and pose are not valid for this frame
            previous = None
            data.records.forget_pose()
            for technique in self.techniques.values():
                technique.reset(reset)
        posed = self._pose(time)
        pose = self._light.pose(posed, view)
        info = self._info(slot, view, time, posed, self._valid_histories(slot, reset))
        more = {key: value for it in self.techniques.values() for key, value in it.constants(info).items()}
        constants = frame_constants(
            scene,
            info.size,
            view,
            time,
            previous=previous,
            index=self._index,
            ambient=self._light.ambient(),
            environment=data.environment,
            more=more,
        )
        constants["valid_histories"] = info.valid_histories
        data.write_frame(slot.index, constants)
        written = constants.nbytes + data.records.write(data.slots[slot.index], pose)
        written += self._api.deform(slot, pose)
        written += self._draws.prepare(slot.index, view)
        written += sum(technique.prepare(info) for technique in self.techniques.values())
        data.update_textures(slot.index, view)
        self._last = self._state(view, time)
        return written

    def _info(self, slot: Any, view: View, time: float, pose: Pose, valid: int) -> FrameInfo:
        """Return what techniques are told of a frame, before any of them prepares it."""
        last = [technique for technique in self.techniques.values() if technique.settles_last]
        still = bool(last) and self._unchanged(self._state(view, time), time)
        settling = bool(last) and not all(technique.resting(time) for technique in last)
        drawn = drawn_size(self.settings, self.size)
        return FrameInfo(slot.index, view, time, drawn, pose, self.passes, still, settling, valid, self.size)

    def _pose(self, time: float) -> Pose:
        """Return the pose that is drawn at `time`."""
        pose = evaluate_pose(self._source, time)
        for technique in self.techniques.values():
            pose = technique.pose(pose)
        return pose

    def _valid_histories(self, slot: Any, reset: str) -> int:
        """Return the bits of the histories that a frame may use."""
        raise NotImplementedError

    def _create_passes(self) -> None:
        """Build or rebuild the pipelines of all passes, and the scene's descriptor sets for them."""
        raise NotImplementedError

    def _end_frame(self, frame: Frame, view: View, time: float, work: dict[str, int], written: int) -> None:
        """Store the counters of the frame, and keep its view and time as the previous ones."""
        counts = {
            "samples": self.samples,
            "instances": self._draws.visible,
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
        }
        for technique in self.techniques.values():
            counts |= technique.work
        counts |= self._object_counts() | {"history_resets": int(frame.reset != "")}
        frame.work = ALONE | work | self._data.texture_work | counts
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
        rest = all(subject.resting(time) for subject in self.techniques.values() if subject.settles_last)
        return rest and self._unchanged(self._state(view, time), time)

    def _unchanged(self, state: tuple[Any, float, Any], time: float) -> bool:
        """Whether a frame shows what the last one did, apart from subjects that settle when all others have."""
        if self._last != state or self._loading.busy:
            return False
        return all(subject.resting(time) for subject in self.techniques.values() if not subject.settles_last)

    def wait_loaded(self) -> None:
        """Wait until every texture is loaded or has failed: the next frame is the final picture."""
        if self._loading.busy:
            self._enter()
            self._data.load_textures()
            self._last = None  # the same view gives another picture now

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
        inspected = self._api.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), ALL_OUTPUTS, name)
        self._enter()
        self._frames.wait(slot)
        readback = (dict(self._api.readbacks(slot)) | inspected).get(name)
        if readback is None and name not in OUTPUTS:
            raise StaleFrameError(f"There is no '{name}': only paths are summed, with path_tracer=on.")
        if readback is None:  # an empty scene has no instances, and no pass that draws them
            shape = (*self.size[::-1], 2) if name == "motion" else self.size[::-1]
            return np.zeros(shape, np.uint32 if name == "instance_id" else np.float32)
        if name == "color_linear" and self._data.exposures is not None:
            exposed = self._data.exposures.of_frame(slot.index, exposed)
        return output_of(name, readback.read(), exposed)

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size == self.size or self._closed:
            return
        self._enter()
        self._let_go("the size of the picture has changed since")
        self._api.leave()
        self.size = size
        self._create_targets()
        self.reset_history(self._reset or "resize")

    def _enter(self) -> None:
        """Prepare for calls of the API: OpenGL makes its context current."""
        self._api.enter()

    def _create_targets(self) -> None:
        """Create everything that depends on the picture size."""
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

    def _free(self) -> None:
        """Free what `close` itself does not; no frame is in flight."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
