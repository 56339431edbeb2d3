"""The knobs of shading rates."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class RateSettings:
    """Where the light of one pixel stands for its neighbours."""

    rate_policy: str = knob(
        "none",
        "what chooses blocks of pixels that share their light: nothing, edges of the last picture, or the distance "
        "from the middle; graph=auto is then deferred on a device with shading rates, and compute elsewhere",
        choices=("none", "sobel", "radial"),
    )
    rate_coarse: str = knob(
        "2x2",
        "pixels of a block that shares its light, across and down",
        choices=("2x2", "4x4"),
    )
    rate_texel: int = knob(
        0,
        "pixels along a square of the mask, which has one rate, a block at least; 0 is what the device's own shading "
        "rates ask for, and one block elsewhere",
        choices=(0, 2, 4, 8, 16, 32),
    )
    rate_threshold: float = knob(
        0.1,
        "with rate_policy=sobel: squared gradient of the picture's luminance code from which on each pixel is lit",
        minimum=0,
        maximum=32,
    )
    rate_surface: float = knob(
        0.1,
        "with rate_policy=sobel: difference from the surface that is lit, at which each pixel is lit: of base colour "
        "and roughness; half of it for the cosine between normals, a fifth for depth",
        minimum=0,
        maximum=1,
    )
    rate_tint: bool = knob(
        False,
        "whether the picture is red where blocks of 2x2 share their light, and blue for 4x4",
    )
    rate_fragments: str = knob(
        "auto",
        "with graph=deferred: what lights blocks: the device's own shading rates, or two passes, one for blocks and "
        "one for pixels; auto is the device where it can",
        choices=("auto", "device", "passes"),
    )
    rate_radius: float = knob(
        0.6,
        "with rate_policy=radial: distance from the middle within which each pixel is lit, in heights of the picture",
        unit="heights",
        minimum=0,
        maximum=4,
    )
