"""What a renderer on either backend keeps from frame to frame: which frame it is, and what the last one showed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from common.scene import Scene
from common.view.camera import View

from ..environment.model import files_at_start
from ..settings import Settings
from .frame import SLOTS, Frame


class FrameStream:
    """One stream of frames of one view of one scene; see `backends.contract.Renderer`.

    A renderer makes `_frames`, `_data` and `_pipelines` of its backend, and calls `_begin_stream` when it is whole.
    """

    scene: Scene
    settings: Settings
    _frames: Any
    _data: Any
    _pipelines: Any

    def _begin_stream(self) -> None:
        self._index = 0
        self._reset = "first frame"
        self._previous: tuple[View, float] | None = None
        self._last: Any = None
        # Only to tell them when their slot is used again: a frame that nobody else holds goes.
        self._in_slot: list[Callable[[], Frame | None]] = [lambda: None] * SLOTS

    @property
    def prepared_ms(self) -> dict[str, float]:
        """What was made on the GPU before the first frame, and how long it took; see the contract."""
        made: dict[str, float] = self._data.prepared_ms
        return made

    def _state(self, view: View, time: float) -> tuple[Any, float, Any]:
        return view, time if self.scene.animations else 0.0, dict(self.scene.revision)

    def idle(self, view: View, time: float = 0.0) -> bool:
        """Whether a frame now would equal the last one: same view, same scene, and nothing that moves by itself."""
        return bool(self._last == self._state(view, time))

    def reset_history(self, reason: str) -> None:
        """Start again at frame 0. This chapter keeps nothing from frame to frame but the previous view and pose."""
        self._index = 0
        self._reset = reason or "asked for"
        self._previous = None
        self._last = None

    @property
    def shader_files(self) -> frozenset[Path]:
        """All on disk that decides about the texts of the shaders; see `backends.contract.Renderer`."""
        files: frozenset[Path] = self._pipelines.files | files_at_start(self.scene, self.settings)
        return files

    def _let_go(self, why: str) -> None:
        """Wait until no frame is in flight, and take the images of those that are still held."""
        for slot in self._frames.slots:
            self._frames.wait(slot)
            last = self._in_slot[slot.index]()
            if last is not None:
                last.let_go(why)

    def close(self) -> None:
        """Free everything on the GPU."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
