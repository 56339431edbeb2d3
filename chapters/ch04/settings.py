"""The knobs of this chapter, each with its unit, range and default."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from common.environment import ENERGIES
from common.scene import Scene
from common.scene.crowds import crowd, kinds
from common.settings import AtMost, Scale, Side, Sweep, knob

from .graph.plan import POISONS
from .shading.views import CHOICES, PICTURE

SIDES = (
    Side(chapter=1, most=10_000, why="where every draw is recorded anew, a frame takes a second"),
    Side(without=("bindless",)),
    Side(without=("multi-draw",), most=10_000, why="a call for each draw takes a tenth of a second"),
    Side(),
)
"""What the chapter is measured beside: the one before it, and itself on devices that lack what is new."""


@dataclass
class Settings:
    """What can be turned without touching the code: `strata run N --set anisotropy=1`."""

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "low": {
            "anisotropy": 1.0,
            "color_format": "rgba16f",
            "environment_size": 128,
            "environment_detail": 0.5,
            "table_size": 32,
            "msaa": 1,
        },
        "medium": {"anisotropy": 4.0, "color_format": "rgba16f", "msaa": 1},
        "high": {
            "anisotropy": 16.0,
            "color_format": "rgba16f",
            "environment_detail": 0.25,
            "irradiance_source": 64,
            "msaa": AtMost(4),
        },
        "reference": {
            "anisotropy": 16.0,
            "color_format": "rgba32f",
            "environment_detail": 0.15,
            "irradiance_source": 128,
            "table_size": 128,
            "table_samples": 4096,
            "msaa": AtMost(8),
        },
    }
    SWEEP: ClassVar[dict[str, tuple[Any, ...]]] = {"msaa": (1, 4)}  # the numbers that every device has
    PREPARED: ClassVar[tuple[Sweep, ...]] = (
        Sweep(
            "environment",
            scene="spheres",
            environment="sky",
            knobs={
                "environment_size": (64, 128, 256, 512),
                "environment_detail": (1.0, 0.7, 0.5, 0.35, 0.25),
                "irradiance_source": (8, 16, 32, 64, 128),
                "table_size": (16, 32, 64, 128),
                "table_samples": (64, 256, 1024, 4096),
            },
            truth={
                "environment_size": 512,
                "environment_detail": 0.1,
                "irradiance_source": 256,
                "table_size": 256,
                "table_samples": 8192,
            },
        ),
    )

    SCALES: ClassVar[tuple[Scale, ...]] = (
        Scale(
            "draws",
            scene=partial(crowd, materials=64),
            counts=(1, 10, 100, 1000, 10_000, 100_000),
            quick=(10, 10_000, 100_000),
            sides=SIDES,
        ),
        Scale(
            "materials",
            scene=partial(crowd, 4096),
            counts=(1, 4, 16, 64, 256, 1024, 4096),
            quick=(1, 256),
            sides=SIDES,
            flat_from=1,
        ),
    )
    PIPELINES: ClassVar[Callable[[], Scene]] = kinds
    THREADS: ClassVar[tuple[int, ...]] = (0, 1, 2, 4)
    LOADS: ClassVar[tuple[str, ...]] = ("FlightHelmet", "ToyCar", "atrium:large", "generated")

    anisotropy: float = knob(
        4.0, "texels averaged along the longer axis of a pixel's footprint", minimum=1, maximum=16
    )
    color_format: str = knob("rgba16f", "format of the linear colour target", choices=("rgba16f", "rgba32f"))
    graph: str = knob("auto", "deferred, forward or a file of JSON; auto: deferred, but forward with msaa")
    alias: bool = knob(True, "whether targets that are never needed at the same time share memory")
    resubmit: bool = knob(True, "whether frames are recorded once and sent again until something changes")
    poison: str = knob("off", "what fills memory before its first use: NaN and this depth", choices=POISONS)
    depth_prepass: bool = knob(False, "whether depth is drawn first, and then only what is visible is shaded")
    gbuffer_format: str = knob("compact", "how surfaces are kept", choices=("compact", "half", "full"))
    aperture: float = knob(0.0, "f-number of the lens; 0: a pinhole, all is sharp", minimum=0, maximum=1000)
    focus_distance: float = knob(0.0, "of what is sharp; 0: the middle's", unit="m", minimum=0, maximum=1e9)
    bokeh_taps: int = knob(8, "samples along the radius of the largest blur", minimum=2, maximum=32)
    msaa: int = knob(
        1,
        "places in a pixel at which triangles cover it or not; not every device has each",
        choices=(1, 2, 4, 8),
    )
    resolve: str = knob(
        "tone-weighted",
        "how a pixel's samples become one colour: averaged as they will be shown, or as light",
        choices=("tone-weighted", "linear"),
    )
    mask_coverage: bool = knob(
        True, "whether alpha masks end within a pixel, in steps of its samples; only with several of them"
    )
    tone_curve: str = knob(
        "neutral", "how bright colours are rolled off to white", choices=("neutral", "none")
    )
    ambient: float = knob(
        -1.0,
        "light that arrives from every direction alike; -1: what the scene says, else a little where it has no lights",
        unit="nits",
        minimum=-1,
        maximum=1e9,
    )
    default_light: bool = knob(
        True, "whether a scene without lights gets one that shines from behind the camera"
    )
    light_cutoff: float = knob(
        0.0,
        "exposed illuminance below which a light without range ends; 0: it reaches everything",
        unit="lux x exposure",
        minimum=0,
        maximum=1,
    )
    background: float = knob(
        0.02, "linear grey where nothing was drawn, after exposure", minimum=0, maximum=1000
    )
    sky: bool = knob(True, "whether the environment is seen where nothing was drawn")
    energy: str = knob(
        "gltf",
        "how reflection shares the environment's light: as glTF prints it; with what bounces between facets; "
        "and with no more spread than mirroring leaves",
        choices=ENERGIES,
    )
    environment_intensity: float = knob(
        1.0, "factor on the environment's light; 0: there is none", minimum=0, maximum=1e9
    )
    environment_turn: float = knob(
        0.0, "turn of the environment about the vertical", unit="degrees", minimum=-360, maximum=360
    )
    environment_size: int = knob(
        256,
        "texels along an edge of the environment's cube, rounded down to a power of two",
        minimum=16,
        maximum=2048,
    )
    environment_detail: float = knob(
        0.35,
        "texels summed as a whole for blurred levels, as a part of the lobe's width; time grows with its inverse "
        "square: 0.05 takes minutes in software",
        minimum=0.05,
        maximum=2,
        reference=0.15,
    )
    irradiance_source: int = knob(
        32,
        "texels along an edge of the level that irradiance is summed over, rounded down to a power of two",
        minimum=4,
        maximum=256,
        reference=128,
    )
    table_size: int = knob(64, "cosines and roughnesses in the BRDF's table", minimum=8, maximum=512)
    table_samples: int = knob(
        1024, "samples of each number in the BRDF's table", minimum=16, maximum=65536, reference=4096
    )
    view: str = knob(
        PICTURE, "a quantity shown in place of the picture, with one sample a pixel", choices=CHOICES
    )
    recording_threads: int = knob(
        0, "threads beside the renderer's own that record draws; in Python no gain", minimum=0, maximum=32
    )
    draws_per_secondary: int = knob(
        256, "calls that a part of a pass has at least when threads record it", minimum=1, maximum=1_000_000
    )
    skip_unused: bool = knob(True, "whether what the scene does not need is left out of pipelines and sets")
    loading: str = knob(
        "auto",
        "whether frames wait for the textures, or are drawn at once and fill in; auto: fill in where there is a window",
        choices=("auto", "wait", "stream"),
    )
    decoding_threads: int = knob(
        0, "threads that decode images; 0: one less than there are cores, at most 8", minimum=0, maximum=64
    )
    upload_budget: float = knob(
        2.0, "texels copied to the GPU in a frame while loading", unit="MiB", minimum=0.015625, maximum=1024
    )
