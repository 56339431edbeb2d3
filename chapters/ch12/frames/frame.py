"""A rendered frame: its images, until its slot is used again, and its timings and work for ever."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from common.errors import StaleFrameError
from common.view.camera import View

SLOTS = 2
"""Frames in flight. With one slot, CPU and GPU would take turns; a third adds a frame of latency and no speed."""


OUTPUTS = ("color", "color_linear", "depth", "instance_id", "motion")
"""The outputs that a frame can have."""

ALL_OUTPUTS = (*OUTPUTS, "path_sums", "path_squares")
"""The same, and what paths are summed in (paths/passes.py): only a picture that is traced by paths has these."""

SOURCES = {
    "color": "color",
    "color_linear": "color_hdr",
    "depth": "depth",
    "instance_id": "instance_id",
    "motion": "motion",
    "path_sums": "history_paths",
    "path_squares": "history_squares",
}
"""The target that each output is read from."""


class FrameRing:
    """The frame slots of a renderer, used in turn."""

    slots: list[Any]
    number = 0
    """The number of frames submitted."""

    def wait(self, slot: Any) -> None:
        """Wait until the GPU has finished the frame that used `slot` last."""
        raise NotImplementedError

    def close(self) -> None:
        """Free each slot after the GPU has finished its last frame."""
        for slot in self.slots:
            self.wait(slot)
            slot.close()


class Reads(Protocol):
    """The methods of a renderer that its frames call."""

    def read(self, slot: Any, name: str, exposed: float) -> np.ndarray:
        """Wait for the slot's frame and return its output `name`."""

    def read_timings(self, slot: Any) -> dict[str, float]:
        """Wait for the slot's frame and return GPU milliseconds by pass."""

    def read_told(self, slot: Any) -> dict[str, int]:
        """Return the counters that the GPU wrote in the slot's frame; waits for the frame if there are any."""


class Frame:
    """One rendered frame; see `backends.contract.Frame`. `slot.number` counts all frames of the renderer."""

    def __init__(self, renderer: Reads, slot: Any, index: int, exposure: float) -> None:
        self._renderer, self._slot, self._number = renderer, slot, slot.number
        self.index, self._exposure = index, exposure
        self.cpu_ms = 0.0
        self.reset = ""
        self._work: dict[str, int] = {}
        self._told = False
        self._timings: dict[str, float] | None = None
        self._gone = ""

    def image(self, name: str) -> np.ndarray:
        """Wait for the frame and return output `name` as (H, W) or (H, W, C), row 0 on top."""
        if self._gone:
            raise StaleFrameError(
                f"Frame {self._number} is gone: {self._gone}. Read a frame's images before {SLOTS} more are rendered."
            )
        return self._renderer.read(self._slot, name, self._exposure)

    @property
    def timings(self) -> dict[str, float]:
        """GPU milliseconds by pass; waits for the frame."""
        if self._timings is None:
            self._timings = self._renderer.read_timings(self._slot)
        return self._timings

    @property
    def work(self) -> dict[str, int]:
        """Counters of the frame; waits for the frame if the GPU counts some of them."""
        if not self._told:
            self._told = True
            self._work |= self._renderer.read_told(self._slot)
        return self._work

    @work.setter
    def work(self, work: dict[str, int]) -> None:
        self._work = work

    def let_go(self, why: str) -> None:
        """Read timings and counters, which stay, and give up the images; the GPU has finished the frame."""
        if not self._gone:
            _ = self.timings, self.work
            self._gone = why


def reset_by(view: View, time: float, previous: tuple[View, float] | None) -> str:
    """Return why a frame starts without history, or ""; `previous` is the (view, time) of the frame before."""
    if view.cut:
        return "camera cut"
    return "time ran backwards" if previous is not None and time < previous[1] else ""


def check_outputs(outputs: Any, known: tuple[str, ...], name: str) -> None:
    """Raise StaleFrameError unless `name` is in `outputs`; `known` are all outputs that a renderer can have."""
    if name not in outputs:
        new_outputs = ", ".join(repr(output) for output in (*outputs, name))
        hint = (
            f"open it with outputs={{{new_outputs}}}." if name in known else f"there are {', '.join(known)}."
        )
        raise StaleFrameError(f"'{name}' is not among this renderer's outputs: {hint}")


def output_of(name: str, pixels: np.ndarray, exposed: float) -> np.ndarray:
    """Return a target's pixels as output `name`: colours without alpha, and light divided by the exposure."""
    if name == "motion":
        return pixels.astype(np.float32)
    if name == "color_linear":
        return pixels[..., :3].astype(np.float32) / np.float32(exposed)
    return pixels[..., :3] if name == "color" else pixels
