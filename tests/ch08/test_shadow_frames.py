"""Shadows in frames, against rays in float64: depths of faces, edges, bias, filters, and what is not drawn again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch08.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.bounds import snapping
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.scenes import moved, quad_scene, scaled, texture
from tests.support.shadows import (
    PLAIN,
    all_faces,
    bending,
    bent,
    faces_of,
    lit_taps,
    placed,
    point,
    read_face,
    read_pages,
    spot,
    sun,
    yard,
)
from tests.twins import shadows as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (64, 64)
BASE = Settings(
    **PLAIN,
    shadow_memory="full",
    shadow_sun_size=256,
    shadow_size=256,
    shadow_cascades=1,
)
FACTOR = {"view": "shadow-factor", "graph": "forward"}
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))


def rendered(chapter, scene, looking=ABOVE, size=SIZE, name="color_linear", **turned):
    with chapter.open(scene, size, replaced(BASE, **turned), outputs=(name,)) as renderer:
        return renderer.render(looking).image(name).astype(np.float64)


def factors(chapter, scene, looking=ABOVE, size=SIZE, **turned):
    return rendered(chapter, scene, looking, size, **FACTOR, **turned)[..., 0]


def ground_below(size=SIZE, half=3.0) -> np.ndarray:
    """Return (H, W, 3) points of the ground at the middles of the pixels of ABOVE."""
    x = (np.arange(size[0]) + 0.5) / size[0] * 2 * half - half
    z = (np.arange(size[1]) + 0.5) / size[1] * 2 * half - half
    return np.stack(np.broadcast_arrays(x[None, :], 0.0, z[:, None]), -1)


def lit(points, scene, light_at=None, towards=None) -> np.ndarray:
    """Return whether points see a light at a place, or one that is far away."""
    shape, flat = points.shape[:-1], points.reshape(-1, 3)
    rays = np.broadcast_to(towards, flat.shape) if light_at is None else np.array(light_at) - flat
    nearest = twin.first_hit(flat, rays, twin.triangles_of(scene), 1e-6)
    return (nearest >= (np.inf if light_at is None else 1.0)).reshape(shape)


LIGHTS = {
    "sun": (sun((0.5, -1.0, 0.3)), None, (-0.5, 1.0, -0.3)),
    "spot": (spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0), outer=math.radians(55)), (1.5, 4.0, 1.0), None),
    "point": (point((-1.2, 3.0, 0.8)), (-1.2, 3.0, 0.8), None),
}


def depth_off(device, face, triangles, wanted) -> np.ndarray:
    """Return (size, size) metres by which stored depths may differ from `wanted`.

    Positions are single precision, relative to the scene's origin: 2e-6 was measured on the software drivers. Where a
    device moves vertices before it fills, a surface's depth moves with them, by its slope.
    """
    off: np.ndarray = 2e-6 * np.maximum(wanted, 1.0)
    if snapping(device):
        off += snapping(device) * twin.face_slopes(face, triangles, wanted)
    return off


@pytest.mark.feature(
    "shadows/depth-recording",
    "shadows/cube-sampling",
    "shadows/cube-faces",
    "shadows/bias-matrices",
    "shadows/directional-fit",
)
@pytest.mark.parametrize("kind", LIGHTS)
def test_each_texel_holds_the_depth_of_the_first_surface(chapter, kind):
    scene = yard(LIGHTS[kind][0], extra=(placed((2.0, 1.0, -2.0), (1.5, 1.0), (1.0, 0.4, 0.2)),))
    settings = replaced(BASE, shadow_size=128, shadow_sun_size=256)
    triangles = twin.triangles_of(scene) - scene.origin
    with chapter.open(scene, SIZE, settings) as renderer:
        renderer.render(ABOVE).image("color")
        pages, seen = read_pages(renderer), 0
        for number, face in enumerate(faces_of(renderer)):
            found, wanted = read_face(renderer, number, pages), twin.face_depths(face, triangles)
            agree = (found < 1e29) == (wanted < 1e29)
            close = np.abs(found - wanted) <= depth_off(chapter.device, face, triangles, wanted)
            close |= (found > 1e29) & (wanted > 1e29)
            # At edges a texel's middle may lie within float32 of either side.
            assert (agree & close).mean() > 0.995, (number, (agree & close).mean())
            inner = np.ones_like(close)
            for axis in (0, 1):
                for shift in (-1, 1):
                    near = np.roll(wanted, shift, axis)
                    inner &= np.abs(near - wanted) < 0.3
            assert (agree & close)[inner[:, :]].all(), number
            seen += int((wanted < 1e29).any())
        assert seen >= (4 if kind == "point" else 1)


@pytest.mark.feature("shadows/spot-map", "shadows/cube-sampling", "shadows/pcf", "shadows/reduced-resolution")
@pytest.mark.parametrize(
    ("kind", "texels"),
    [
        *(("sun", 256), ("spot", 256), ("point", 128)),
        *(pytest.param(*case, marks=pytest.mark.long) for case in (("spot", 128), ("point", 256))),
    ],
)
def test_edges_lie_within_a_texel_of_the_truth(chapter, kind, texels):
    light, at, towards = LIGHTS[kind]
    scene = yard(light)
    drawn = lit_taps(factors(chapter, scene, shadow_kernel=1, shadow_size=texels), 1, chapter.device)
    points = ground_below()
    on_ground = np.maximum(abs(points[..., 0]), abs(points[..., 2])) > 0.52  # the cube hides what is below
    wanted = lit(points + np.array((0, 1e-4, 0)), scene, at, towards)
    if kind == "spot":
        away = points - np.array(at)
        axis = np.array((0.0, 0.5, 0.0)) - np.array(at)
        cosine = (away @ axis) / np.linalg.norm(away, axis=-1) / np.linalg.norm(axis)
        on_ground &= cosine > np.cos(np.radians(54))
    assert set(np.unique(drawn[on_ground])) <= {0, 1}
    wrong = on_ground & ((drawn > 0.5) != wanted)
    assert (~wanted[on_ground]).sum() > 100 and wrong.sum() < 60 * 256 / texels
    away = np.full(points.shape[:-1], 1.0) if at is None else np.linalg.norm(points - np.array(at), axis=-1)
    ray = np.broadcast_to(towards, points.shape) if at is None else np.array(at) - points
    cosine = ray[..., 1] / np.linalg.norm(ray, axis=-1)
    # The footprint of a texel, sqrt 2 across its corners, laid onto the ground.
    texel = (
        8.5 / 250
        if at is None
        else 2 * np.tan(np.radians(55 if kind == "spot" else 45)) / (texels - 6) * away * 1.5
    )
    radius = (texel / cosine)[wrong]
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(around), np.zeros(16), np.sin(around)], -1)
    nearby = points[wrong][:, None] + radius[:, None, None] * ring + np.array((0, 1e-4, 0))
    other = lit(nearby, scene, at, towards) == (drawn > 0.5)[wrong][:, None]
    assert other.any(axis=1).all()


@pytest.mark.feature("shadows/pcf")
@pytest.mark.parametrize("kernel", [3, 13])
def test_factors_are_multiples_of_one_tap(chapter, kernel):
    drawn = factors(chapter, yard(LIGHTS["spot"][0]), shadow_kernel=kernel)
    assert len(np.unique(lit_taps(drawn, kernel, chapter.device))) > kernel


@pytest.mark.feature("shadows/depth-bias")
@pytest.mark.parametrize("bias", ["plane", "slope"])
@pytest.mark.parametrize("kernel", [pytest.param(1, marks=pytest.mark.long), 3])
@pytest.mark.parametrize("kind", ["sun", "spot", "point"])
def test_a_plane_never_shades_itself(chapter, kind, kernel, bias):
    for degrees, lighted in _aslant(chapter, kind, shadow_kernel=kernel, shadow_bias=bias):
        lighted = lighted[22:42, 22:42]
        assert (lighted == kernel**2).all(), (degrees, (lighted < kernel**2).sum())
    if bias == "plane" and kernel == 1:
        bare = _aslant(chapter, kind, shadow_kernel=1, shadow_bias="none")
        assert sum((lighted < 1).sum() for _, lighted in bare) > 500  # without bias there is acne


def _aslant(chapter, kind, **turned):
    """Yield for some angles of a light above a plane the taps that are lit. One renderer follows the light."""
    scene = yard(_tilted(kind, 0))
    scene.instances.visible[1:] = False
    settings = replaced(BASE, **FACTOR, **turned)
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        for degrees in (0, 20, 45, 60, 75, 85):
            with scene.edit() as edit:
                edit.set_transform(scene.lights[0].node, matrix=_tilted(kind, degrees)[1])
            drawn = renderer.render(ABOVE).image("color_linear")[..., 0].astype(np.float64)
            yield degrees, lit_taps(drawn, turned["shadow_kernel"], chapter.device)


def _tilted(kind, degrees):
    angle = math.radians(degrees)
    towards = np.array((math.sin(angle) * 0.8, math.cos(angle), math.sin(angle) * 0.6))
    return {
        "sun": lambda: sun(tuple(-towards)),
        "spot": lambda: spot(tuple(4 * towards), (0, 0, 0), outer=math.radians(30)),
        "point": lambda: point(tuple(4 * towards)),
    }[kind]()


@pytest.mark.feature("shadows/depth-bias")
@pytest.mark.parametrize(
    ("degrees", "kernel"),
    [
        *((0, 1), (75, 3)),
        *(pytest.param(*case, marks=pytest.mark.long) for case in ((0, 3), (45, 1), (45, 3), (75, 1))),
    ],
)
def test_what_hovers_two_texels_above_casts_a_shadow(chapter, degrees, kernel):
    angle = math.radians(degrees)
    height = (2 + kernel // 2) * 8.6 / 250  # texels of the whole ground and the guard
    scene = yard(
        sun((-math.sin(angle), -math.cos(angle), 0.0)), extra=(placed((0, height, 0), (4, 4), (0, 1, 0)),)
    )
    scene.instances.visible[1:7] = False
    below = View(pose_looking_at((0, height / 2, 0.3), (0, 0, 0)), Perspective(0.4, 1e-3))
    assert (factors(chapter, scene, below, shadow_kernel=kernel)[16:48, 16:48] == 0.0).all()


@pytest.mark.core
@pytest.mark.feature("shadows/disable-switch")
def test_off_makes_nothing_and_gives_the_picture_without_casters(chapter):
    scene = yard(*(light for light, *_ in LIGHTS.values()))
    scene.instances.visible[1:] = False
    plain = rendered(chapter, scene, shadows="off")
    assert np.array_equal(rendered(chapter, scene), plain) and plain.max() > 0
    with chapter.open(scene, SIZE, replaced(BASE, shadows="off")) as renderer:
        frame = renderer.render(ABOVE)
        assert not any(name.startswith("shadow") for name in frame.work)
        assert "shadows" not in [step.name for step in renderer.graph.steps]
        assert renderer.techniques["shadows"].memory is None
        pipelines = frame.work["pipelines"]
    with chapter.open(scene, SIZE, BASE) as renderer:
        assert renderer.render(ABOVE).work["pipelines"] in (
            pipelines + 2,
            pipelines + 5,
        )  # of casters, and kernels


@pytest.mark.core
@pytest.mark.feature("shadows/caching")
def test_only_what_changed_is_drawn_again(chapter):
    scene = yard(LIGHTS["sun"][0], LIGHTS["spot"][0], LIGHTS["point"][0])
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        first = renderer.render(ABOVE)
        picture = first.image("color_linear").copy()
        assert first.work["shadow_faces_drawn"] == first.work["shadow_faces"] == 8
        for _ in range(4):
            frame = renderer.render(ABOVE)
            assert frame.work["shadow_faces_drawn"] == 0 and frame.work.get("shadow_draws", 0) == 0
            assert np.array_equal(frame.image("color_linear"), picture)
        assert frame.work["recorded"] == 0
        node = scene.lights[2].node
        with scene.edit() as edit:
            edit.set_transform(node, translation=(-1.0, 3.0, 0.9))
        shifted = renderer.render(ABOVE)
        assert shifted.work["shadow_faces_drawn"] == 6  # its own
        after = shifted.image("color_linear").copy()
    with chapter.open(scene, SIZE, BASE, outputs=("color_linear",)) as renderer:
        assert np.array_equal(renderer.render(ABOVE).image("color_linear"), after)
        assert not np.array_equal(after, picture)
        with scene.edit() as edit:
            edit.set_visible(3, False)
        assert renderer.render(ABOVE).work["shadow_faces_drawn"] == 8


@pytest.mark.parametrize("graph", ["deferred", "compute"])
def test_each_path_receives_the_same_shadows(chapter, graph):
    scene = yard(*(light for light, *_ in LIGHTS.values()))
    view = View(pose_looking_at((3, 4, 5), (0, 0.3, 0)), Perspective())
    one = rendered(chapter, scene, view, graph="forward")
    other = rendered(chapter, scene, view, graph=graph)
    apart = np.abs(one - other).max(-1) > 1e-3 * one.max()
    assert (
        apart.mean() < 0.005
    )  # positions from depth are off by float32: at edges a tap may answer otherwise
    bare = rendered(chapter, scene, view, graph="forward", shadows="off")
    assert (np.abs(one - bare).max(-1) > 0.05 * bare.max()).mean() > 0.05


def test_surfaces_from_a_visibility_buffer_receive_the_same_shadows(chapter):
    scene = yard(*(light for light, *_ in LIGHTS.values()))
    view = View(pose_looking_at((3, 4, 5), (0, 0.3, 0)), Perspective())
    one, other = (
        rendered(chapter, scene, view, graph="deferred", geometry="compute", surfaces=surfaces)
        for surfaces in ("gbuffer", "visibility")
    )
    assert (np.abs(one - other).max(-1) > 1e-3 * one.max()).mean() < 0.005


def test_blended_surfaces_receive_shadows(chapter):
    glass = Material(
        roughness=1.0, metallic=0.0, double_sided=True, alpha_mode="blend", base_color=(1, 1, 1, 0.6)
    )
    solid = Material(roughness=1.0, metallic=0.0, double_sided=True)
    light, pose = sun((0.0, -1.0, 0.0))
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0, 4.0, 0), (2, 2), (0, 1, 0)))
    scene = quad_scene(materials=(glass, solid), matrices=(*squares, pose), instance_materials=(0, 1))
    scene = replace(scene, lights=[replace(light, node=2)])
    below = View(pose_looking_at((0, 3.5, 0), (0, 0, 0), (0, 0, -1)), Orthographic(2.5, 0.1, 20.0))
    for turned in ({"graph": "forward"}, {"graph": "deferred"}, {"transparency": "lists"}):
        drawn = rendered(chapter, scene, below, **turned)[..., 0]
        assert drawn[28:36, 28:36].max() == 0.0 < drawn[:8].min(), turned


@pytest.mark.parametrize(
    "kind", ["sun", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("spot", "point"))]
)
def test_masked_casters_have_holes_and_blended_ones_cast_nothing(chapter, kind):
    light = LIGHTS[kind][0]
    see_through = Material(
        roughness=1.0, metallic=0.0, double_sided=True, alpha_mode="blend", base_color=(1, 1, 1, 0.5)
    )
    bare = yard(light)
    bare.instances.visible[1:] = False
    assert (lit_taps(factors(chapter, bare)[8:56, 8:56], 3, chapter.device) == 9).all()
    scene = yard(light, material=see_through)
    with chapter.open(scene, SIZE, BASE) as renderer:
        frame = renderer.render(ABOVE)
        frame.image("color")
        assert frame.work.get("shadow_draws", 0) == 0


@pytest.mark.feature("shadows/aliasing-improvements")
def test_cascade_borders_show_no_seam(chapter):
    scene = yard(LIGHTS["sun"][0])
    scene.instances.visible[1:] = False
    view = View(pose_looking_at((0, 0.6, 3.9), (0, 0, 0)), Perspective(1.0, 0.05))
    with chapter.open(scene, (96, 64), replaced(BASE, view="cascade", shadow_cascades=3)) as renderer:
        shown = renderer.render(view).image("color")[40:]
    assert len(np.unique(shown.reshape(-1, shown.shape[-1]), axis=0)) >= 2
    drawn = factors(chapter, scene, view, (96, 64), shadow_cascades=3)[40:, 8:-8]
    assert (lit_taps(drawn, 3, chapter.device) == 9).all()


@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_masks_cut_holes_into_shadows(chapter, graph):
    raw = np.full((8, 8, 4), 255, np.uint8)
    raw[:, :4, 3] = 0
    image = Image("half", pixels=raw)
    mask = Material(
        roughness=1.0, metallic=0.0, double_sided=True, alpha_mode="mask", base_color_texture=texture()
    )
    light, pose = sun((0.0, -1.0, 0.0))
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0, 4.0, 0), (3, 3), (0, 1, 0)))
    plain = Material(roughness=1.0, metallic=0.0, double_sided=True)
    scene = quad_scene(
        materials=(plain, mask), matrices=(*squares, pose), instance_materials=(0, 1), images=(image,)
    )
    scene = replace(scene, lights=[replace(light, node=2)])
    below = View(pose_looking_at((0, 3.5, 0), (0, 0, 0), (0, 0, -1)), Orthographic(2.5, 0.1, 20.0))
    drawn = rendered(chapter, scene, below, graph=graph)[..., 0]
    bare = rendered(chapter, scene, below, graph=graph, shadows="off")[..., 0]
    dark = drawn < 0.5 * bare
    x = (np.arange(64) + 0.5) / 64 * 5 - 2.5
    inside = (np.abs(x) < 1.4)[None, :] & (np.abs(x) < 1.4)[:, None]
    left, right = (np.broadcast_to(side, (64, 64)) & inside for side in ((x < -0.1)[None], (x > 0.1)[None]))
    assert sorted((dark[left].mean(), dark[right].mean())) == [0.0, 1.0]
    assert not dark[(np.abs(x) > 1.6)[None, :] & np.ones((64, 1), bool)].any()


@pytest.mark.feature("sparse/page-pool")
def test_a_small_pool_lowers_resolution_and_says_so(chapter):
    scene = yard(LIGHTS["sun"][0], LIGHTS["spot"][0], LIGHTS["point"][0])
    with chapter.open(scene, SIZE, replaced(BASE, shadow_size=512, shadow_pool=1)) as renderer:
        work = renderer.render(ABOVE).work
        assert work["shadow_bytes"] <= 1 << 20 and work["shadow_pages"] <= 16
        assert (faces_of(renderer)["size"] < 512).all()
        assert work["shadow_lights"] == 3 and work["shadow_lights_left_out"] == 0
    lamps = [point((x, 2.0, z)) for x in (-2.0, 0.0, 2.0) for z in (-2.0, 2.0)]
    with chapter.open(yard(*lamps), SIZE, replaced(BASE, shadow_pool=1, shadow_lights=4)) as renderer:
        work = renderer.render(ABOVE).work
        assert work["shadow_lights"] == 4 and work["shadow_lights_left_out"] == 2
        assert work["shadow_lights_lowered"] == 4 and work["shadow_pages"] <= 16


def _two_lamps():
    light = spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0), outer=math.radians(55), candela=100.0)
    return yard(light, LIGHTS["point"][0])


@pytest.fixture(scope="module")
def of_two_lamps(chapter):
    """Factors of two lamps at their usual place and size."""
    return factors(chapter, _two_lamps())


@pytest.mark.parametrize(
    "case",
    [
        *("moved", "small", "inside", "far", "no range"),
        *(pytest.param(case, marks=pytest.mark.long) for case in ("large", "near")),
    ],
)
def test_extremes_stay_finite_and_shaded(chapter, of_two_lamps, case):
    scene, looking, turned, wanted = _two_lamps(), ABOVE, {}, of_two_lamps
    if case == "moved":
        scene, looking = moved(scene, ABOVE, (1e5, -1e5, 1e5))
    elif case in ("small", "large"):
        scene, looking = scaled(scene, ABOVE, 1e-3 if case == "small" else 1e3)
    elif case == "inside":
        scene = yard(point((0.0, 1.0, 0.0)))
    elif case in ("near", "far"):
        turned = {"shadow_near": 1e-6 if case == "near" else 1.0}
    else:
        scene = yard(point((0.0, 3.0, 0.0), reach=0.0), point((0.0, 3.0, 0.0), reach=math.inf))
    drawn = factors(chapter, scene, looking, **turned)
    assert np.isfinite(drawn).all()
    ground = np.maximum(abs(ground_below()[..., 0]), abs(ground_below()[..., 2])) > 0.55
    if case == "inside":
        assert (drawn[ground] == 0.0).all()  # the cube is closed
    elif case in ("moved", "small", "large", "near"):
        assert (np.abs(drawn - wanted) > 0.5).mean() < 0.004
    elif case == "far":
        assert drawn[ground].mean() >= wanted[ground].mean()


def test_what_bends_casts_the_shadow_of_its_pose(chapter):
    scene, looking = bending(), View(pose_looking_at((0, 1, 6), (0, 0, 0)), Perspective())
    with chapter.open(scene, SIZE, replaced(BASE, shadow_size=128)) as renderer:
        for time in (0.0, 0.5, 0.9, 0.9):
            frame = renderer.render(looking, time)
            frame.image("color")
            number = 5  # the light looks along -z
            wanted = twin.face_depths(faces_of(renderer)[number], bent(time) - scene.origin)
            found = read_face(renderer, number)
            agree = ((found < 1e29) == (wanted < 1e29)) & ((np.abs(found - wanted) < 1e-4) | (wanted > 1e29))
            assert agree.mean() > 0.99 and (wanted < 1e29).mean() > 0.05, time
        assert frame.work["shadow_faces_drawn"] == 0  # the second time nothing has moved


def test_cloth_casts_the_shadow_of_its_frame(chapter):
    scene = cloth_scene_of(cloth())
    looking = View(pose_looking_at((0.3, -0.3, 2.2), (0, -0.5, 0)), Perspective(0.9, 0.1))
    maps = []
    with chapter.open(scene, SIZE, replaced(BASE, shadow_size=128)) as renderer:
        for number in range(8):
            frame = renderer.render(looking, number / 30)
            frame.image("color")
            assert number == 0 or frame.work["cloth_steps"] > 0
            assert frame.work["shadow_faces_drawn"] == frame.work["shadow_faces"] > 0
            maps.append(all_faces(renderer))
    assert not np.array_equal(maps[-1], maps[-2]) and (maps[-1] < 1e29).any()


def test_soft_shadows_are_those_of_a_disc_of_light(chapter):
    """A lamp of 0.25 m above the edge of a square: the part of the disc that each point sees, by rays."""
    eye, radius = np.array((0.0, 4.0, 0.0)), 0.25
    square = placed((1.5, 1.5, 0.0), (3.0, 6.0), (0, 1, 0))
    scene = yard(spot(tuple(eye), (0, 0, 0), outer=math.radians(50)), extra=(square,))
    scene.instances.visible[1:7] = False
    turned = {"shadow_size": 512, "shadow_lamp": radius / scene.length_scale}
    strip = View(pose_looking_at((0, 1.4, 0), (0, 0, 0), (0, 0, -1)), Orthographic(0.3, 0.1, 20.0))
    soft = factors(chapter, scene, strip, shadow_filter="pcss", **turned)[32]
    hard = factors(chapter, scene, strip, shadow_kernel=3, **turned)[32]
    x = ((np.arange(64) + 0.5) / 64 * 2 - 1) * 0.3
    points = np.stack([x, np.full(64, 1e-4), np.full(64, 0.3 / 64)], -1)
    turn = np.arange(256) * 2.399963  # golden angle: even on a disc
    disc = (
        radius
        * np.sqrt((np.arange(256) + 0.5) / 256)[:, None]
        * np.stack([np.cos(turn), 0 * turn, np.sin(turn)], 1)
    )
    triangles = twin.triangles_of(scene)
    rays = (eye + disc)[None] - points[:, None]
    nearest = twin.first_hit(np.repeat(points, 256, axis=0), rays.reshape(-1, 3), triangles, 1e-6)
    wanted = (nearest.reshape(64, 256) >= 1.0).mean(axis=1)
    assert 10 < ((wanted > 0.02) & (wanted < 0.98)).sum() < 60
    error, of_hard = np.abs(soft - wanted), np.abs(hard - wanted)
    assert error.mean() < 0.05 and error.max() < 0.2 and not of_hard.mean() < 2 * error.mean()


@pytest.mark.parametrize("before", [1, *(pytest.param(count, marks=pytest.mark.long) for count in (2, 3))])
def test_a_reset_gives_the_shadows_of_a_new_renderer(chapter, before):
    """Whatever was drawn before: poses go back, and lamps take the slots that they would have had."""
    lamps = [point((x, 2.0, z)) for x in (-2.0, 0.0, 2.0) for z in (-2.0, 2.0)]
    scene = bending()
    still = yard(LIGHTS["sun"][0], *lamps)
    walk = [View(pose_looking_at((4 - n, 3, 4), (0, 0, 0)), Perspective(0.7)) for n in range(4)]
    turned = {"shadow_lights": 4, "shadow_memory": "pages", "shadow_cascades": 3}
    for shown, views in (
        (scene, [View(pose_looking_at((0, 1, 6), (0, 0, 0)), Perspective())] * 4),
        (still, walk),
    ):
        films = []
        for drawn in (0, before):
            with chapter.open(shown, SIZE, replaced(BASE, **turned), outputs=("color_linear",)) as renderer:
                for number in range(drawn):
                    renderer.render(views[3 - number], 0.9 - 0.3 * number)
                renderer.reset_history("test")
                frames = [renderer.render(view, 0.2 * n) for n, view in enumerate(views[:2])]
                films.append([frame.image("color_linear").copy() for frame in frames])
        assert all(np.array_equal(*pair) for pair in zip(*films, strict=True))
        assert films[0][0].max() > 0
