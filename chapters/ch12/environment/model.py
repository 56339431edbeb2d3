"""The preparation of an environment before the first frame, for both backends: sizes, sample counts, the cache on disk.

Compute shaders make three images: from the panorama a cube map whose levels are blurred for growing roughness
(`radiance`) and one of irradiance / pi (`irradiance`), and without it the table of the BRDF. The images depend only on
the panorama's pixels, a few numbers and the text of the kernels, so a hash of these is their name on disk.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.environment import Environment
from common.files.blobs import BlobError, read_blob, write_blob
from common.files.disk_cache import mark_read, prune
from common.files.shader_files import load
from common.paths import ROOT, cache_dir, write_whole
from common.scene import Sampler, Scene

from ..settings import Settings
from ..shading.views import is_lit
from .settings import EnvironmentSettings

SHADERS = Path(__file__).resolve().parent
KERNELS = ("cube", "mips", "irradiance", "prefilter")
TABLE_KERNEL = "table"
INCLUDES = ("environment", "finite", "sampling", "ggx_sampling", "brdf", "ibl", "half")
"""Files of the root `shaders/` that kernels include: a change of one makes everything anew."""

FORMAT = "rgba16f"
GROUP = 8
"""Texels along an edge of a work group."""

SMOOTH = Sampler("linear", "linear", "linear", "clamp", "clamp")
PANORAMA = Sampler("linear", "linear", None, "repeat", "clamp")
"""A panorama goes on at its sides, and ends at its poles."""

VERSION = 1
LARGEST = 60_000.0
"""The largest stored number, a little below the largest of half precision."""
MOST_BYTES = 512 << 20
"""What is kept on disk of environments: one with a cube of 256 texels along an edge takes 4 MiB."""
SMALLEST_FACE = 16
LAST_FACE = 8
"""Texels along an edge of the roughest level: a lobe a hemisphere wide needs no more; with less, seams would show."""


@dataclass(frozen=True)
class Sizes:
    """How large the results are and how often each texel is sampled. Edges of cubes are powers of two."""

    face: int = 256
    irradiance_face: int = 16
    irradiance_source: int = 32
    table: int = 64
    lobe_part: float = 0.35
    table_samples: int = 1024

    def __post_init__(self) -> None:
        for name in ("face", "irradiance_face", "irradiance_source"):
            if getattr(self, name) & (getattr(self, name) - 1):
                raise ValueError(f"{name} is a power of two, not {getattr(self, name)}")
        if self.face < SMALLEST_FACE:
            raise ValueError(f"a cube has at least {SMALLEST_FACE} texels along an edge, not {self.face}")
        if self.irradiance_source > self.face:
            raise ValueError(
                f"irradiance is summed over at most {self.face} texels along an edge, as the cube has"
            )

    @classmethod
    def of(cls, settings: EnvironmentSettings) -> Sizes:
        """Return the sizes that settings ask for, edges rounded down to powers of two."""
        face = 1 << (settings.size.bit_length() - 1)
        source = 1 << (settings.irradiance_source.bit_length() - 1)
        return cls(
            face=face,
            irradiance_source=min(source, face),
            table=settings.table_size,
            lobe_part=settings.detail,
            table_samples=settings.table_samples,
        )

    @property
    def levels(self) -> int:
        """Levels of the radiance cube, down to `LAST_FACE` texels along an edge; at least two."""
        return (self.face // LAST_FACE).bit_length()

    @property
    def irradiance_level(self) -> int:
        """The level of the unblurred cube whose texels irradiance is summed over: `irradiance_source` along an edge."""
        return (self.face // self.irradiance_source).bit_length() - 1

    @property
    def source_levels(self) -> int:
        """Levels of the unblurred cube that samples are read from: all, down to one texel."""
        return self.face.bit_length()


@dataclass(frozen=True, eq=False)
class Maps:
    """Stored texels: `radiance` has an array (6, n, n, 4) per level, `irradiance` is (6, n, n, 4); float16.

    `scale` is what a stored 1 stands for, in nits: a power of two.
    """

    radiance: list[np.ndarray]
    irradiance: np.ndarray
    scale: float


@dataclass(eq=False)
class MapsOnGpu:
    """The environment's maps on the GPU, as far as shaders are told of them; a backend's class has the images."""

    radiance: Any
    scale: float
    """The radiance of a stored 1, in nits."""
    made_ms: dict[str, float]
    """Milliseconds that the GPU took for what was made ("maps", "table"); what came from the disk is left out."""

    @property
    def last_level(self) -> int:
        """The level for roughness 1."""
        levels: int = self.radiance.levels
        return levels - 1


def needed(scene: Scene, settings: Settings) -> bool:
    """Whether the scene has an environment that sends out light, and light is computed."""
    return scene.environment is not None and settings.environment.intensity > 0 and is_lit(settings)


def frame_values(
    settings: EnvironmentSettings, scale: float, last_level: int
) -> tuple[float, float, float, float]:
    """Return what every frame's constants hold of an environment whose stored 1 stands for `scale` nits."""
    turn = math.radians(settings.turn)
    return scale * settings.intensity, math.cos(turn), math.sin(turn), float(last_level)


NO_ENVIRONMENT = (0.0, 1.0, 0.0, 0.0)
"""The values in a frame's constants without an environment."""


def level_roughness(level: int, levels: int) -> float:
    """Return the roughness for which a level is blurred; shaders read level roughness * (levels - 1)."""
    return level / (levels - 1)


def level_part(sizes: Sizes, level: int) -> float:
    """Return how large, beside the lobe, the texels are that a level's sum takes as a whole.

    A level has a quarter of the texels of the one before: its sums may be finer, and all together still cost less.
    """
    return sizes.lobe_part * 0.6 ** (level - 1)


def storage_scale(environment: Environment) -> float:
    """Return the power of two by which radiance is divided for storage.

    The mean is then about 1, in the middle of what half precision holds; or smaller, when the sun would else not fit.
    """
    mean, largest = float(environment.mean.max()), float(environment.radiance.max())
    wanted = max(mean, largest / LARGEST)
    return 2.0 ** math.ceil(math.log2(wanted)) if wanted > 0 else 1.0


def panorama_texels(environment: Environment, scale: float) -> np.ndarray:
    """Return the panorama as it is uploaded: (H, W, 4) float16."""
    height, width = environment.radiance.shape[:2]
    texels = np.ones((height, width, 4), np.float16)
    texels[..., :3] = environment.radiance / np.float32(scale)
    return texels


def points_per_edge(environment: Environment, sizes: Sizes) -> int:
    """Return how many points along an edge of a cube's texel are averaged: as many as there are pixels of the panorama.

    In the middle of a face a quarter of the panorama's width covers about 0.79 of the face's.
    """
    ratio = environment.radiance.shape[1] / (4 * sizes.face)
    return min(max(math.ceil(ratio * 4 / math.pi), 4), 32)


def groups(edge: int, layers: int = 6) -> tuple[int, int, int]:
    """Return the work groups of a dispatch over `edge` x `edge` texels in `layers` layers."""
    count = (edge + GROUP - 1) // GROUP
    return count, count, layers


def push(size: tuple[int, ...], *floats: float) -> np.ndarray:
    """Return push constants: one uvec4, and one vec4 when there are floats."""
    words = np.zeros(8 if floats else 4, np.uint32)
    words[: len(size)] = size
    if floats:
        words[4 : 4 + len(floats)] = np.array(floats, np.float32).view(np.uint32)
    return words


# --- kept on disk ---


def kernel_files() -> list[Path]:
    """Return the files of all kernels and of what they include."""
    return [
        *(SHADERS / f"{name}.comp" for name in (*KERNELS, TABLE_KERNEL)),
        *(ROOT / "shaders" / f"{name}.glsl" for name in INCLUDES),
    ]


def files_at_start(scene: Scene, settings: Settings) -> frozenset[Path]:
    """Return the shaders that run when a scene is opened, and never after."""
    return frozenset(kernel_files()) if needed(scene, settings) else frozenset()


def kernel_digest() -> str:
    """Return a hash of the text of all kernels and of what they include."""
    digest = hashlib.sha256()
    for path in kernel_files():
        digest.update("\n".join((*load(path).lines, "")).encode())
    return digest.hexdigest()


def maps_key(environment: Environment, sizes: Sizes) -> str:
    """Return the name under which the maps of an environment are kept; no table, no backend in it."""
    used = {name: value for name, value in asdict(sizes).items() if not name.startswith("table")}
    return _key({"environment": environment.content, **used})


def table_key(sizes: Sizes) -> str:
    """Return the name under which the table is kept: it is the same for every environment."""
    return _key({"table": sizes.table, "samples": sizes.table_samples})


def _key(parts: dict[str, Any]) -> str:
    text = json.dumps({**parts, "kernels": kernel_digest()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:40]


def read_maps(key: str, sizes: Sizes) -> Maps | None:
    """Return the maps kept under `key`, or None where there are none or they are damaged."""
    kept = _read(key)
    try:
        maps = Maps(kept["radiance"], kept["irradiance"], float(kept["scale"]))
        shapes = [level.shape for level in maps.radiance] + [maps.irradiance.shape]
        whole = all(level.dtype == np.float16 for level in (*maps.radiance, maps.irradiance))
    except (TypeError, KeyError, AttributeError):
        return None
    return maps if shapes == _shapes(sizes) and whole else None


def _shapes(sizes: Sizes) -> list[tuple[int, ...]]:
    edges = [sizes.face >> level for level in range(sizes.levels)] + [sizes.irradiance_face]
    return [(6, edge, edge, 4) for edge in edges]


def write_maps(key: str, maps: Maps) -> None:
    """Keep maps; a disk that takes nothing costs the next start its time, nothing else."""
    _write(key, {"radiance": maps.radiance, "irradiance": maps.irradiance, "scale": maps.scale})


def read_table(key: str, sizes: Sizes) -> np.ndarray | None:
    """Return the table (n, n, 4) float16 kept under `key`, or None."""
    kept = _read(key)
    table = kept.get("table") if isinstance(kept, dict) else None
    if not isinstance(table, np.ndarray) or table.shape != (sizes.table, sizes.table, 4):
        return None
    return table if table.dtype == np.float16 else None


def write_table(key: str, table: np.ndarray) -> None:
    """Keep a table."""
    _write(key, {"table": table})


def _read(key: str) -> Any:
    folder = cache_dir("environment")
    if folder is None:
        return None
    try:
        path = folder / f"{key}.blob"
        data = path.read_bytes()
        mark_read(path)
        checked, checksum = data[:-32], data[-32:]
        return read_blob(checked, VERSION) if hashlib.sha256(checked).digest() == checksum else None
    except (OSError, BlobError):
        return None


def _write(key: str, value: Any) -> None:
    folder = cache_dir("environment")
    if folder is None:
        return
    prune(folder, MOST_BYTES)
    data = write_blob(value, VERSION)
    with contextlib.suppress(OSError):
        write_whole(folder / f"{key}.blob", data + hashlib.sha256(data).digest())
