"""Which scenes there are, where their files lie, and how a missing one is made."""

from __future__ import annotations

import difflib
import hashlib
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from common.errors import UserError
from common.paths import ROOT, cache_dir, user_cache

if TYPE_CHECKING:
    from assets.gltf_writer import GltfBuilder

FOLDER = ROOT / "assets"
COMMITTED = FOLDER / "models"
"""Files that are part of the clone, one folder per scene."""


@dataclass(frozen=True)
class SceneInfo:
    """A scene that the project can make.

    `sizes` maps the name of each size to the triangles drawn at it; the first is the default and is committed if
    `in_clone`, as a single .glb file if `binary`. `generator` is the module whose `build(size)` (or `build()` where
    there is one size) returns the scene. `exercises` is one sentence. Where `counted` is given, any number of triangles
    in the scene's meshes from its first to its second is a size as well, such as "250K" or "2M". Where `lamps` is
    given, so is any number of lamps from its first to its second, such as "lights=400".
    """

    name: str
    generator: str
    sizes: Mapping[str, int]
    exercises: str
    binary: bool = False
    in_clone: bool = True
    counted: tuple[int, int] | None = None
    lamps: tuple[int, int] | None = None

    @property
    def default_size(self) -> str:
        return next(iter(self.sizes))

    @property
    def triangles(self) -> int:
        """Triangles drawn at the default size, each mesh counted once per instance."""
        return self.sizes[self.default_size]

    def committed(self) -> Path:
        """Return where the default size lies in the clone, if `in_clone`."""
        return COMMITTED / self.name / f"{self.name}.{'glb' if self.binary else 'gltf'}"


_ALL = (
    SceneInfo(
        "atrium",
        "assets.atrium",
        {"medium": 34032, "small": 12232, "large": 244700, "fog": 34032},
        "Everything a frame can hold: all texture maps, alpha mask and blend, instances, cloth, animation, lights.",
    ),
    SceneInfo(
        "city",
        "assets.city",
        {"100K": 231474, "10K": 12746, "1M": 5298646},
        "Streets of a city, most of it hidden: what culling is measured with. city:2M, city:250K ... have so many "
        "triangles in their meshes, and an instance for each hundred.",
        binary=True,
        in_clone=False,
        counted=(10_000, 4_000_000),
    ),
    SceneInfo(
        "cloth",
        "assets.cloth",
        {"medium": 5542, "small": 1782, "large": 68902},
        "Fabric that falls over a ball and a box, and that hangs: nodes say what is cloth and what is in its way.",
        binary=True,
    ),
    SceneInfo(
        "cornell",
        "assets.cornell",
        {"medium": 82},
        "Light that bounces between coloured walls, from one emissive square.",
    ),
    SceneInfo(
        "market",
        "assets.market",
        {"lights=2400": 336706, "lights=400": 263306, "fog": 263306},
        "A night market: awnings, glass, and 2,400 lamps that are lights, of which eight and more reach most of what "
        "is seen. market:lights=400, market:lights=0 ... have so many.",
        binary=True,
        in_clone=False,
        lamps=(0, 4096),
    ),
    SceneInfo(
        "spheres",
        "assets.spheres",
        {"medium": 42844},
        "The BRDF over roughness (to the right) and metalness (downwards) under three kinds of light.",
        binary=True,
    ),
)
SCENES: Mapping[str, SceneInfo] = MappingProxyType({info.name: info for info in _ALL})


def find(name: str) -> tuple[SceneInfo, str]:
    """Return the scene and size meant by "atrium", "atrium:large" or "city:250K"; raises UserError with the nearest."""
    scene, _, size = name.partition(":")
    if scene not in SCENES:
        near = difflib.get_close_matches(scene, SCENES, 1, 0.4)
        hint = f'did you mean "{near[0]}"?' if near else f"choose one of {', '.join(SCENES)}."
        raise UserError(f'There is no scene "{scene}"; {hint}')
    info = SCENES[scene]
    if ":" not in name or size in info.sizes:
        return info, size or info.default_size
    if info.counted is not None:
        return info, _counted_size(info, size)
    if info.lamps is not None:
        return info, _lamps_size(info, size)
    near = difflib.get_close_matches(size, info.sizes, 1, 0.4)
    hint = f'did you mean "{scene}:{near[0]}"?' if near else f"choose one of {', '.join(info.sizes)}."
    raise UserError(f'The scene "{scene}" has no size "{size}"; {hint}')


def _counted_size(info: SceneInfo, text: str) -> str:
    """Return a number of triangles such as "250k" or "1.5M" as whole millions or thousands: "250K", "1500K"."""
    assert info.counted is not None
    least, most = (_in_letters(count) for count in info.counted)
    match = re.fullmatch(r"([0-9]{1,9})(?:\.([0-9]{1,6}))?([kKmM])", text)
    advice = f"write a number of triangles from {least} to {most}, such as {', '.join(info.sizes)}."
    if match is None:
        raise UserError(f'The scene "{info.name}" has no size "{text}"; {advice}')
    unit = 1000 if match[3] in "kK" else 1_000_000
    fraction = match[2] or ""
    count, rest = divmod(int(match[1] + fraction) * unit, 10 ** len(fraction))
    if count < info.counted[0] or (count, rest) > (info.counted[1], 0):
        edge = "small" if count < info.counted[0] else "large"
        raise UserError(f'"{info.name}:{text}" is too {edge}; {advice}')
    if rest or count % 1000:
        raise UserError(f'"{info.name}:{text}" is no whole number of thousands; {advice}')
    return _in_letters(count)


def _lamps_size(info: SceneInfo, text: str) -> str:
    """Return a number of lamps such as "lights=400" without leading zeros: one name for each size."""
    assert info.lamps is not None
    least, most = info.lamps
    match = re.fullmatch(r"lights=([0-9]{1,9})", text)
    shown = ", ".join(size for size in info.sizes if size.startswith("lights="))
    advice = f"write lights= and a whole number from {least} to {most:,}, such as {shown}."
    if match is None:
        raise UserError(f'The scene "{info.name}" has no size "{text}"; {advice}')
    if not least <= int(match[1]) <= most:
        raise UserError(f'"{info.name}:{text}" has too many lamps; {advice}')
    return f"lights={int(match[1])}"


def _in_letters(count: int) -> str:
    """Return a number of whole thousands with its letter, the larger one where it fits: one name for each size."""
    return f"{count // 1_000_000}M" if count % 1_000_000 == 0 else f"{count // 1000}K"


def locate(name: str) -> Path:
    """Return the .gltf or .glb file of a scene such as "atrium" or "atrium:large".

    Most scenes lie in the clone at their default size. Others are made on first use (seconds) and kept in the user's
    cache under the version of their generator; without a writable cache they live until the process ends. Raises
    UserError for an unknown name.
    """
    info, size = find(name)
    if info.in_clone and size == info.default_size and info.committed().is_file():
        return info.committed()
    kept = f"{info.name}-{size}-{generator_version()}"
    path = user_cache() / "scenes" / kept / f"{info.name}.glb"
    if path.is_file():  # also where nothing can be written
        return path
    folder = cache_dir("scenes")
    if folder is not None:
        try:
            # One file, renamed into place: who starts at the same time sees all of it or nothing, and makes the same.
            return write(info.name, folder / kept, size, binary=True)
        except OSError:
            pass  # the disk is full: go on without a cache
    return _temporary(info.name, size)


def write(name: str, folder: Path, size: str | None = None, binary: bool = False) -> Path:
    """Make a scene and write it into `folder` as .glb or as .gltf with .bin and PNG files; return the main file."""
    info, chosen = find(f"{name}:{size}" if size else name)
    return make(info, chosen).save(Path(folder), binary)


def make(info: SceneInfo, size: str) -> GltfBuilder:
    """Run the generator of a scene."""
    build = import_module(info.generator).build
    return build(size) if len(info.sizes) > 1 else build()


@cache
def generator_version() -> str:
    """Return a short hash of the text of all generators: another text, another folder in the cache."""
    digest = hashlib.sha256()
    for source in sorted(FOLDER.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:12]


_kept: list[tempfile.TemporaryDirectory[str]] = []  # removed when the process ends


@cache
def _temporary(name: str, size: str) -> Path:
    _kept.append(tempfile.TemporaryDirectory(prefix="strata-"))
    return write(name, Path(_kept[-1].name), size, binary=True)
