"""From a .gltf or .glb file to a `Scene`, in the order in which things depend on each other."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from common.environment.medium import medium_of
from common.errors import SceneError
from common.gltf.accessors import Accessors
from common.gltf.animation import read_animations
from common.gltf.container import Opened
from common.gltf.document import Document, read_document
from common.gltf.geometry.primitives import PrimitiveReader
from common.gltf.images import ImageDecoder
from common.gltf.instances import read_instances
from common.gltf.materials import MaterialKey, Materials
from common.gltf.nodes import Forest, read_cameras, read_forest, read_lights
from common.gltf.refusal import Refusal, refuse
from common.names import shortened, visible
from common.scene import NUMBER_LIMIT, Scene

FAR_FRACTION = 1e-3
"""Of a scene's size: a step between places that is larger is seen, as a pixel of a thousand is."""

LEAST_STEP = 1e-6
"""Metres between places that are no matter for a scene whose triangles have no size."""

Progress = Callable[[float, str], None]
"""Called with the part that is done, 0 to 1, and what is being done."""


def load_scene(
    path: str | os.PathLike[str],
    progress: Progress | None = None,
    use_library: bool = False,
    decode: bool = True,
    ahead: int = 0,
    opened: Opened | None = None,
) -> Scene:
    """Load the default scene of a glTF 2.0 file (.gltf with files or data URIs, or .glb).

    `use_library` says whether pygltflib decodes the document, as a second opinion. Without `decode` images are
    `EncodedImage`: only their headers are read, and a damaged one raises SceneError when its pixels are asked for.
    Threads then decode up to `ahead` bytes of them beside what else there is to read, for the first that are needed.
    `opened` is told the name of each other file before it is opened, relative to the scene's folder; both names, where
    a URI can be read as two.

    Raises:
        SceneError: the file cannot be used. The text is one sentence that names the file, the place in it,
            the fault and what to do; no other exception leaves this function, whatever the file holds.
    """
    path = Path(path)
    try:
        return _load(path, progress or (lambda _part, _what: None), use_library, decode, ahead, opened)
    except Refusal as refusal:
        raise _refused(path, refusal) from None
    except MemoryError:
        raise SceneError(f"{path}: the scene does not fit into memory; load a smaller one.") from None


def _refused(path: Path, refusal: Refusal) -> SceneError:
    return SceneError(shortened(visible(f"{path}: {refusal}")))


def _load(
    path: Path, progress: Progress, use_library: bool, decode: bool, ahead: int, opened: Opened | None
) -> Scene:
    progress(0.0, "reading")
    document = read_document(path, use_library, opened)
    forest = read_forest(document)
    materials = Materials(document)
    images = materials.images(_used_materials(document, forest))
    steps = _Steps(progress, len(images) + 1)
    later = None if decode else partial(_refused, path)
    decoder = ImageDecoder(document, images, lambda: steps.done("decoding images"), later, ahead)
    try:
        scene = _assemble(path, document, forest, materials, decoder, steps)
    finally:
        decoder.close()
    progress(1.0, "loaded")
    return scene


class _Steps:
    def __init__(self, progress: Progress, total: int) -> None:
        self._progress = progress
        self._total = total
        self._count = 0

    def done(self, what: str) -> None:
        self._count += 1
        self._progress(self._count / (self._total + 1), what)


def images_read(path: Path) -> tuple[int, int]:
    """Return how many images the file of a scene has, and how many of them what is drawn samples. Raises SceneError."""
    document = read_document(path)
    used = Materials(document).images(_used_materials(document, read_forest(document)))
    return len(document.items("images")), len(used)


def _used_materials(document: Document, forest: Forest) -> list[MaterialKey]:
    nodes = [document.items("nodes")[node] for node in forest.shown]
    meshes = {node["mesh"] for node in nodes if "mesh" in node}
    used = {
        primitive.get("material")
        for mesh in meshes
        for primitive in document.items("meshes")[mesh]["primitives"]
    }
    return [MaterialKey(index) for index in sorted(index for index in used if index is not None)]


def _assemble(
    path: Path, document: Document, forest: Forest, materials: Materials, decoder: ImageDecoder, steps: _Steps
) -> Scene:
    accessors = Accessors(document)
    animations = read_animations(document, accessors, forest)
    reader = PrimitiveReader(document, accessors, materials)
    drawing = read_instances(document, accessors, forest, reader, animations)
    pools, keys = drawing.pools, drawing.materials
    table = pools.meshes()
    ordered = sorted(keys, key=lambda key: (key.index is None, key.index or 0, key.unlit))
    rank = np.zeros(len(keys), np.uint32)
    rank[[keys[key] for key in ordered]] = np.arange(len(keys), dtype=np.uint32)
    if len(table):
        table["material"] = rank[table["material"]]
    vertices: dict[str, Any] = pools.vertices()
    steps.done("geometry")
    lights, cameras = read_lights(document, forest), read_cameras(document, forest)
    images = decoder.finish()
    with np.errstate(over="ignore", invalid="ignore"):  # checked below
        scene = Scene(
            name=visible(path.stem),
            path=path,
            **vertices,
            indices=pools.indices(),
            meshes=table,
            mesh_names=pools.names,
            materials=materials.build(ordered, decoder.places),
            images=images,
            nodes=forest.nodes,
            instances=drawing.instances(),
            lights=lights,
            cameras=cameras,
            animations=animations,
            deformations=drawing.deformations,
            ambient=_ambient(document),
            medium=medium_of(_extras(document)),
            warnings=document.warnings,
        )
    # NaN fails this comparison as well.
    if not (np.abs(scene.bounds) <= NUMBER_LIMIT).all():
        refuse("the scene", f"reaches further than {NUMBER_LIMIT:g} m from its origin", "scale it down")
    _tell_distance(scene)
    return scene


def _tell_distance(scene: Scene) -> None:
    """Note a scene that lies so far from its origin that places in it, as 64-bit floats, are seen to be rounded."""
    step = float(np.spacing(np.abs(scene.bounds).max()))
    size = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))
    if scene.triangle_count and step > max(FAR_FRACTION * size, LEAST_STEP):
        scene.warnings.append(
            f"It lies {np.abs(scene.bounds).max():.2g} m from its origin, where places are rounded to {step:.2g} m, "
            f"and is {size:.2g} m across: move it to the origin to see its shape."
        )


def _ambient(document: Document) -> float | None:
    """Return `extras.strata.ambient` of the default scene, nits."""
    value = _extras(document).get("ambient")
    return None if value is None else max(0.0, float(value))


def _extras(document: Document) -> dict[str, Any]:
    """Return `extras.strata` of the default scene."""
    scenes = document.items("scenes")
    extras = scenes[document.root.get("scene", 0)].get("extras") if scenes else None
    return (extras.get("strata") or {}) if isinstance(extras, dict) else {}
