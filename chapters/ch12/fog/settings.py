"""The knobs of fog."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

OF_SCENE = -1.0
"""The value of knobs that leave a quantity of the medium to the scene."""


@dataclass
class FogSettings:
    """The medium, its grid of froxels, and the filters of what they hold."""

    fog: bool = knob(True, "whether light is scattered by the medium, if there is one")
    fog_density: float = knob(
        OF_SCENE, "extinction of the constant medium; -1: what the scene says", unit="1/m", maximum=1e6
    )
    fog_height: float = knob(
        OF_SCENE,
        "extinction of height fog at its base; -1: what the scene says",
        unit="1/m",
        maximum=1e6,
    )
    fog_falloff: float = knob(
        OF_SCENE,
        "how fast height fog thins out: it is e times thinner after 1 / falloff metres; -1: what the scene says",
        unit="1/m",
        maximum=1e6,
    )
    fog_albedo: float = knob(
        OF_SCENE,
        "share of the extinction that scatters light, alike in all channels; -1: what the scene says",
        maximum=1,
    )
    fog_anisotropy: float = knob(
        0.4, "mean cosine of the angle by which light is turned: above 0 it goes on forwards"
    )
    fog_noise: float = knob(
        0.0, "contrast of the noise in the medium: its density varies by this share", minimum=0, maximum=1
    )
    fog_noise_size: int = knob(
        64, "texels along an edge of the noise, which is made once", choices=(32, 64, 128)
    )
    fog_noise_period: float = knob(
        0.5, "length after which the noise repeats", unit="length scales", minimum=0.001, maximum=1000
    )
    fog_wind: float = knob(
        0.2, "speed of the wind along (1, 0.1, 2)", unit="m/s", minimum=-1000, maximum=1000
    )
    fog_near: float = knob(
        0.01,
        "depth from which on the ratio of slices counts: the end of slice s of N is near * (far / near)^((s + 1) / N)",
        unit="length scales",
        minimum=1e-6,
        maximum=1e6,
    )
    fog_far: float = knob(
        2.0, "depth at which the grid ends", unit="length scales", minimum=1e-6, maximum=1e6
    )
    fog_columns: int = knob(128, "froxels across", minimum=1, maximum=16384)
    fog_rows: int = knob(72, "froxels down", minimum=1, maximum=16384)
    fog_slices: int = knob(64, "froxels in depth", minimum=1, maximum=16384)
    fog_format: str = knob(
        "rgba16f", "format of the volumes, and precision of records", choices=("rgba16f", "rgba32f")
    )
    fog_spatial: bool = knob(True, "whether froxels are averaged with their neighbours in a slice")
    fog_temporal: bool = knob(
        True, "whether slices take samples at random depths, which are averaged over frames"
    )
    fog_share: float = knob(
        0.1, "weight of the current frame in a history, while something moves", minimum=0.001, maximum=1
    )
    fog_dither: bool = knob(
        True, "whether what is seen through fog has noise of a step of 8 bits, which hides bands"
    )
    fog_half: bool = knob(
        False, "whether fog is looked up at half the resolution where surfaces are lit from a G-buffer"
    )
    fog_half_tolerance: float = knob(
        0.01,
        "with fog_half: relative difference in depth from which on a pixel looks its fog up by itself",
        minimum=0,
        maximum=1,
    )
