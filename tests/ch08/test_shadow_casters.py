"""What casts shadows: meshes as they are posed in the frame, and no picture of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Deformation, Light, Material
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import nodes_at, quad_scene, translated
from tests.support.shadows import PLAIN, box, faces_of, lit_taps, placed, read_face
from tests.twins import shadows as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (32, 32)
BASE = Settings(
    **PLAIN,
    shadow_memory="full",
    shadow_size=128,
)
SOLID = Material(roughness=1.0, metallic=0.0, double_sided=True)
TOWARDS_Z = 5
"""The face of a cube that looks along -z."""


def morphing(skinned: bool):
    """Return a square whose right edge is pulled to the right, and then towards a lamp; a joint may lift all of it."""
    scene = quad_scene(SOLID)
    nodes = nodes_at(*(np.eye(4) for _ in range(3)))
    nodes.has_matrix[:] = False
    nodes.translation[2] = (0.3, 0.2, 2.5)
    right = (scene.positions[:, :1] > 0).astype(np.float32)
    deformation = Deformation(
        mesh=0,
        node=0,
        morph_positions=np.stack([right * np.float32((0.5, 0, 0)), right * np.float32((0, 0.25, 0.5))]),
    )
    if skinned:
        deformation = replace(
            deformation,
            joints=np.array([1], np.int32),
            inverse_bind=np.eye(4)[None],
            vertex_joints=np.zeros((4, 4), np.int32),
            vertex_weights=np.tile((1.0, 0.0, 0.0, 0.0), (4, 1)),
        )
    nodes.weights[0] = np.zeros(2)
    weights = np.array([(0.0, 0.0), (1.0, 0.5), (0.0, 1.0)])
    channels = [AnimationChannel(0, "weights", np.array((0.0, 0.5, 1.0)), weights, "linear")]
    if skinned:
        lifted = np.array([(0.0, 0.0, 0.0), (0.0, 0.4, 0.2)])
        channels.append(AnimationChannel(1, "translation", np.array((0.0, 1.0)), lifted, "linear"))
    return replace(
        scene,
        nodes=nodes,
        deformations=[deformation],
        animations=[Animation("pulled", tuple(channels), 1.0)],
        lights=[Light("point", 2, intensity=20.0)],
    )


def morphed(time: float, skinned: bool) -> np.ndarray:
    """Return the (2, 3, 3) triangles of that square at a time."""
    u = time % 1.0
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    corners[1:3] += np.interp(u, (0, 0.5, 1), (0, 1, 0)) * np.array((0.5, 0, 0)) + u * np.array(
        (0, 0.25, 0.5)
    )
    if skinned:
        corners += u * np.array((0.0, 0.4, 0.2))
    return corners[[0, 1, 2, 0, 2, 3]].reshape(2, 3, 3)


@pytest.mark.feature("shadows/depth-recording")
@pytest.mark.parametrize("skinned", [False, True])
def test_what_morphs_casts_the_shadow_of_its_pose(chapter, skinned):
    scene, looking = morphing(skinned), View(pose_looking_at((0, 1, 6), (0, 0, 0)), Perspective())
    maps = []
    with chapter.open(scene, SIZE, BASE) as renderer:
        for time in (0.0, 0.3, 0.8, 0.8):
            frame = renderer.render(looking, time)
            frame.image("color")
            found = read_face(renderer, TOWARDS_Z)
            wanted = twin.face_depths(faces_of(renderer)[TOWARDS_Z], morphed(time, skinned) - scene.origin)
            agree = ((found < 1e29) == (wanted < 1e29)) & ((np.abs(found - wanted) < 1e-4) | (wanted > 1e29))
            # Texels on the outline may be on either side of it: 4 edges of fewer than 128 texels.
            assert agree.mean() > 0.99 and (wanted < 1e29).mean() > 0.05, time
            maps.append(found)
        assert frame.work["shadow_faces_drawn"] == 0  # the second time nothing has moved
    assert not np.array_equal(maps[0], maps[1]) and not np.array_equal(maps[1], maps[2])
    assert np.array_equal(maps[2], maps[3])


@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_the_globe_of_a_lamp_does_not_darken_it(chapter, graph):
    """A closed box around a light: an unlit one is a picture of light, and a solid one lets nothing out."""
    globe = Material(unlit=True, base_color=(1.0, 0.9, 0.7, 1.0), double_sided=True)
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), *box((0.0, 1.5, 0.0), 0.4))
    below = View(pose_looking_at((0, 1.2, 0), (0, 0, 0), (0, 0, -1)), Orthographic(2.5, 0.1, 20.0))
    pictures = []
    for material in (globe, SOLID):
        scene = quad_scene(
            materials=(SOLID, material),
            matrices=(*squares, translated(0.0, 1.5, 0.0)),
            instance_materials=(0, *[1] * 6),
        )
        scene = replace(scene, lights=[Light("point", 7, intensity=60.0)])
        with chapter.open(scene, SIZE, replaced(BASE, graph=graph), outputs=("color_linear",)) as renderer:
            pictures.append(renderer.render(below).image("color_linear")[..., 0].astype(np.float64))
        if graph == "forward":
            settings = replaced(BASE, graph=graph, view="shadow-factor")
            with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
                shown = renderer.render(below).image("color_linear")[..., 0]
            wanted = 9 if material is globe else 0
            assert (lit_taps(shown, 3, chapter.device) == wanted).all()
    assert pictures[0].min() > 0.0 == pictures[1].max()
