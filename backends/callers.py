"""Which Python line made a call: the one that its author can change, not the wrapper that every call goes through."""

from __future__ import annotations

import re
from pathlib import Path
from types import FrameType

from common.paths import ROOT

_BACKENDS = str(Path(__file__).resolve().parent)
_RECORDERS = re.compile(r".*[/\\]frames[/\\](vulkan|gl)_commands\.py", re.DOTALL)
"""In these, of a chapter or a copy of one, each pass's draws are recorded: that one was wrong says the pass's line."""


def calling_line(frame: FrameType | None) -> str:
    """Return "file:line" of the nearest frame outside backends, moderngl and a chapter's wrapper of commands."""
    while frame is not None and _is_wrapper(frame):
        frame = frame.f_back
    if frame is None:
        return "an unknown line"
    path = Path(frame.f_code.co_filename)
    shown = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    return f"{shown}:{frame.f_lineno}"


def _is_wrapper(frame: FrameType) -> bool:
    name = frame.f_code.co_filename
    if name.startswith((_BACKENDS, "<")) or _RECORDERS.fullmatch(name):
        return True
    return frame.f_globals.get("__name__") == "moderngl"
