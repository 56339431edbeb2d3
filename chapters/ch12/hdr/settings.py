"""The knobs of exposure and bloom."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

VIEW, HISTOGRAM, MIPS = "view", "histogram", "mips"


@dataclass
class HdrSettings:
    """How the exposure of a frame is found, and how far bright light spreads."""

    exposure: str = knob(
        VIEW,
        "the view's EV100; or found by the GPU: a log average between percentiles, or the mean of a mip chain",
        choices=(VIEW, HISTOGRAM, MIPS),
    )
    exposure_key: float = knob(0.18, "picture value of the average luminance", minimum=0.001, maximum=10)
    exposure_low: float = knob(
        50.0,
        "share of the darkest pixels that the histogram leaves out",
        unit="percent",
        minimum=0,
        maximum=100,
    )
    exposure_high: float = knob(
        95.0, "share of the pixels below the brightest left out", unit="percent", minimum=0, maximum=100
    )
    exposure_min_ev: float = knob(-8.0, "lowest EV100 of an automatic exposure", minimum=-20, maximum=30)
    exposure_max_ev: float = knob(24.0, "highest EV100 of an automatic exposure", minimum=-20, maximum=30)
    adapt_dark_s: float = knob(
        1.2, "time constant towards a darker scene (histogram)", unit="s", minimum=0, maximum=1000
    )
    adapt_bright_s: float = knob(
        0.3, "time constant towards a brighter scene (histogram)", unit="s", minimum=0, maximum=1000
    )
    adapt_speed: float = knob(
        0.1, "the cookbook's speed (mips): the error falls by 0.98^speed in 1 ms", minimum=0.001, maximum=10
    )
    bloom: float = knob(0.0, "part of bright light that spreads; 0: none", minimum=0, maximum=1)
    bloom_threshold: float = knob(1.0, "picture value above which light spreads", minimum=0, maximum=60000)
    bloom_levels: int = knob(5, "levels: each doubles the widest blur", minimum=1, maximum=6)
