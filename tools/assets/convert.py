"""`strata convert SCENE FOLDER`: a scene as files that a program of one's own reads without parsing.

    scene.meshes       indices, vertices and levels of detail        common/mesh/file.py
    scene.instances    which mesh is drawn where                     common/mesh/instances.py
    scene.graph        the nodes, with names, meshes and materials   common/scene_graph/file.py
    scene.boxes        float32 (meshes, 2, 3): the corners of the box round each mesh, in its own space
    scene.json         names, materials and their textures, where zero is, what was left out
    textures/          the pictures, each once

A vertex has 12 bytes: its position; 20 with uv, 24 with a normal, 32 with both. Two runs write the same bytes.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from chapters import scenes
from common.errors import UserError
from common.images import write_image
from common.mesh import file as mesh_file
from common.mesh import instances
from common.mesh.lods import lod_chain
from common.mesh.merge import merged_by_material
from common.mesh.pools import mesh_bounds
from common.paths import write_whole
from common.reports.tables import table
from common.scene import Scene, UInt32
from common.scene_graph import file as scene_graph_file
from common.scene_graph.exchange import graph_of
from tools.cli.console import Steps, out, shown

VERSION = 1
TEXTURES = "textures"
FILES = tuple(f"scene.{kind}" for kind in ("meshes", "instances", "graph", "boxes", "json"))


def run(name: str, folder: Path, *, uv: bool, normals: bool, merge: bool, lods: bool) -> int:
    """Convert the scene meant by `name`, print what was written, and return the exit code. Raises UserError."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{shown(str(folder))} is a file: name a folder for what the scene becomes.")
    with Steps() as steps:
        progress: Any = steps.of("loading", 0.0, 0.5)
        scene = scenes.load(name, progress)
        steps("converting", 0.5)
        if merge:
            scene = merged_by_material(scene).scene
        levels = {}
        if lods:
            for mesh in range(len(scene.meshes)):
                steps("making levels of detail", 0.5 + 0.4 * mesh / len(scene.meshes))
                levels[mesh] = [level.indices for level in lod_chain(scene, mesh)]
        steps("writing", 0.9)
        about = write(scene, folder, uv, normals, levels)
    _show(scene, folder, about)
    return 0


def write(
    scene: Scene,
    folder: Path,
    uv: bool = True,
    normals: bool = True,
    levels: Mapping[int, Sequence[UInt32]] | None = None,
) -> dict[str, Any]:
    """Write a scene's files into `folder`, which is made where it is missing; return what scene.json holds.

    `levels` has the levels of detail by mesh. Each file is written whole or not at all, scene.json last: who finds
    it finds the others. Raises UserError where the folder cannot be written; then folders that were made are gone.
    """
    missing = _missing(folder / TEXTURES if scene.images else folder)
    try:
        (folder / TEXTURES if scene.images else folder).mkdir(parents=True, exist_ok=True)
        (folder / "scene.json").unlink(missing_ok=True)
        return _write_all(scene, folder, uv, normals, levels)
    except BaseException as error:
        if missing is not None:  # what was there before stays, and nothing else
            shutil.rmtree(missing, ignore_errors=True)
        if isinstance(error, OSError):
            where = error.filename or folder
            raise UserError(f"{where} cannot be written: {error.strerror or error}.") from None
        raise


def _missing(folder: Path) -> Path | None:
    """Return the outermost folder that is made with `folder`, None where that is there."""
    made = None
    for place in (folder, *folder.parents):
        if place.exists():
            break
        made = place
    return made


def _write_all(
    scene: Scene, folder: Path, uv: bool, normals: bool, levels: Mapping[int, Sequence[UInt32]] | None
) -> dict[str, Any]:
    packed = mesh_file.from_scene(scene, levels, uv, normals)
    pictures = [_write_picture(scene, number, folder) for number in range(len(scene.images))]
    mesh_file.write_mesh_file(folder / "scene.meshes", packed)
    instances.write_instance_file(folder / "scene.instances", instances.instance_list(scene, packed))
    scene_graph_file.save_graph(graph_of(scene)[0], folder / "scene.graph")
    about = _about(scene, pictures, uv, normals)
    write_whole(folder / "scene.boxes", mesh_bounds(scene).astype("<f4").tobytes())
    write_whole(folder / "scene.json", (json.dumps(about, indent=1, allow_nan=False) + "\n").encode())
    return about


def _write_picture(scene: Scene, number: int, folder: Path) -> str:
    """Write a picture, and return its name as scene.json has it."""
    image = scene.images[number]
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in Path(image.name).stem)
    file = f"{TEXTURES}/{number:03d}-{name[:64]}.{'exr' if image.dtype.kind == 'f' else 'png'}"
    write_image(folder / file, image.decode())
    return file


def _about(scene: Scene, pictures: list[str], uv: bool, normals: bool) -> dict[str, Any]:
    return {
        "version": VERSION,
        "name": scene.name,
        "vertex": ["position", *["uv"] * uv, *["normal"] * normals],
        "vertex_bytes": 12 + 8 * uv + 12 * normals,
        "origin": scene.origin.tolist(),
        "meshes": scene.mesh_names,
        "textures": pictures,
        "materials": [asdict(material) for material in scene.materials],
        "lights": [_finite(asdict(light)) for light in scene.lights],
        "cameras": [_finite(asdict(camera)) for camera in scene.cameras],
        "left_out": _left_out(scene, uv, normals),
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return values as JSON can say them: infinity is null."""
    return {name: None if value == math.inf else value for name, value in values.items()}


def _left_out(scene: Scene, uv: bool, normals: bool) -> list[str]:
    """Return in words what the scene has and the files have not."""
    found = {
        "uv coordinates": not uv,
        "normals": not normals,
        "a second set of uv coordinates": scene.uv1 is not None,
        "colours of vertices": scene.colors is not None,
        "animations": bool(scene.animations),
        "skins and morph targets": bool(scene.deformations),
        "instances that are not visible": not scene.instances.visible.all(),
    }
    return [what for what, is_so in found.items() if is_so]


def _show(scene: Scene, folder: Path, about: dict[str, Any]) -> None:
    found = table(f"{scene.name} in {shown(str(folder))}", "file", "holds", ">kB")
    drawn = int(scene.instances.visible.sum())
    said = (
        f"{len(scene.meshes)} meshes, vertices of {about['vertex_bytes']} bytes: {', '.join(about['vertex'])}",
        f"{drawn} instances, {scene.triangle_count:,} triangles",
        f"{len(scene.nodes)} nodes",
        f"{len(scene.meshes)} boxes",
        f"{len(scene.materials)} materials, {len(scene.lights)} lights, {len(scene.cameras)} cameras",
    )
    for name, holds in zip(FILES, said, strict=True):
        found.add_row(name, holds, f"{(folder / name).stat().st_size / 1e3:,.1f}")
    if about["textures"]:
        size = sum((folder / name).stat().st_size for name in about["textures"])
        found.add_row(f"{TEXTURES}/", f"{len(about['textures'])} pictures", f"{size / 1e3:,.1f}")
    out.print(found)
    if about["left_out"]:
        out.print(f"Left out: {', '.join(about['left_out'])}.", highlight=False)
