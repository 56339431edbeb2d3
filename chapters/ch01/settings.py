"""The settings of this chapter: the knobs of its subjects, its presets and its measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from common.settings import AtMost, Grouped, Sweep, group

from .environment.settings import EnvironmentSettings
from .post.settings import PostSettings
from .scene.settings import SceneSettings
from .shading.settings import ShadingSettings


@dataclass(init=False)
class Settings(Grouped):
    """The knobs that change without an edit of code: `strata run N --set anisotropy=1`."""

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
    SWEEP: ClassVar[dict[str, tuple[Any, ...]]] = {"msaa": (1, 4)}  # the sample counts that every device has
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

    ORDER: ClassVar[str] = (
        "anisotropy color_format "
        "msaa resolve mask_coverage tone_curve "
        "ambient default_light light_cutoff background sky "
        "energy environment_intensity environment_turn environment_size environment_detail "
        "irradiance_source table_size table_samples view "
        "skip_unused"
    )

    scene: SceneSettings = group(SceneSettings)
    shading: ShadingSettings = group(ShadingSettings)
    post: PostSettings = group(PostSettings)
    environment: EnvironmentSettings = group(EnvironmentSettings)
