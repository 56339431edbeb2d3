"""Skins and morph targets of a glTF file: the attributes that move vertices, read and checked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.gltf.accessors import Accessors
from common.gltf.document import Document, Object
from common.gltf.geometry.completion import any_tangents, unit
from common.gltf.geometry.surface import MAX_VERTICES, Surface
from common.gltf.nodes import Forest
from common.gltf.refusal import refuse
from common.scene import Float32, Float64
from common.scene.deform import Vertices, flat, morph

MAX_SETS = 4
"""Sets of four joints that a vertex may have."""


@dataclass(frozen=True)
class Skin:
    """`joints` are nodes of the scene, (J,); `inverse_bind` (J, 4, 4)."""

    joints: NDArray[np.int32]
    inverse_bind: Float64


def read_skin(document: Document, accessors: Accessors, forest: Forest, number: int) -> Skin:
    """Read a skin; without inverse bind matrices they are the identity.

    Raises:
        Refusal: it has no joints, fewer matrices than joints, or a matrix that is not finite.
    """
    entry, place = document.items("skins")[number], f"skins[{number}]"
    joints = np.array([forest.place[node] for node in entry["joints"]], np.int32)
    if len(joints) == 0:
        refuse(f"{place}.joints", "is empty")
    if "inverseBindMatrices" not in entry:
        return Skin(joints, np.tile(np.eye(4), (len(joints), 1, 1)))
    matrices = accessors.matrices(entry["inverseBindMatrices"], f"{place}.inverseBindMatrices")
    if len(matrices) < len(joints):
        refuse(f"{place}.inverseBindMatrices", f"has {len(matrices)} matrices for {len(joints)} joints")
    return Skin(joints, matrices[: len(joints)])


def with_joints(
    document: Document, accessors: Accessors, surface: Surface, primitive: Object, place: str
) -> Surface:
    """Return a surface with its joints and weights (V, 4 * sets); weights of a vertex sum to 1.

    Raises:
        Refusal: sets of the wrong type or length, or weights that are negative or not finite.
    """
    attributes, count = primitive["attributes"], len(surface.positions)
    joints, weights = [], []
    for number in range(MAX_SETS):
        names = (f"JOINTS_{number}", f"WEIGHTS_{number}")
        if not all(name in attributes for name in names):
            break
        spots = [f"{place}.attributes.{name}" for name in names]
        joints.append(accessors.integers(attributes[names[0]], spots[0], ("VEC4",)))
        weights.append(accessors.floats(attributes[names[1]], spots[1], ("VEC4",)))
        for values, spot in zip((joints[-1], weights[-1]), spots, strict=True):
            if len(values) != count:
                refuse(spot, f"has {len(values)} elements, but POSITION has {count}")
        if weights[-1].min() < 0:
            refuse(spots[1], f"has a negative weight at vertex {int(weights[-1].min(axis=1).argmin())}")
    if f"JOINTS_{MAX_SETS}" in attributes:
        document.warn(f"{place} has more than {4 * MAX_SETS} joints to a vertex; the others were left out.")
    share = np.concatenate(weights, axis=1).astype(np.float64)
    total = share.sum(axis=1, keepdims=True)
    share = np.divide(share, total, out=np.zeros_like(share), where=total > 0)
    share[total[:, 0] == 0, 0] = 1.0  # nothing holds this vertex: it follows its first joint
    return replace(surface, joints=np.concatenate(joints, axis=1).astype(np.int32), weights=share)


def check_joints(surface: Surface, skin: Skin, place: str) -> Surface:
    """Return a surface whose joints are all in the skin; those of weight 0 may have been anything.

    Raises:
        Refusal: a vertex hangs on a joint that the skin does not have.
    """
    assert surface.joints is not None
    assert surface.weights is not None
    joints = np.where(surface.weights > 0, surface.joints, 0)
    if joints.max(initial=0) >= len(skin.joints):
        refuse(
            f"{place}.attributes.JOINTS_0", f"names joint {joints.max()}, but the skin has {len(skin.joints)}"
        )
    return replace(surface, joints=joints.astype(np.int32))


def with_targets(
    document: Document, accessors: Accessors, surface: Surface, primitive: Object, place: str
) -> Surface:
    """Return a surface with its morph targets, each (T, V, 3); offsets of other attributes are left out.

    Raises:
        Refusal: offsets of the wrong type or length, not finite, or too many of them.
    """
    targets, count = primitive["targets"], len(surface.positions)
    if len(targets) * count > MAX_VERTICES:
        refuse(f"{place}.targets", f"move more than {MAX_VERTICES} vertices together", "use fewer targets")

    def offsets(name: str) -> Float32 | None:
        if not any(name in target for target in targets):
            return None
        document.charge(len(targets) * count, f"{place}.targets")
        result = np.zeros((len(targets), count, 3), np.float32)
        for number, target in enumerate(targets):
            if name in target:
                spot = f"{place}.targets[{number}].{name}"
                values = accessors.floats(target[name], spot, ("VEC3",))
                if len(values) != count:
                    refuse(spot, f"has {len(values)} elements, but POSITION has {count}")
                result[number] = values
        return result

    others = {name for target in targets for name in target} - {"POSITION", "NORMAL", "TANGENT"}
    if others:
        document.warn(f"{place}.targets move {', '.join(sorted(others))[:60]} as well, which was left out.")
    return replace(
        surface,
        morph_positions=offsets("POSITION"),
        morph_normals=offsets("NORMAL"),
        morph_tangents=offsets("TANGENT"),
    )


def rest_weights(document: Document, node: int) -> Float64:
    """Return the morph weights of a node's mesh as the file has them at rest: the node's own or the mesh's.

    Raises:
        Refusal: primitives or weights disagree about the number of targets.
    """
    entry = document.items("nodes")[node]
    mesh = document.items("meshes")[entry["mesh"]]
    counts = {len(primitive.get("targets") or ()) for primitive in mesh["primitives"]} - {0}
    if len(counts) > 1:
        refuse(f"meshes[{entry['mesh']}].primitives", "have different numbers of morph targets")
    count = counts.pop() if counts else 0
    for owner, place in ((entry, f"nodes[{node}].weights"), (mesh, f"meshes[{entry['mesh']}].weights")):
        if owner.get("weights"):
            if len(owner["weights"]) != count:
                refuse(place, f"has {len(owner['weights'])} elements for {count} morph targets")
            return np.array(owner["weights"], np.float64)
    return np.zeros(count)


def bake_targets(surface: Surface, weights: Float64) -> Surface:
    """Return a surface with constant weights applied to it, so that nothing is left to do in a frame."""
    assert surface.normals is not None
    normals = unit(surface.normals)
    tangents = any_tangents(normals.astype(np.float32)) if surface.tangents is None else surface.tangents
    vertices: Vertices = surface.positions.astype(np.float64), normals, tangents.astype(np.float64)
    vertices = morph(
        vertices, weights, surface.morph_positions, surface.morph_normals, surface.morph_tangents
    )
    if surface.flat:
        vertices = flat(vertices)
    return replace(
        surface,
        positions=vertices[0].astype(np.float32),
        normals=vertices[1].astype(np.float32),
        tangents=None if surface.tangents is None else vertices[2].astype(np.float32),
        morph_positions=None,
        morph_normals=None,
        morph_tangents=None,
    )
