"""The constants of one frame, which every shader reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from common import layouts
from common.scene import Scene
from common.view.camera import View


def frame_constants(
    scene: Scene,
    size: tuple[int, int],
    view: View,
    time: float,
    *,
    previous: tuple[View, float] | None,
    index: int,
    ambient: float,
    environment: tuple[float, float, float, float],
    more: Mapping[str, Any],
) -> np.ndarray:
    """Return the FrameConstants record; `previous` is the (view, time) that was rendered before, if any was.

    `more` are arguments of `fill_frame_constants` that techniques decide, such as the jitter.
    """
    before, then = previous or (view, time)
    constants = np.empty((), layouts.dtype("FrameConstants"))
    layouts.fill_frame_constants(
        constants,
        view,
        before,
        size,
        origin=scene.origin,
        length_scale=scene.length_scale,
        time=time,
        previous_time=then,
        frame_index=index,
        instance_count=len(scene.instances),
        light_count=len(scene.lights),
        exposure_now=1.0,  # shaders multiply light by the exposure of hdr/exposure.glsl
        ambient=ambient,
        environment=environment,
        **more,
    )
    return constants
