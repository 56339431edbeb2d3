"""From what a user types after --scene to a scene: a name, or the path of a glTF or Wavefront file.

Names are those of our own scenes, and those that `strata assets` knows: of models fetched, and of the reader's own.
"""

from __future__ import annotations

import os
from pathlib import Path

import assets
from common.environment import Environment, read_environment
from common.environment.sky import sky
from common.errors import SceneError, UserError
from common.gltf import load_scene
from common.gltf.load import Progress
from common.mesh.obj import load_obj
from common.models import store
from common.names import suggest
from common.scene import Scene

DEFAULT = "atrium"
SUFFIXES = (".gltf", ".glb", ".obj")
ENVIRONMENTS = ("none", "sky")


def find(text: str) -> Path:
    """Return the file meant by `text`: a path if it looks like one, else a scene or a model by name.

    Raises UserError or SceneError: there is no such scene or file, it is a folder, or of another kind.
    """
    path = Path(text).expanduser()
    if not _is_path(text, path):
        return _by_name(text)
    if path.is_dir():
        inside = sorted(p.name for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
        hint = (
            f"name a file in it, such as {Path(text) / inside[0]}"
            if inside
            else "it holds no .gltf, .glb or .obj file"
        )
        raise SceneError(f"{text} is a folder: {hint}.")
    if not path.exists():
        near = sorted(p for p in _siblings(path) if p.suffix.lower() in SUFFIXES)
        hint = f"; {path.parent} has {', '.join(p.name for p in near[:5])}" if near else ""
        raise SceneError(f"There is no file {text}{hint}.")
    if path.suffix.lower() not in SUFFIXES:
        raise SceneError(f"{text} is no scene: its name must end in {', '.join(SUFFIXES)}.")
    return path


def _by_name(text: str) -> Path:
    """Return the file of a scene of our own, or of a model that `strata assets` knows."""
    if text.partition(":")[0] not in assets.SCENES:
        model = store.locate(text)
        if model is not None:
            return model
        near = suggest(text, store.names())
        if near.endswith("?"):
            raise SceneError(f"There is no scene or model {text!r}{near}")
    return assets.locate(text)


def _is_path(text: str, path: Path) -> bool:
    name = text.partition(":")[0]
    if name in assets.SCENES:
        return False
    separators = {os.sep, "/", os.altsep or "/"}
    return path.exists() or bool(path.suffix) or any(s in text for s in separators) or text.startswith("~")


def _siblings(path: Path) -> list[Path]:
    try:
        return list(path.parent.iterdir())
    except OSError:
        return []


def environment(text: str) -> Environment | None:
    """Return the environment meant by `text`: "none", "sky" or a file. Raises UserError."""
    if not text.strip():
        raise UserError("--environment needs a panorama's file, sky, or none.")
    if text == "none":
        return None
    if text == "sky":
        return sky()
    path = Path(text).expanduser()
    near = suggest(text, ENVIRONMENTS)
    if near.endswith("?") and not path.exists() and not _is_path(text, path):
        raise UserError(f"There is no environment {text!r}{near}")
    return read_environment(path)


def named(text: str, around: str = "none") -> tuple[Path, Environment | None]:
    """Return the file meant by `text` and the environment meant by `around`; raises UserError."""
    if not text.strip():
        raise UserError("--scene needs a name or a path: ./strata list --scenes shows the names.")
    return find(text), environment(around)


def surrounded(scene: Scene, far: Environment | None) -> Scene:
    """Return the scene after giving it an environment."""
    scene.environment = far
    if far is not None:
        scene.warnings.extend(far.warnings)
    return scene


def load(text: str, progress: Progress | None = None, around: str = "none") -> Scene:
    """Load the scene meant by `text` in the environment meant by `around`; raises UserError where that fails."""
    path, far = named(text, around)
    scene = load_obj(path) if path.suffix.lower() == ".obj" else load_scene(path, progress)
    return surrounded(scene, far)
