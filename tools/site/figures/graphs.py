"""Compiled frames for the figures, from a device of this machine: `strata graph` prints the same."""

from __future__ import annotations

from functools import cache
from typing import Any

from tools.frames.graph import compiled
from tools.run.run import Request

SIZE = (640, 360)


@cache
def lens_frame() -> Any:
    """Return chapter 4's frame of the atrium with a lens."""
    request = Request(4, scene="atrium", size=SIZE, headless=True, overrides=("aperture=2",))
    return compiled(4, request)[0]


@cache
def cloth_frame() -> Any:
    """Return chapter 5's frame of the scene with cloth."""
    return compiled(5, Request(5, scene="cloth", size=SIZE, headless=True))[0]
