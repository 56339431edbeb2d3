"""The knobs of ambient occlusion in screen space."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class SsaoSettings:
    """How the surroundings of a pixel dim the light that comes from everywhere."""

    mode: str = knob(
        "off",
        "ambient occlusion from the depth around a pixel, or along rays of the hemisphere around its normal; "
        "needs a graph with a G-buffer",
        choices=("off", "depth", "normals"),
        flat="ssao",
    )
    radius: float = knob(
        0.03,
        "how far away a surface still occludes, as a part of the scene's length scale, which is half its diagonal",
        unit="length scales",
        minimum=0,
        maximum=10,
        flat="ssao_radius",
    )
    steps: int = knob(
        4,
        "points that are tested along each of eight rays, with ssao=normals",
        minimum=1,
        maximum=16,
        flat="ssao_steps",
    )
    scale: float = knob(
        1.0, "how much of the occlusion counts; 0: none is computed", minimum=0, maximum=1, flat="ssao_scale"
    )
    bias: float = knob(
        0.2,
        "added to what ssao=depth finds visible, since every slope hides a part of itself there",
        minimum=0,
        maximum=1,
        flat="ssao_bias",
    )
    blur: bool = knob(
        True, "whether the pattern of 4x4 pixels is blurred, but not over edges", flat="ssao_blur"
    )
