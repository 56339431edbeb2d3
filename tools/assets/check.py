"""Examines a reader's own model: what is in it, what of it is not drawn as its author meant, and what to mind."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from chapters import scenes
from common.errors import SceneError
from common.gltf.container import open_container
from common.gltf.document import parse
from common.gltf.extensions import ExtensionUse, extensions_of
from common.gltf.load import Progress, images_read
from common.gltf.refusal import Refusal
from common.models.store import in_bytes
from common.scene import Scene
from common.scene.animation import playing

EVERY_DEVICE = 4096
"""Pixels along a side of a texture that every Vulkan 1.3 device takes; most take 16384."""
NOTHING_DRAWN = "Nothing of it is drawn: it has no triangles."
METRES = (1e-3, 1e4)
"""Diagonals between which a model is probably in metres, as glTF wants it."""

SHOWN = 8
"""Names of a list that are shown."""

_READ = re.compile(r"POSITION|NORMAL|TANGENT|COLOR_0|(TEXCOORD|JOINTS|WEIGHTS)_\d+")
_TRIANGLES = range(4, 7)  # modes of primitives


@dataclass
class Examination:
    """What was found out about a file.

    `refusal` is the sentence that says why it cannot be drawn, "" where it can. `contents` are (what, how much);
    `losses` are sentences on what the loader leaves out or makes up; `hints` tell what else to know.
    """

    path: Path
    refusal: str = ""
    contents: list[tuple[str, str]] = field(default_factory=list)
    extensions: list[ExtensionUse] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)


def examine(path: Path, progress: Progress | None = None) -> Examination:
    """Load a file as a chapter would and say what is in it; what is wrong with it is told, not raised."""
    found = Examination(path)
    root = {} if path.suffix.lower() == ".obj" else document_of(path)
    found.extensions = extensions_of(root)
    try:
        scene = scenes.load(str(path), progress)
    except SceneError as error:
        found.refusal = str(error)
        return found
    found.contents = contents_of(scene)
    ignored = {f"The extension {use.name} is not supported and was ignored." for use in found.extensions}
    found.losses = [text for text in scene.warnings if text not in ignored] + list(
        losses_of(root, scene, _unread(path))
    )
    found.hints = list(hints_of(scene))
    return found


def document_of(path: Path) -> dict[str, Any]:
    """Return the JSON of a glTF file as far as it can be read, without asking whether it is right; else {}."""
    try:
        root = parse(open_container(path).text.tobytes().decode("utf-8-sig"))
    except (Refusal, ValueError):
        return {}
    return root if isinstance(root, dict) else {}


def contents_of(scene: Scene) -> list[tuple[str, str]]:
    """Return what a scene holds, as rows of a table."""
    low, high = scene.bounds
    size = " x ".join(f"{side:.3g}" for side in high - low)
    rows = [
        ("size", f"{size} m (x, y, z), around {_point((low + high) / 2, scene.length_scale)}"),
        ("drawn", f"{_count(len(scene.instances), 'object')}, {_count(scene.triangle_count, 'triangle')}"),
        (
            "geometry",
            f"{_count(len(scene.meshes), 'mesh', 'meshes')}, {_count(len(scene.positions), 'vertex', 'vertices')}",
        ),
        ("nodes", f"{len(scene.nodes):,}"),
        ("materials", _materials(scene)),
        ("textures", _textures(scene)),
        ("lights", _kinds(light.kind for light in scene.lights)),
        ("cameras", _some(camera.name for camera in scene.cameras)),
        ("animations", _some(f"{clip.name} ({clip.duration:.3g} s)" for clip in scene.animations)),
    ]
    if scene.deformations:
        skins = sum(deformation.joints is not None for deformation in scene.deformations)
        morphs = sum(deformation.morph_positions is not None for deformation in scene.deformations)
        parts = [_count(skins, "mesh", "meshes") + " with a skin"] if skins else []
        parts += [_count(morphs, "mesh", "meshes") + " with morph targets"] if morphs else []
        rows.append(("deforming", ", ".join(parts)))
    return rows


def losses_of(root: dict[str, Any], scene: Scene, unused: int) -> Iterator[str]:
    """Give sentences on what a glTF document has and the loader does not read, or lacks and the loader makes.

    `unused` images are sampled by nothing.
    """
    materials, primitives = _list(root, "materials"), list(_primitives(root))
    unread = sorted(
        {name for entry in primitives for name in entry["attributes"] if not _READ.fullmatch(name)}
    )
    if unread:
        yield f"Vertex attributes {', '.join(unread)} are not read."
    solid = [entry for entry in primitives if entry.get("mode", 4) in _TRIANGLES]
    bare = sum("NORMAL" not in entry["attributes"] for entry in solid)
    if bare:
        yield f"{_count(bare, 'primitive has', 'primitives have')} no normals: every triangle is shaded flat."
    mapped = [entry for entry in solid if _normal_mapped(entry, materials)]
    without_uv = sum(not any(name.startswith("TEXCOORD") for name in entry["attributes"]) for entry in mapped)
    if without_uv:
        yield f"{_count(without_uv, 'primitive has', 'primitives have')} a normal map without texture coordinates."
    untangled = sum("TANGENT" not in entry["attributes"] for entry in mapped) - without_uv
    if untangled > 0:
        yield (
            f"{_count(untangled, 'primitive has', 'primitives have')} a normal map and no tangents: they are made "
            "while loading, which takes time at every start."
        )
    if unused:
        yield f"{_count(unused, 'picture is', 'pictures are')} in the file that nothing of what is drawn reads."
    others = len(_list(root, "scenes")) - 1
    if others > 0:
        yield f"{_count(others, 'further scene', 'further scenes')} cannot be chosen: the default one is drawn."
    together = {id(clip) for clip in playing(scene.animations)}
    still = [clip.name for clip in scene.animations if id(clip) not in together]
    if still:
        yield f"{', '.join(still)} would move what an earlier animation moves, and is not played."


def _unread(path: Path) -> int:
    """Return how many images of a file, which was loaded before, nothing of what is drawn samples."""
    if path.suffix.lower() == ".obj":
        return 0
    there, used = images_read(path)
    return there - used


def hints_of(scene: Scene) -> Iterator[str]:
    """Give sentences on what may surprise: units, light, sizes that some devices do not take."""
    if not scene.triangle_count:
        yield NOTHING_DRAWN
        return
    diagonal = 2 * scene.length_scale
    if not METRES[0] <= diagonal <= METRES[1]:
        yield f"It is {diagonal:.3g} m across: glTF counts in metres, so the unit of the export may be another."
    if not scene.lights and scene.ambient is None:
        yield "It has no light: a chapter lights it by one of its own; --environment sky or FILE gives better light."
    if not scene.cameras:
        yield "It has no camera: all of it is shown; --camera EYE:TARGET looks from elsewhere."
    large = [image for image in scene.images if max(image.width, image.height) > EVERY_DEVICE]
    if large:
        yield (
            f"{_count(len(large), 'texture is', 'textures are')} larger than {EVERY_DEVICE} pixels, which some devices "
            "do not take."
        )


def _materials(scene: Scene) -> str:
    kinds = Counter(
        word
        for material in scene.materials
        for word, there in (
            ("alpha mask", material.alpha_mode == "mask"),
            ("alpha blend", material.alpha_mode == "blend"),
            ("two-sided", material.double_sided),
            ("unlit", material.unlit),
            ("emissive", any(material.emissive)),
        )
        if there
    )
    said = ", ".join(f"{count} {word}" for word, count in kinds.items())
    return f"{len(scene.materials)}{f' ({said})' if said else ''}"


def _textures(scene: Scene) -> str:
    if not scene.images:
        return "none"
    sizes = Counter(f"{image.width}x{image.height}" for image in scene.images)
    said = ", ".join(f"{count} of {size}" for size, count in sizes.most_common(4))
    more = ", ..." if len(sizes) > 4 else ""
    # A whole mip chain has 4/3 of the texels of its first level.
    texels = sum(image.width * image.height * 4 * image.dtype.itemsize for image in scene.images)
    return f"{said}{more}; {in_bytes(texels * 4 // 3)} on the device"


def _primitives(root: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Give all primitives of a document that was loaded, and so has the form of glTF."""
    for mesh in _list(root, "meshes"):
        yield from mesh["primitives"]


def _normal_mapped(primitive: dict[str, Any], materials: list[Any]) -> bool:
    material = primitive.get("material")
    return material is not None and "normalTexture" in materials[material]


def _list(root: dict[str, Any], name: str) -> list[Any]:
    return root.get(name) or []


def _kinds(kinds: Iterator[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items()) or "none"


def _count(count: int, one: str, many: str = "") -> str:
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def _some(names: Iterable[str]) -> str:
    listed = list(names)
    more = f", ... ({len(listed)} in all)" if len(listed) > SHOWN else ""
    return (", ".join(listed[:SHOWN]) or "none") + more


def _point(place: np.ndarray, scale: float) -> str:
    """Return a place in words; what is far below the size of the model is the rounding of its files."""
    return "(" + ", ".join(f"{value if abs(value) > 1e-4 * scale else 0:.3g}" for value in place) + ")"
