"""Pure GLSL functions over arrays on the backend of whichever device is given: one text, one truth, two APIs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from backends.gl.context import Context
from backends.vulkan.device import Device
from tests.support import gl_functions, gpu_functions


def evaluate(
    device: Device | Context,
    includes: Sequence[str],
    body: str,
    inputs: Mapping[str, np.ndarray],
    outputs: Mapping[str, str],
    defines: Mapping[str, int | float | str] | None = None,
) -> dict[str, np.ndarray]:
    """Return the arrays that `body` wrote; everything is as in `tests.support.gpu_functions.evaluate`."""
    if isinstance(device, Context):
        return gl_functions.evaluate(device, includes, body, inputs, outputs, defines)
    return gpu_functions.evaluate(device, includes, body, inputs, outputs, defines)
