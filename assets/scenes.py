"""Which scenes there are, where their files lie, and how a missing one is made."""

from __future__ import annotations

import difflib
import hashlib
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

    `sizes` maps the name of each size to the triangles drawn at it; the first is the default and is committed, as a
    single .glb file if `binary`. `generator` is the module whose `build(size)` (or `build()` where there is one size)
    returns the scene. `exercises` is one sentence.
    """

    name: str
    generator: str
    sizes: Mapping[str, int]
    exercises: str
    binary: bool = False

    @property
    def default_size(self) -> str:
        return next(iter(self.sizes))

    @property
    def triangles(self) -> int:
        """Triangles drawn at the default size, each mesh counted once per instance."""
        return self.sizes[self.default_size]

    def committed(self) -> Path:
        """Return where the default size lies in the clone."""
        return COMMITTED / self.name / f"{self.name}.{'glb' if self.binary else 'gltf'}"


_ALL = (
    SceneInfo(
        "atrium",
        "assets.atrium",
        {"medium": 34032, "small": 12232, "large": 244700},
        "Everything a frame can hold: all texture maps, alpha mask and blend, instances, cloth, animation, lights.",
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
        "spheres",
        "assets.spheres",
        {"medium": 42844},
        "The BRDF over roughness (to the right) and metalness (downwards) under three kinds of light.",
        binary=True,
    ),
)
SCENES: Mapping[str, SceneInfo] = MappingProxyType({info.name: info for info in _ALL})


def find(name: str) -> tuple[SceneInfo, str]:
    """Return the scene and size meant by "atrium" or "atrium:large"; raises UserError naming the nearest match."""
    scene, _, size = name.partition(":")
    if scene not in SCENES:
        near = difflib.get_close_matches(scene, SCENES, 1, 0.4)
        hint = f'did you mean "{near[0]}"?' if near else f"choose one of {', '.join(SCENES)}."
        raise UserError(f'There is no scene "{scene}"; {hint}')
    info = SCENES[scene]
    if ":" in name and size not in info.sizes:
        near = difflib.get_close_matches(size, info.sizes, 1, 0.4)
        hint = f'did you mean "{scene}:{near[0]}"?' if near else f"choose one of {', '.join(info.sizes)}."
        raise UserError(f'The scene "{scene}" has no size "{size}"; {hint}')
    return info, size or info.default_size


def locate(name: str) -> Path:
    """Return the .gltf or .glb file of a scene such as "atrium" or "atrium:large".

    The default size lies in the clone. Others are made on first use (seconds) and kept in the user's cache under the
    version of their generator; without a writable cache they live until the process ends. Raises UserError for an
    unknown name.
    """
    info, size = find(name)
    if size == info.default_size and info.committed().is_file():
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
