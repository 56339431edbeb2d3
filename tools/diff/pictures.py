"""What changed passes write, drawn before and after for the page of `strata diff`: small pictures of the default scene.

A side that cannot be drawn, for want of a device or because a copy of a chapter is broken, costs its pictures and a
sentence, never the page.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Collection
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import chapters
from chapters import scenes
from chapters.folders import renderer_name
from common.errors import UserError
from common.images.frame_pictures import picture_of
from common.names import stable_hash
from tools.cli.console import Steps
from tools.diff.lesson import Comparison, pass_of
from tools.diff.sides import Side
from tools.run.views import stored_as

SIZE = (320, 180)


@dataclass(frozen=True)
class Pictures:
    """PNG files of passes by name, before and after, None on the side that has no such pass; and what went wrong."""

    passes: dict[str, tuple[bytes | None, bytes | None]] = field(default_factory=dict)
    problems: tuple[str, ...] = ()


def draw(made: Comparison, steps: Steps) -> Pictures:
    """Return pictures of the passes whose files differ; no device is opened if there is none."""
    wanted = {pass_of(file) for file in made.tree.changed} - {""}
    if not wanted:
        return Pictures()
    drawn: list[dict[str, bytes]] = []
    problems = []
    for side, part in ((made.a, 0.1), (made.b, 0.5)):
        steps(f"draw {side.name}", part)
        try:
            drawn.append(passes_of(side, wanted))
        except (Exception, SystemExit) as error:  # a copy that is being edited may fail in any way
            drawn.append({})
            lines = f"{type(error).__name__}: {error}" if not isinstance(error, UserError) else str(error)
            problems.append(f"No pictures of {side.name}: {lines.strip().splitlines()[0].rstrip('.')}.")
    before, after = drawn
    names = sorted(before.keys() | after.keys())
    found = {name: (before.get(name), after.get(name)) for name in names}
    return Pictures(found, tuple(problems))


def passes_of(side: Side, wanted: Collection[str]) -> dict[str, bytes]:
    """Return a PNG of the first image that each pass of `wanted` writes. Raises whatever opening and drawing raise."""
    scene = scenes.load(scenes.DEFAULT)
    backend = chapters.choose_backend(side.backend or "auto")
    if side.own and side.number is not None:
        module = chapters.renderer_module(side.number, backend)
    else:
        module = import_module(f"{package_of(side.folder)}.{renderer_name(side.folder, backend)}")
    found = {}
    with module.Renderer(scene, SIZE, inspect=True) as renderer:
        view = chapters.view_of(renderer)
        frame = renderer.render(view)
        stored = stored_as(renderer.settings)
        for made in renderer.passes:
            # Of buffers there is no picture.
            images = [
                one for one in made.writes if f"{made.name}/{one.resource}" in renderer.inspection.names
            ]
            if made.name in wanted and images:
                access = images[0]
                values = frame.image(f"{made.name}/{access.resource}")
                found[made.name] = _png(
                    picture_of(values, access.resource, access.format or "", view, stored)[0]
                )
    return found


def package_of(folder: Path) -> str:
    """Import the package in `folder`, wherever that is, and return the name under which its modules are found now."""
    name = f"strata_copy_{stable_hash(str(folder.resolve())):016x}"
    if name not in sys.modules:
        spec = spec_from_file_location(
            name, folder / "__init__.py", submodule_search_locations=[str(folder.resolve())]
        )
        if spec is None or spec.loader is None or not (folder / "__init__.py").is_file():
            raise UserError(f"{folder} is no package: there is no __init__.py in it.")
        module = module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return name


def _png(pixels: Any) -> bytes:
    held = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(held, "PNG", optimize=True)
    return held.getvalue()
