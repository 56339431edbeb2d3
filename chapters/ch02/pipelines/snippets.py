"""Includes whose text is made in Python, so that a record is laid out in one place only."""

from __future__ import annotations

from common import layouts

SNIPPETS = {
    "frame_constants.glsl": layouts.glsl("FrameConstants"),
    "instance.glsl": layouts.glsl("Instance"),
    "masks.glsl": layouts.glsl_constants(),
}

PUSH_SIZE = 16
"""Bytes of push constants: one uvec4, the number of the instance in x."""
