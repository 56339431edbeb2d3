"""The forest of nodes of a glTF file, with what hangs on it: cameras and lights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from common.gltf.document import Document, Object
from common.gltf.refusal import refuse
from common.scene import LEAST_EXTENT, LEAST_NEAR, LEAST_YFOV, Light, Nodes, SceneCamera


@dataclass(frozen=True)
class Forest:
    """`nodes` in the order of a scene, level by level; `place[i]` is where node i of the file went.

    `shown` are the numbers in the file of the nodes in the scene that is drawn, ascending. Nodes outside it
    are kept, for a joint may be one of them.
    """

    nodes: Nodes
    place: list[int]
    shown: list[int]


def read_forest(document: Document) -> Forest:
    """Read all nodes.

    Raises:
        Refusal: a node has two parents or is its own ancestor, a rotation is zero, or a matrix is not affine.
    """
    entries = document.items("nodes")
    parents = _parents(entries)
    depths = _depths(parents)
    order = np.argsort(np.array(depths, np.intp), kind="stable")
    place = np.empty(len(entries), np.int32)
    place[order] = np.arange(len(entries), dtype=np.int32)
    parent = np.array([parents[index] for index in order], np.int32).reshape(-1)
    known = parent >= 0
    parent[known] = place[parent[known]]

    count = len(entries)
    translation, scale = np.zeros((count, 3)), np.ones((count, 3))
    rotation = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    matrix, has_matrix = np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, bool)
    names, extras = [], {}
    for row, index in enumerate(order.tolist()):
        entry = entries[index]
        names.append(entry.get("name") or f"node {index}")
        if "matrix" in entry:
            matrix[row], has_matrix[row] = _affine(entry["matrix"], f"nodes[{index}].matrix"), True
        if "translation" in entry:
            translation[row] = entry["translation"]
        if "rotation" in entry:
            rotation[row] = _unit_quaternion(entry["rotation"], f"nodes[{index}].rotation")
        if "scale" in entry:
            scale[row] = entry["scale"]
        if isinstance(entry.get("extras"), dict):
            extras[row] = entry["extras"]
    nodes = Nodes(parent, translation, rotation, scale, matrix, has_matrix, names, extras=extras)
    return Forest(nodes, place.tolist(), _shown(document, parents))


def _parents(entries: list[Object]) -> list[int]:
    parents = [-1] * len(entries)
    for index, entry in enumerate(entries):
        for number, child in enumerate(entry.get("children") or ()):
            if parents[child] >= 0 or child == index:
                other = index if child == index else parents[child]
                fault = f"names node {child}, which is already a child of node {other}"
                refuse(
                    f"nodes[{index}].children[{number}]", "names the node itself" if child == index else fault
                )
            parents[child] = index
    return parents


def _depths(parents: list[int]) -> list[int]:
    """Return each node's distance from its root.

    Every node has one parent at most, so a walk upwards either ends or goes in a circle; it stops at nodes
    whose depth is known, which makes all walks together linear.
    """
    depths = [-1] * len(parents)
    for start in range(len(parents)):
        path = []
        node = start
        while node >= 0 and depths[node] == -1:
            depths[node] = -2  # on the path
            path.append(node)
            node = parents[node]
        if node >= 0 and depths[node] == -2:
            refuse(f"nodes[{node}].children", "lead back to the node itself")
        depth = -1 if node < 0 else depths[node]
        for node in reversed(path):
            depth += 1
            depths[node] = depth
    return depths


def _shown(document: Document, parents: list[int]) -> list[int]:
    """Return the nodes of the default scene, of the first if none is named, or all if there is no scene."""
    entries, scenes = document.items("nodes"), document.items("scenes")
    if scenes:
        stack = list(scenes[document.root.get("scene", 0)].get("nodes") or ())
    else:
        stack = [index for index, parent in enumerate(parents) if parent < 0]
    reached: set[int] = set()
    while stack:
        node = stack.pop()
        if node not in reached:
            reached.add(node)
            stack.extend(entries[node].get("children") or ())
    return sorted(reached)


def _affine(values: list[float], place: str) -> np.ndarray:
    matrix = np.array(values, np.float64).reshape(4, 4).T
    if np.abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-6:
        refuse(place, "has a last row other than 0 0 0 1")
    matrix[3] = (0, 0, 0, 1)
    return matrix


def _unit_quaternion(values: list[float], place: str) -> np.ndarray:
    quaternion = np.array(values, np.float64)
    length = np.linalg.norm(quaternion)
    if length < 1e-9:
        refuse(place, "is zero, which is no rotation")
    return quaternion / length


def read_cameras(document: Document, forest: Forest) -> list[SceneCamera]:
    """Read the cameras that nodes of the scene carry, in the order of the nodes.

    Raises:
        Refusal: a camera without its projection, or with one that no picture can have.
    """
    cameras = []
    for index in forest.shown:
        entry = document.items("nodes")[index]
        if "camera" in entry:
            camera = _camera(document, entry["camera"], forest.place[index], entry.get("name"))
            cameras.append(camera)
    return cameras


def _camera(document: Document, number: int, node: int, node_name: str | None) -> SceneCamera:
    entry = document.items("cameras")[number]
    kind, place = entry["type"], f"cameras[{number}]"
    lens = entry.get(kind)
    if lens is None:
        refuse(place, f"has no {kind}")
    place = f"{place}.{kind}"
    extras = entry.get("extras")
    ev100 = (extras.get("strata") or {}).get("ev100") if isinstance(extras, dict) else None
    name = node_name or entry.get("name") or f"camera {number}"
    near = float(lens["znear"])
    far = float(lens["zfar"]) if "zfar" in lens else math.inf
    if far <= near:
        refuse(f"{place}.zfar", f"is {far:g}, not beyond znear {near:g}")
    if kind == "perspective":
        yfov, aspect = float(lens["yfov"]), lens.get("aspectRatio")
        if not LEAST_YFOV <= yfov < math.pi:
            refuse(f"{place}.yfov", f"is {yfov:g}, not an angle between {LEAST_YFOV:g} and pi radians")
        if near < LEAST_NEAR:
            refuse(f"{place}.znear", f"is {near:g}, not {LEAST_NEAR:g} or more")
        if aspect is not None and aspect <= 0:
            refuse(f"{place}.aspectRatio", f"is {aspect:g}, not above 0")
        return SceneCamera(
            name, node, "perspective", yfov=yfov, near=near, far=far, aspect=aspect, ev100=ev100
        )
    width, height = abs(float(lens["xmag"])), abs(float(lens["ymag"]))
    for part, extent in (("xmag", width), ("ymag", height), ("zfar", far - near)):
        if extent < LEAST_EXTENT:
            fault = f"is {extent:g}" if part != "zfar" else f"is only {extent:g} m beyond znear"
            refuse(f"{place}.{part}", f"{fault}, so nothing can be seen")
    return SceneCamera(
        name, node, "orthographic", near=near, far=far, ymag=height, aspect=width / height, ev100=ev100
    )


def read_lights(document: Document, forest: Forest) -> list[Light]:
    """Read the lights of KHR_lights_punctual that nodes of the scene carry, in the order of the nodes.

    Raises:
        Refusal: a range or a cone that the extension does not allow.
    """
    lights = []
    extension = (document.root.get("extensions") or {}).get("KHR_lights_punctual") or {}
    for index in forest.shown:
        node = document.items("nodes")[index]
        use = (node.get("extensions") or {}).get("KHR_lights_punctual")
        if use:
            lights.append(
                _light(extension["lights"][use["light"]], use["light"], forest.place[index], node.get("name"))
            )
            if extension["lights"][use["light"]].get("intensity", 1.0) < 0.0:
                document.warn(f"The light '{lights[-1].name}' has a negative intensity and gives no light.")
    return lights


def _light(entry: Object, number: int, node: int, node_name: str | None) -> Light:
    place = f"extensions.KHR_lights_punctual.lights[{number}]"
    spot = entry.get("spot") or {}
    inner, outer = float(spot.get("innerConeAngle", 0.0)), float(spot.get("outerConeAngle", math.pi / 4))
    if entry["type"] == "spot" and not (0 <= inner < outer <= math.pi / 2 + 1e-6):
        refuse(
            f"{place}.spot",
            f"has cones of {inner:g} and {outer:g} radians; the inner must be the smaller, both in 0 to pi/2",
        )
    reach = float(entry.get("range", math.inf))
    if reach <= 0:
        refuse(f"{place}.range", f"is {reach:g}, not above 0")
    red, green, blue = (max(0.0, float(value)) for value in entry.get("color", (1.0, 1.0, 1.0)))
    return Light(
        kind=entry["type"],
        node=node,
        name=entry.get("name") or node_name or f"light {number}",
        color=(red, green, blue),
        intensity=max(0.0, float(entry.get("intensity", 1.0))),
        range=reach,
        inner_cone=inner,
        outer_cone=min(outer, math.pi / 2),
    )
