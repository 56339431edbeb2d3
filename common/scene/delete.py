"""Nodes taken out of a scene with everything below them, and what is then used by nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.scene import Instances, Scene
from common.scene.parts import Place, attached, changed, kept_nodes, places_of, same_places, with_images


def delete_nodes(scene: Scene, nodes: ArrayLike) -> tuple[Scene, Place]:
    """Return the scene without `nodes` (K,) and their subtrees, and the `place` (N,) of its old nodes (-1: gone).

    Instances, lights, cameras and channels of animations go with their nodes. What is left keeps its order, and
    its world matrices to the bit. Geometry, materials and images stay, shared with the old scene: they cost no
    copy; `without_unused` drops what nothing draws any more.

    Raises:
        IndexError: there is no such node.
        UserError: a node is a joint of a mesh that stays.
    """
    kept = np.ones(len(scene.nodes), bool)
    kept[scene.nodes.ancestry.subtrees(nodes)] = False
    place = places_of(kept)
    parts = attached(scene, place, same_places(len(scene.meshes)))
    drawn = scene.instances
    stays = kept[drawn.node]
    instances = Instances(
        place[drawn.node[stays]],
        drawn.mesh[stays],
        None if drawn.local is None else drawn.local[stays],
        drawn.visible[stays],
    )
    return changed(scene, nodes=kept_nodes(scene.nodes, kept), instances=instances, **parts), place


def without_unused(scene: Scene) -> Scene:
    """Return the scene without meshes that no instance draws, and without materials, images and geometry of those.

    An instance that is hidden counts: it may be shown again.
    """
    used = np.zeros(len(scene.meshes), bool)
    used[scene.instances.mesh] = True
    mesh_place = places_of(used)
    meshes = scene.meshes[used]
    vertices = _covered(meshes["first_vertex"], meshes["vertex_count"], len(scene.positions))
    indices = _covered(meshes["first_index"], meshes["index_count"], len(scene.indices))
    materials = np.zeros(len(scene.materials), bool)
    materials[meshes["material"]] = True
    images = np.zeros(len(scene.images), bool)
    for number in np.flatnonzero(materials):
        images[[texture.image for texture in scene.materials[number].textures().values()]] = True
    image_place = places_of(images)
    # A block keeps its inside, so its first element is all that has to be looked up.
    meshes["first_vertex"] = _first(places_of(vertices), meshes["first_vertex"])
    meshes["first_index"] = _first(places_of(indices), meshes["first_index"])
    meshes["material"] = places_of(materials)[meshes["material"]]
    drawn = scene.instances
    parts = attached(scene, same_places(len(scene.nodes)), mesh_place)
    return changed(
        scene,
        positions=scene.positions[vertices],
        normals=scene.normals[vertices],
        tangents=scene.tangents[vertices],
        uv0=scene.uv0[vertices],
        uv1=None if scene.uv1 is None else scene.uv1[vertices],
        colors=None if scene.colors is None else scene.colors[vertices],
        indices=scene.indices[indices],
        meshes=meshes,
        mesh_names=[name for name, stays in zip(scene.mesh_names, used, strict=True) if stays],
        materials=[with_images(scene.materials[number], image_place) for number in np.flatnonzero(materials)],
        images=[scene.images[number] for number in np.flatnonzero(images)],
        nodes=kept_nodes(scene.nodes, np.ones(len(scene.nodes), bool)),
        instances=Instances(drawn.node, mesh_place[drawn.mesh], drawn.local, drawn.visible.copy()),
        **parts,
    )


def _covered(first: NDArray[np.uint32], count: NDArray[np.uint32], total: int) -> NDArray[np.bool_]:
    """Return (total,) whether an element is in one of the ranges, which may overlap."""
    steps = np.zeros(total + 1, np.int64)
    np.add.at(steps, first, 1)
    np.add.at(steps, first.astype(np.int64) + count, -1)
    return np.cumsum(steps[:-1]) > 0


def _first(place: Place, first: NDArray[np.uint32]) -> NDArray[np.uint32]:
    return np.append(place, 0)[first].astype(np.uint32)  # an empty mesh may begin at the end
