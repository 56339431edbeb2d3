"""What a study needs and is not about: a renderer's life, from opening to closing, whichever the backend.

`vulkan/stage.py` and `gl/stage.py` add what differs between the two. Frames, commands and pipelines are what chapters
teach, and each chapter has its own: `stage_vulkan.py` and `stage_gl.py` among its studies say which. A study itself
writes `create` (what is made once) and `draw` (what happens in a frame). The chapter's own renderer shows the same
without a stage.
"""

from __future__ import annotations

import time as clock
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Literal, TypeVar

import numpy as np

from backends.contract import Reloaded, check_arguments, check_moment, check_names, check_size, resolve
from backends.creation import ImageCreation
from common.errors import StaleFrameError
from common.lessons import Study
from common.scene import Scene
from common.view.camera import View, exposure

Made = TypeVar("Made")


@dataclass(frozen=True)
class NoSettings:
    """The settings of a study that has none."""


@dataclass
class Work:
    """What a frame did, counted by the study that did it."""

    draws: int = 0
    triangles: int = 0


class Stage(ABC):
    """One stream of frames of one view; see `backends.contract.Renderer` for what it promises."""

    study: Study
    frame_logic: ModuleType  # the chapter's frames/frame.py: what a frame is, and how many are in flight
    pipelines: Any
    has_depth = False
    moves = True  # whether time alone changes the picture
    settings_class: type = NoSettings
    passes: tuple[Any, ...] = ()  # whatever a study does is one
    counts: Mapping[str, int] = MappingProxyType({})
    """Counters of a study that are the same in every frame, beside those of `Work`."""

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Any = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        validate: bool = False,
        device: Any = None,
        presents: bool = False,
    ) -> None:
        self.settings, outputs = check_arguments(
            scene, settings, self.settings_class, outputs, self.study.outputs
        )
        without = check_names(without, "without")
        self.scene = self.choose(scene)
        self.outputs = tuple(name for name in self.study.outputs if name in outputs)
        self.presents, self.has_picture = presents, presents or "color" in outputs
        self._owned: list[Any] = []
        self._kept: list[Callable[[], None]] = []
        self._kept_sized: list[Callable[[], None]] = []
        self._closed = False
        self.device = self._open(validate, without) if device is None else device
        self.capabilities = self.device.capabilities
        self.without = {*without, *self.device.without}
        self.plan = resolve((), (), self.capabilities, self.without)
        self._index = 0
        self._reset = "first frame"
        self._previous: tuple[View, float] | None = None
        self._last: Any = None
        # Weak: frames are told when their slot is used again, and a frame that is dropped is freed.
        self._in_slot: list[Callable[[], Any]] = [lambda: None] * self.frame_logic.SLOTS
        try:
            self.size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
            self._set_up()
            self.create()
            self._create_targets()
        except BaseException:
            self.close()
            raise

    # --- what a study writes ---

    def choose(self, scene: Scene) -> Scene:
        """Return what is drawn of `scene`."""
        return scene

    def create(self) -> None:  # noqa: B027  # there may be nothing to make
        """Make what lives as long as the study: pipelines, buffers, textures."""

    def create_sized(self) -> None:  # noqa: B027
        """Make what has the picture's size, after the picture: targets of the study's own, and what refers to them."""

    @abstractmethod
    def draw(self, commands: Any, view: View, time: float) -> None:
        """Draw one frame to the picture."""

    def destroy(self) -> None:  # noqa: B027
        """Free what `create` made and nothing else frees; `create` may have failed halfway."""

    def keep(self, resource: Made, free: Callable[[Made], None]) -> Made:
        """Return the resource; `free(resource)` is called when the study closes, in reverse order."""
        self._kept.append(lambda: free(resource))
        return resource

    def keep_sized(self, resource: Made, free: Callable[[Made], None]) -> Made:
        """Return the resource; `free(resource)` is called when the study closes or the picture changes its size."""
        self._kept_sized.append(lambda: free(resource))
        return resource

    @staticmethod
    def image_of(
        pixels: np.ndarray, shape: Literal["2d", "array", "3d"], name: str, format: str
    ) -> ImageCreation:
        """Return what an image of pixels (H, W, C), or of layers or slices (N, H, W, C), is on either backend."""
        layers, height, width = (1, *pixels.shape[:2]) if shape == "2d" else pixels.shape[:3]
        return ImageCreation(format=format, size=(width, height), shape=shape, layers=layers, name=name)

    # --- what a backend writes ---

    @abstractmethod
    def _open(self, validate: bool, without: Iterable[str]) -> Any:
        """Open a device of this renderer's own."""

    @abstractmethod
    def _set_up(self) -> None:
        """Make what every study uses."""

    @abstractmethod
    def _create_targets(self) -> None:
        """Make everything whose size is the picture's."""

    @abstractmethod
    def _destroy_targets(self) -> None:
        """Free what `keep_sized` does not; it may have been made halfway, or not at all."""

    @abstractmethod
    def _begin(self) -> Any:
        """Return the slot of the next frame, once the GPU has left it."""

    @abstractmethod
    def _draw(self, slot: Any, view: View, time: float) -> None:
        """Draw a frame, copy its outputs, and send it off."""

    @abstractmethod
    def _read(self, slot: Any, name: str) -> np.ndarray:
        """Wait for the slot's frame and return the pixels of a target."""

    @abstractmethod
    def read_timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds of the slot's frame."""

    def read_told(self, slot: Any) -> dict[str, int]:
        """Return the counters that the GPU wrote in the slot's frame, after a wait for it; most studies have none."""
        return {}

    @abstractmethod
    def _wait(self) -> None:
        """Wait for all frames."""

    @abstractmethod
    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        """Have the pipelines take over edited files."""

    @abstractmethod
    def _tear_down(self) -> None:
        """Free what `_set_up` made."""

    # --- the contract ---

    def render(self, view: View, time: float = 0.0) -> Any:
        """Enqueue one frame of `view` at `time` seconds and return it; only the slot's last frame is waited for."""
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)
        started = clock.perf_counter()
        slot = self._begin()
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")
        frame = self.frame_logic.Frame(self, slot, self._index, exposure(view.ev100))
        self.work = Work()
        frame.reset = self._reset or self.frame_logic.reset_by(view, time, self._previous)
        self._draw(slot, view, time)
        self._in_slot[slot.index] = weakref.ref(frame)  # not before: a frame that failed has no times to keep
        frame.work = asdict(self.work) | {**self.counts} | {"history_resets": int(frame.reset != "")}
        self._last = self._state(view, time)
        self._index += 1
        self._reset = ""
        self._previous = view, time
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def read(self, slot: Any, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        self.frame_logic.check_outputs(self.outputs, tuple(self.study.outputs), name)
        pixels: np.ndarray = self.frame_logic.output_of(name, self._read(slot, name), exposed)
        return pixels

    def _state(self, view: View, time: float) -> tuple[View, float]:
        return view, time if self.moves else 0.0

    def idle(self, view: View, time: float = 0.0) -> bool:
        """Whether a frame now would equal the last one: same view, and same time where that matters."""
        return bool(self._last == self._state(view, time))

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size != self.size:
            self._let_go("the size of the picture has changed since")
            self._free_sized()
            self.size = size
            self._create_targets()
            self.reset_history("resize")

    def reset_history(self, reason: str) -> None:
        """Start again at frame 0; a study keeps nothing from frame to frame."""
        self._index, self._last, self._previous = 0, None, None
        self._reset = reason or "asked for"

    @property
    def shader_files(self) -> frozenset[Path]:
        """The files of shaders that can be exchanged; none where a study builds all by itself, to be opened anew."""
        files: frozenset[Path] = self.pipelines.files
        return files

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; time goes on."""
        rebuilt = self._exchange(changed)
        if rebuilt:
            self._last = None  # the same view makes another picture now
        return Reloaded(rebuilt)

    def _let_go(self, why: str) -> None:
        self._wait()
        for held in self._in_slot:
            frame = held()
            if frame is not None:
                frame.let_go(why)

    def _free_sized(self) -> None:
        while self._kept_sized:
            self._kept_sized.pop()()
        self._destroy_targets()

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._let_go("its renderer was closed")
        self._closed = True
        self._free_sized()
        self.destroy()
        for free in reversed(self._kept):
            free()
        self._tear_down()
        for owned in reversed(self._owned):
            owned.close()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
