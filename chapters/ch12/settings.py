"""The settings of this chapter: the knobs of its subjects, its presets and its measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from common.scene import Scene
from common.scene.crowds import crowd, kinds
from common.settings import AtMost, Grouped, Scale, Side, Sweep, group

from .cloth.settings import ClothSettings
from .clusters.settings import ClusterSettings
from .culling.settings import CullingSettings
from .environment.settings import EnvironmentSettings
from .fog.settings import FogSettings
from .frames.queues.settings import QueueSettings
from .frames.settings import FrameSettings
from .graph.settings import GraphSettings
from .hdr.settings import HdrSettings
from .loading.settings import LoadingSettings
from .paths.settings import PathSettings
from .post.settings import PostSettings
from .rates.settings import RateSettings
from .rays.settings import RaySettings
from .scene.settings import SceneSettings
from .shading.settings import ShadingSettings
from .shadows.settings import ShadowSettings
from .ssao.settings import SsaoSettings
from .taa.settings import TaaSettings
from .transparency.settings import TransparencySettings
from .visibility.settings import VisibilitySettings

SIDES = (
    Side(chapter=5),
    Side(knobs=(("culling", "off"),)),
    Side(knobs=(("culling", "occlusion"),)),
)
"""The renderers to measure: the chapter before, and this chapter without and with culling."""


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
            "fog_columns": 64,
            "fog_rows": 36,
            "fog_slices": 32,
        },
        "medium": {"anisotropy": 4.0, "color_format": "rgba16f", "msaa": 1},
        "high": {
            "anisotropy": 16.0,
            "color_format": "rgba16f",
            "environment_detail": 0.25,
            "irradiance_source": 64,
            "msaa": AtMost(4),
            "fog_columns": 192,
            "fog_rows": 108,
            "fog_slices": 96,
        },
        "reference": {
            "anisotropy": 16.0,
            "color_format": "rgba32f",
            "environment_detail": 0.15,
            "irradiance_source": 128,
            "table_size": 128,
            "table_samples": 4096,
            "msaa": AtMost(8),
            "fog_columns": 192,
            "fog_rows": 108,
            "fog_slices": 96,
            "fog_format": "rgba32f",
        },
        # The limit of "Mastering Graphics Programming with Vulkan": light ids of 8 words a tile.
        "book": {"anisotropy": 4.0, "color_format": "rgba16f", "msaa": 1, "most_lights": 256},
    }
    SWEEP: ClassVar[dict[str, tuple[Any, ...]]] = {
        "msaa": (1, 4),  # the sample counts that every device has
        "culling": ("off",),
        "geometry": ("classic",),
    }
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
            counts=(10, 100, 1000, 10_000, 100_000, 1_000_000),
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

    ORDER: ClassVar[str] = (
        "culling geometry lod_pixels culling_frozen culling_overlay culling_level "
        "anisotropy color_format "
        "graph alias resubmit async_compute poison "
        "depth_prepass gbuffer_format aperture focus_distance bokeh_taps "
        "light_lists light_loop most_lights "
        "msaa resolve mask_coverage tone_curve tone_white "
        "motion_blur motion_blur_taps motion_blur_limit sharpen fxaa fxaa_contrast fxaa_detail fxaa_steps "
        "display_exposure display_gamma dither split split_at "
        "exposure exposure_key exposure_low exposure_high exposure_min_ev exposure_max_ev "
        "adapt_dark_s adapt_bright_s adapt_speed bloom bloom_threshold bloom_levels "
        "ambient default_light light_cutoff background sky "
        "energy environment_intensity environment_turn environment_size environment_detail "
        "irradiance_source table_size table_samples view view_white "
        "recording_threads draws_per_secondary "
        "ssao ssao_radius ssao_steps ssao_scale ssao_bias ssao_blur "
        "transparency transparency_nodes "
        "surfaces tangents "
        "shadows shadow_lights shadow_memory shadow_detail shadow_size shadow_sun_size shadow_cascades "
        "shadow_kernel shadow_loop shadow_filter shadow_lamp shadow_sun_angle shadow_bias shadow_constant shadow_slope "
        "page_budget shadow_near shadow_pool shadow_sides "
        "shadow_cull_instances shadow_cull_meshlets shadow_cull_cones shadow_cull_faces "
        "rate_policy rate_coarse rate_texel rate_threshold rate_surface rate_fragments rate_radius rate_tint "
        "fog fog_density fog_height fog_falloff fog_albedo fog_anisotropy "
        "fog_noise fog_noise_size fog_noise_period fog_wind "
        "fog_near fog_far fog_columns fog_rows fog_slices fog_format "
        "fog_spatial fog_temporal fog_share fog_dither fog_half fog_half_tolerance "
        "taa taa_share taa_average taa_velocity taa_history taa_filter taa_constraint taa_gamma taa_weight taa_ycocg "
        "taa_tolerance taa_reactive taa_format taa_scale jitter jitter_period mip_bias steady_uv "
        "rays ray_split ray_way ray_view ray_shadows ray_mirror ray_bounces "
        "path_tracer path_samples path_limit path_error path_average path_first path_seed path_bounces path_roulette "
        "path_strategy path_lights path_sequence path_filter "
        "skip_unused"
    )

    scene: SceneSettings = group(SceneSettings)
    graph: GraphSettings = group(GraphSettings)
    queues: QueueSettings = group(QueueSettings)
    shading: ShadingSettings = group(ShadingSettings)
    post: PostSettings = group(PostSettings)
    environment: EnvironmentSettings = group(EnvironmentSettings)
    frames: FrameSettings = group(FrameSettings)
    loading: LoadingSettings = group(LoadingSettings)
    cloth: ClothSettings = group(ClothSettings)
    culling: CullingSettings = group(CullingSettings)
    clusters: ClusterSettings = group(ClusterSettings)
    ssao: SsaoSettings = group(SsaoSettings)
    transparency: TransparencySettings = group(TransparencySettings)
    visibility: VisibilitySettings = group(VisibilitySettings)
    hdr: HdrSettings = group(HdrSettings)
    shadows: ShadowSettings = group(ShadowSettings)
    rates: RateSettings = group(RateSettings)
    fog: FogSettings = group(FogSettings)
    taa: TaaSettings = group(TaaSettings)
    rays: RaySettings = group(RaySettings)
    paths: PathSettings = group(PathSettings)
