"""The knobs of shading: targets, samples, the background and the views."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

from .views import CHOICES, PICTURE


@dataclass
class ShadingSettings:
    """The passes that draw, and their formats."""

    color_format: str = knob("rgba16f", "format of the linear colour target", choices=("rgba16f", "rgba32f"))
    depth_prepass: bool = knob(False, "whether depth is drawn first, and then only what is visible is shaded")
    gbuffer_format: str = knob(
        "octahedral", "how surfaces are kept", choices=("octahedral", "compact", "half", "full")
    )
    msaa: int = knob(
        1,
        "places in a pixel at which triangles cover it or not; not every device has each",
        choices=(1, 2, 4, 8),
    )
    mask_coverage: bool = knob(
        True, "whether alpha masks end within a pixel, in steps of its samples; only with several of them"
    )
    background: float = knob(
        0.02, "linear grey where nothing was drawn, after exposure", minimum=0, maximum=1000
    )
    sky: bool = knob(True, "whether the environment is seen where nothing was drawn")
    view: str = knob(
        PICTURE, "a quantity shown in place of the picture, with one sample a pixel", choices=CHOICES
    )
    view_white: int = knob(12, "the count that views of counts show as white", minimum=1, maximum=4096)
    skip_unused: bool = knob(True, "whether what the scene does not need is left out of pipelines and sets")
