"""Pure GLSL functions over arrays on the backend of whichever device is given: one text, one truth, two APIs."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl.context import Context
from backends.vulkan.device import Device
from tests.support import gl_functions, gpu_functions


def evaluate(device: Device | Context, *what: Any, **more: Any) -> dict[str, np.ndarray]:
    """Return the arrays that a body of GLSL wrote; everything is as in `tests.support.gpu_functions.evaluate`."""
    functions = gl_functions if isinstance(device, Context) else gpu_functions
    written: dict[str, np.ndarray] = functions.evaluate(device, *what, **more)
    return written
