"""Instance list files: which mesh is drawn where, one record of 80 bytes after another and nothing else.

A record is what the shader of an indirect draw reads by the number of its draw.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from common.errors import SceneError
from common.mesh.file import MeshFile, read_bytes
from common.paths import write_whole
from common.scene import Scene
from common.scene.pose import evaluate_pose

INSTANCE_DTYPE = np.dtype(
    [
        ("transform", "<f4", (4, 4)),  # world_from_object, row by row, relative to the origin of the scene
        ("mesh", "<u4"),
        ("material", "<u4"),
        ("lod", "<u4"),  # level of detail
        ("index_offset", "<u4"),  # of the first index of that level, in the indices of the mesh file
    ]
)


def instance_list(scene: Scene, meshes: MeshFile, time: float = 0.0) -> np.ndarray:
    """Return the visible instances of a scene, (I,) INSTANCE_DTYPE, at level 0 of the scene's own mesh file.

    Transforms are relative to `scene.origin`, as everything is that becomes float32.
    """
    shown = np.flatnonzero(scene.instances.visible)
    world = evaluate_pose(scene, time).world_from_object[shown].copy()
    world[:, :3, 3] -= scene.origin
    records = np.zeros(len(shown), INSTANCE_DTYPE)
    records["transform"] = world
    records["mesh"] = scene.instances.mesh[shown]
    records["material"] = scene.meshes["material"][records["mesh"]]
    records["index_offset"] = meshes.records["lod_offset"][records["mesh"], 0] // 4
    return records


def write_instance_file(path: str | os.PathLike[str], instances: np.ndarray) -> None:
    """Write a list of instances (I,) INSTANCE_DTYPE, whole or not at all.

    Raises:
        SceneError: the file cannot be written.
    """
    try:
        write_whole(Path(path), instances.astype(INSTANCE_DTYPE).tobytes())
    except OSError as error:
        raise SceneError(f"{path} cannot be written: {error.strerror or error}") from None


def read_instance_file(path: str | os.PathLike[str], meshes: MeshFile | None = None) -> np.ndarray:
    """Return a list of instances (I,) INSTANCE_DTYPE; with `meshes`, each is checked against its mesh.

    Raises:
        SceneError: the file is missing or cut short, a transform is not finite, or an instance names a mesh, a level
            or an index that the mesh file does not have.
    """
    data = read_bytes(path)
    size = INSTANCE_DTYPE.itemsize
    if len(data) % size:
        raise SceneError(
            f"{path} has {len(data)} bytes, no multiple of {size}, and is no instance list: write it again"
        )
    instances = np.frombuffer(data, INSTANCE_DTYPE)
    wrong = ~np.isfinite(instances["transform"]).all(axis=(1, 2))
    fault = "has a transform that is not finite"
    if meshes is not None and not wrong.any():
        fault = "names a mesh, level or index that the mesh file does not have"
        mesh, level = instances["mesh"], instances["lod"]
        wrong = mesh >= len(meshes.records)
        if not wrong.any():
            wrong = level >= meshes.records["lod_count"][mesh]
        if not wrong.any():
            wrong = instances["index_offset"] != meshes.records["lod_offset"][mesh, level] // 4
    if wrong.any():
        raise SceneError(f"{path} is damaged: instance {int(np.argmax(wrong))} {fault}; write it again")
    return instances
