"""The traced picture of scenes that change, of surfaces that let rays through, and of scenes at any scale and place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Deformation, Image, Material, Scene
from common.scene.merge import merge_scenes
from common.scene.sheets import cloth, cloth_scene_of
from common.view.camera import Perspective, View
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated
from tests.support.shadows import bending, placed, point, yard
from tests.support.traced_pictures import few_ways, light, off_edges, opened, picture, ways_of

pytestmark = pytest.mark.variants("vulkan", "gl")

VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
LAMP = point((-1.2, 3.0, 0.8))
MATTE = Material(roughness=1.0, metallic=0.0, double_sided=True)
UNLIT = Material(base_color=(0.8, 0.6, 0.4, 1.0), unlit=True, double_sided=True)
BLACK = Material(base_color=(0.0, 0.0, 0.0, 1.0), unlit=True, double_sided=True)


# --- what is edited ---


GLASS = replace(MATTE, base_color=(0.9, 0.5, 0.2, 0.5), alpha_mode="blend")
BLUE = replace(MATTE, base_color=(0.2, 0.5, 0.9, 1.0))
EDITS = {
    "moved": lambda edit: edit.set_transform(
        1, matrix=translated(0.7, 0.3, 0.2) @ edit.scene.nodes.matrix[1]
    ),
    "mirrored": lambda edit: edit.set_transform(
        2, matrix=edit.scene.nodes.matrix[2] @ np.diag((-1.0, 1.3, 1.0, 1.0))
    ),
    "lamp": lambda edit: edit.set_light(0, replace(edit.scene.lights[0], intensity=30.0)),
    "lamp moved": lambda edit: edit.set_transform(7, translation=(1.0, 2.5, 1.5)),
    "hidden": lambda edit: edit.set_visible(3, False),
    "shown": lambda edit: edit.set_visible(3, True),
    "material": lambda edit: edit.set_material(0, BLUE),
    "glass": lambda edit: edit.set_material(0, GLASS),
    "solid": lambda edit: edit.set_material(0, BLUE),
}
BACK = {"shown": "lamp moved", "solid": "material"}
"""Edits after which the scene is again what it was after another one."""

OF_STRUCTURES = ("mirrored", "hidden", "glass", "solid")
"""Edits that a second kind of structure is held to: what lamps and colours are, all kinds read in one place."""


def test_edits_are_followed(chapter):
    """After each edit the picture is that of a renderer opened anew, by either kind of structure."""
    for number, way in enumerate(few_ways(chapter)):
        scene = yard(LAMP, material=MATTE if number == 0 else BLUE)
        with opened(chapter, scene, ray_way=way) as renderer:
            pictures = {"": light(renderer, VIEW)}
            for name in EDITS if number == 0 else OF_STRUCTURES:
                before = list(pictures.values())[-1]
                with scene.edit() as edit:
                    EDITS[name](edit)
                seen = [light(renderer, VIEW) for _ in range(3)]
                wanted = pictures.get(BACK.get(name, name))
                if wanted is None:
                    wanted = picture(chapter, scene, VIEW, ray_way=way)
                for one in seen:
                    assert np.abs(one - wanted).max() <= 1e-5 * wanted.max(), (way, name)
                assert np.abs(wanted - before).max() > 0.01 * wanted.max(), (way, name)
                pictures[name] = wanted


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_an_instance_whose_place_is_not_finite_spoils_no_other(chapter):
    """A record without a finite box can hide what stands beside it in the upper level."""
    for way in few_ways(chapter):
        pictures = []
        for edit_scene in (
            lambda edit: edit.set_transform(3, matrix=np.full((4, 4), np.nan)),
            lambda edit: edit.set_visible(3, False),
        ):
            scene = yard(LAMP, material=MATTE)
            with opened(chapter, scene, ray_way=way) as renderer:
                whole = light(renderer, VIEW)
                with scene.edit() as edit:
                    edit_scene(edit)
                pictures.append(light(renderer, VIEW))
        lost, hidden = pictures
        assert np.array_equal(lost, hidden), way
        assert not np.array_equal(lost, whole), way


def morphing():
    """Return a square whose right edge is pulled along x by one target and towards the eye by another."""
    scene = quad_scene(UNLIT)
    right = (scene.positions[:, :1] > 0).astype(np.float32)
    targets = np.stack([right * np.float32((0.5, 0, 0)), right * np.float32((0, 0.25, 0.5))])
    nodes = nodes_at(np.eye(4))
    nodes.has_matrix[:] = False
    nodes.weights[0] = np.zeros(2)
    keys = np.array([(0, 0), (1, 0.5)], np.float64)
    pull = Animation("pull", (AnimationChannel(0, "weights", np.array((0.0, 1.0)), keys, "linear"),), 1.0)
    targets = [Deformation(mesh=0, node=0, morph_positions=targets)]
    return replace(scene, nodes=nodes, deformations=targets, animations=[pull])


FRONT = View(pose_looking_at((0.4, 0.3, 4.0), (0.2, 0.0, 0.0)), Perspective(0.7, 0.05))


@pytest.mark.feature("acceleration/refit")
@pytest.mark.parametrize(
    "scene", [pytest.param(bending, marks=pytest.mark.long), morphing], ids=["skin", "morph"]
)
def test_meshes_that_deform_are_followed(chapter, scene):
    """At each time the picture is that of a renderer opened anew, in either slot of frames, and forwards and back."""
    for way in few_ways(chapter):
        with opened(chapter, scene(), ray_way=way) as renderer:
            seen = [light(renderer, FRONT, time) for time in (0.0, 0.3, 0.6, 0.9, 0.9, 0.1)]
        anew = {time: picture(chapter, scene(), FRONT, time=time, ray_way=way) for time in (0.3, 0.9)}
        for number, time in ((1, 0.3), (3, 0.9), (4, 0.9)):
            assert np.abs(seen[number] - anew[time]).max() <= 1e-5 * anew[time].max(), (way, time)
        assert (np.abs(seen[0] - seen[3]).max(axis=-1) > 0.01).mean() > 0.05


CLOTH_VIEW = View(pose_looking_at((0.5, 0.4, 4.0), (0.5, -0.2, 0.0)), Perspective(0.9, 0.05))


def test_cloth_is_followed(chapter):
    """Both pictures show the cloth of the same frame, the rasterised one by other vertices' way to the screen."""
    for way in few_ways(chapter):
        scene = cloth_scene_of(cloth(pins=(0,)), light=False, material=UNLIT)
        shown = []
        for part in ("off", "whole"):
            with opened(chapter, scene, rays=part, ray_way=way, cloth=True) as renderer:
                shown.append([light(renderer, CLOTH_VIEW, k / 20) for k in range(8)])
        for drawn, traced in zip(*shown, strict=True):
            inner = off_edges(drawn)
            assert np.abs(traced - drawn)[inner].max() <= 1e-5
        moved_by = (np.abs(shown[1][0] - shown[1][-1]).max(axis=-1) > 0.1).mean()
        assert moved_by > 0.02, way


def before_wall(scene: Scene) -> Scene:
    """Return a scene of cloth with a square of 12 m behind it, seen from its light."""
    wall = quad_scene(MATTE, matrices=(placed((0, 0, -3.0), (12, 12), (0, 0, 1)),))
    return merge_scenes([scene, wall])[0]


def test_cloth_that_is_out_of_view_casts_its_shadow(chapter):
    """The shadow is that of the cloth as it hangs now, whether it is in view or not."""
    narrow = View(pose_looking_at((0.5, 0.0, -1.5), (0.5, 0.0, -3.0)), Perspective(1.4, 0.05))
    for way in ways_of(chapter)[:1]:
        shown = []
        for wide in (CLOTH_VIEW, narrow):
            scene = before_wall(cloth_scene_of(cloth(pins=(0,)), material=MATTE))
            with opened(chapter, scene, ray_way=way, cloth=True) as renderer:
                for k in range(12):
                    light(renderer, wide, k / 20)
                shown.append(light(renderer, narrow, 11 / 20))
        assert np.abs(shown[0] - shown[1]).max() <= 1e-5
        assert 0.05 < (shown[0].sum(axis=-1) == 0).mean() < 0.95


# --- surfaces that let rays through ---


def layers(front: Material, colors: np.ndarray | None = None, images: tuple = ()) -> Scene:
    """Return a square that fills `facing()`, and a larger one of UNLIT behind it."""
    behind = translated(z=-0.5) @ np.diag((2.0, 2.0, 1.0, 1.0))
    return quad_scene(
        materials=(front, UNLIT),
        matrices=(np.eye(4), behind),
        instance_materials=(0, 1),
        colors=colors,
        images=images,
    )


WHITE = Material(base_color=(1.0, 1.0, 1.0, 1.0), unlit=True)


@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
def test_a_masked_surface_ends_where_its_alpha_falls_below_the_cutoff(chapter):
    """Alpha rises from 0 on the left to 1 on the right, so the cutoff is a column."""
    colors = np.ones((4, 4), np.float32)
    colors[[0, 3], 3] = 0.0
    front = replace(WHITE, alpha_mode="mask", alpha_cutoff=0.3)
    for way in few_ways(chapter):
        seen = picture(chapter, layers(front, colors), facing(), (40, 40), ray_way=way)
        there = (seen == 1.0).all(axis=-1)
        assert np.array_equal(there, np.tile(np.arange(40) >= 12, (40, 1))), way
        assert np.abs(seen[~there] - (0.8, 0.6, 0.4)).max() < 1e-6, way


@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
def test_a_blended_surface_stops_the_share_alpha_of_rays(chapter):
    """Two surfaces of alpha 0.3 and 0.5: white, then 0.7 * 0.5 grey, and the rest goes on. Lots of pixels are the same
    by every way and for any number of tiles. The bound is four standard deviations of a binomial distribution.

    Pixels whose rays aim at the diagonal, an edge of both triangles, are left out: a way may name either one there,
    and the hash takes its number. Other rays are 1/64 of a side away, where roundings change no triangle: there the
    bits are equal, as the colours of unlit surfaces come from no arithmetic with the place of a hit.
    """
    first = replace(WHITE, base_color=(1.0, 1.0, 1.0, 0.3), alpha_mode="blend")
    second = replace(WHITE, base_color=(0.5, 0.5, 0.5, 0.5), alpha_mode="blend")
    scene = quad_scene(
        materials=(first, second), matrices=(translated(z=0.2), np.eye(4)), instance_materials=(0, 1)
    )
    seen = {way: picture(chapter, scene, facing(), (64, 64), ray_way=way) for way in ways_of(chapter)}
    with opened(chapter, scene, (64, 64), ray_way=ways_of(chapter)[0]) as renderer:
        renderer.techniques["rays"]._tiles.count = 16
        seen["tiles"] = light(renderer, facing())
        assert renderer.render(facing()).work["ray_tiles"] == 16
    rows, columns = np.mgrid[:64, :64]
    inside = rows + columns != 63  # the diagonal leads from the lower left corner to the upper right one
    for one in seen.values():
        assert np.array_equal(one[inside], seen["tiles"][inside])
        assert np.isin(one[..., 0], (1.0, 0.5, 0.0)).all()
    for value, share in ((1.0, 0.3), (0.5, 0.35), (0.0, 0.35)):
        found = (seen["tiles"][..., 0] == value).mean()
        assert abs(found - share) < 4 * np.sqrt(share * (1 - share)) / 64, value


@pytest.mark.variants("vulkan", "gl", long=("gl",))
def test_a_history_averages_the_dots_of_a_blended_surface(chapter):
    """The mean of 16 rays whose lots are independent varies a quarter as much as one ray does."""
    blended = replace(WHITE, base_color=(1.0, 1.0, 1.0, 0.5), alpha_mode="blend")
    with opened(
        chapter, quad_scene(blended), (32, 32), ray_way=ways_of(chapter)[0], taa="full", jitter_period=16
    ) as renderer:
        frames = [light(renderer, facing())[4:-4, 4:-4, 0] for _ in range(32)]
    assert frames[0].std() > 0.45
    assert frames[-1].mean() == pytest.approx(0.5, abs=0.03) and frames[-1].std() < 0.15


@pytest.mark.variants("vulkan", "gl", long=("gl",))
@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
def test_an_alpha_map_removes_exactly_the_texels_below_the_cutoff(chapter):
    texels = np.full((8, 8, 4), 255, np.uint8)
    texels[..., 3] = np.random.default_rng(1).integers(0, 256, (8, 8))
    front = replace(WHITE, alpha_mode="mask", alpha_cutoff=0.5, base_color_texture=texture(0))
    there = np.repeat(np.repeat(texels[..., 3] >= 127.5, 5, axis=0), 5, axis=1)
    scene = layers(front, images=(Image("alpha", texels),))
    seen = picture(chapter, scene, facing(), (40, 40), ray_way=ways_of(chapter)[0])
    assert np.array_equal((seen == 1.0).all(axis=-1), there)
    assert np.abs(seen[~there] - (0.8, 0.6, 0.4)).max() < 1e-6
