"""Culling changes no pixel of any scene, but where the two nearest surfaces are equally near.

Late units are drawn after early ones, so of two equal depths another one may win. A frame that is drawn in reverse
order finds those pixels: batches, draws and triangles the other way round.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from assets import locate
from chapters.ch06.meshlets.model import may_be_cut
from chapters.ch06.scene import scene_draws
from chapters.ch06.settings import Settings
from common.gltf import load_scene
from common.numerics.transforms import translation
from common.paths import asset_dir
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import replaced
from common.view.camera import view_of_scene
from tests.support.towns import cube, of_shapes

SIZE = (96, 54)
EXACT = Settings(color_format="rgba32f", gbuffer_format="full", anisotropy=1.0, ambient=0.3)
OUTPUTS = ("color_linear", "depth", "instance_id")

TIES = {"atrium": 0, "atrium:small": 0, "city:10K": 0, "cloth:small": 0, "cornell": 0, "spheres": 0}
"""The pixels of all views whose two nearest surfaces are equally near, by scene of the project."""

MODELS = sorted(path.name for path in (folder / "models").iterdir()) if (folder := asset_dir()) else []
QUICK = {"cornell", "TwoSidedPlane", "SimpleMeshes"}
EVERY = [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in (*TIES, *MODELS)]


@cache
def loaded(name: str) -> Scene:
    """Return a scene of the project, or a model made elsewhere."""
    if name in TIES:
        return load_scene(locate(name))
    folder = asset_dir()
    assert folder is not None, "it has the name"
    found = [
        path for path in sorted((folder / "models" / name).rglob("*")) if path.suffix in (".gltf", ".glb")
    ]
    return load_scene(found[0])


def views_of(scene):
    """Return a walk, a turn, a jump to another camera or to the other side, and the way back; each with its time."""
    pose = evaluate_pose(scene, 0.0)
    first = view_of_scene(scene, pose, None, SIZE[0] / SIZE[1])
    step = 0.03 * scene.length_scale
    turn = np.eye(4)
    turn[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    there = first.world_from_view
    poses = [
        there,
        there,
        there @ translation((step, 0, -step)),
        there @ translation((2 * step, 0, -2 * step)),
        there @ turn,
    ]
    views = [replace(first, world_from_view=pose) for pose in poses]
    names = [camera.name for camera in scene.cameras][1:3]
    views += [view_of_scene(scene, pose, name, SIZE[0] / SIZE[1]) for name in names]
    views += [replace(first, world_from_view=np.linalg.inv(turn) @ there), first]
    return [(view, 0.1 * number) for number, view in enumerate(views)]


def frames(chapter, scene, **turned):
    """Return the outputs of a frame for each view."""
    drawn = []
    with chapter.open(scene, SIZE, replaced(EXACT, **turned), outputs=OUTPUTS) as renderer:
        for view, time in views_of(scene):
            frame = renderer.render(view, time)
            drawn.append([frame.image(name).copy() for name in OUTPUTS])
    return drawn


def with_triangles_reversed(scene):
    """Return a view of a scene whose meshes have their solid triangles in reverse order."""
    indices = scene.indices.copy()
    solid = may_be_cut(scene)  # cloth would fall in another way
    for first, count in np.unique(scene.meshes[["first_index", "index_count"]][solid]).tolist():
        indices[first : first + count] = scene.indices[first : first + count].reshape(-1, 3)[::-1].reshape(-1)
    view = replace(scene, indices=indices)
    view.revision, view.bounds, view.origin = scene.revision, scene.bounds, scene.origin
    return view


def reversed_lists(*given, build=scene_draws.build_draw_lists):
    """Return draw lists with the solid batches, and the draws of each, in reverse order."""
    lists = build(*given)
    count = sum(batch.count for batch in lists.solid)
    batches = [replace(batch, first=count - batch.first - batch.count) for batch in reversed(lists.solid)]
    return replace(
        lists, commands=np.r_[lists.commands[:count][::-1], lists.commands[count:]], solid=tuple(batches)
    )


def differing(some, others):
    """Return the pixels (V, H, W) of each view of which any output differs."""
    return np.array(
        [
            np.any(
                [(a != b).reshape(*a.shape[:2], -1).any(axis=2) for a, b in zip(one, other, strict=True)],
                axis=0,
            )
            for one, other in zip(some, others, strict=True)
        ]
    )


def tied_pixels(chapter, monkeypatch, scene, uncut):
    """Return the pixels (V, H, W) of each view that differ if a scene is drawn in reverse order."""
    with monkeypatch.context() as patch:
        patch.setattr(scene_draws, "build_draw_lists", reversed_lists)
        turned = frames(chapter, with_triangles_reversed(scene), culling="off", geometry="classic")
    return differing(turned, uncut)


def test_a_frame_in_reverse_order_finds_what_is_equally_near(chapter, monkeypatch):
    """Two cubes in one place: all of their pixels, and no other one."""
    matrices = np.stack([np.eye(4)] * 3)
    matrices[2, 0, 3] = 3.0
    scene = of_shapes([cube(), cube()], [0, 1], np.array([0, 1, 0], np.int32), matrices)
    uncut = frames(chapter, scene, culling="off", geometry="classic")
    tied = tied_pixels(chapter, monkeypatch, scene, uncut)
    ids = np.array([view[2] for view in uncut])
    assert (tied == np.isin(ids, (1, 2))).all() and tied.any() and (ids == 3).any()


@pytest.mark.feature("culling/two-phase-occlusion")
@pytest.mark.parametrize("name", EVERY)
def test_only_pixels_with_two_nearest_surfaces_may_differ(chapter, monkeypatch, request, name):
    """The usual run draws one way, the long one all of them."""
    scene = loaded(name)
    uncut = frames(chapter, scene, culling="off", geometry="classic")
    tied = tied_pixels(chapter, monkeypatch, scene, uncut)
    assert tied.sum() == TIES.get(name, tied.sum()), "the list of ties"
    ways = ["compute"] if chapter.device.has("multi-draw") else ["classic"]
    if request.config.getoption("--long"):
        ways = ["classic", *ways, *(["mesh"] if chapter.device.has("mesh-shader") else [])]
    for geometry in ways:
        if geometry == "mesh":
            uncut = frames(chapter, scene, culling="off", geometry="mesh")
        drawn = frames(chapter, scene, culling="occlusion", geometry=geometry)
        assert not (differing(drawn, uncut) & ~tied).any(), geometry
