"""What has to hold of a scene before a graphics card may see it."""

from __future__ import annotations

import numpy as np

from common.scene import Scene
from common.scene.pose import evaluate_pose


def assert_drawable(scene: Scene) -> None:
    """Everything that reaches a graphics card is finite and in range."""
    for name in ("positions", "normals", "tangents", "uv0", "uv1", "colors"):
        values = getattr(scene, name)
        assert values is None or (len(values) == len(scene.positions) and np.isfinite(values).all()), name
    for row in scene.meshes:
        indices = scene.indices[row["first_index"] : row["first_index"] + row["index_count"]]
        assert len(indices) == row["index_count"] and indices.max(initial=0) < row["vertex_count"]
        assert row["first_vertex"] + row["vertex_count"] <= len(scene.positions)
        assert row["material"] < len(scene.materials)
    assert scene.instances.mesh.max(initial=-1) < len(scene.meshes)
    assert scene.instances.node.max(initial=-1) < len(scene.nodes)
    for material in scene.materials:
        for texture in material.textures().values():
            assert texture.image < len(scene.images)
    assert np.isfinite(scene.bounds).all()
    with np.errstate(all="ignore"):
        pose = evaluate_pose(scene, 0.37)
    assert np.isfinite(pose.world_from_object).all()
    for vertices in pose.vertices.values():
        assert all(np.isfinite(values).all() for values in vertices)
