"""Shadows far from the origin, of any size, and around lights that stand in the way: against rays in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch08.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import moved, scaled
from tests.support.shadows import PLAIN, lit_taps, placed, point, read_face, spot, sun, yard
from tests.twins import shadows as twin

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))

SIZE, HALF = (64, 64), 3.0
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(HALF, 0.1, 20.0))
BASE = Settings(
    **PLAIN,
    view="shadow-factor",
    shadow_memory="full",
    shadow_kernel=1,
    shadow_sun_size=512,
    shadow_size=512,
    shadow_cascades=1,
)
LAMP = (-1.2, 3.0, 0.8)
SPOT = (1.5, 4.0, 1.0)
LIGHTS = {
    "sun": lambda: sun((0.5, -1.0, 0.3)),
    "spot": lambda: spot(SPOT, (0.0, 0.5, 0.0), outer=math.radians(59)),
    "point": lambda: point(LAMP),
}
PLACES = {"sun": None, "spot": SPOT, "point": LAMP}
CASES = ("as it is", "1e5 m away", "a thousandth", "a thousand times")
SAMPLE = {
    ("point", "as it is"),
    ("sun", "1e5 m away"),
    ("spot", "a thousandth"),
    ("point", "a thousand times"),
}
"""Each case with one kind of light, and each kind."""
NEAR_SAMPLE = {("point", 1e-2), ("spot", 0.3), ("point", 1.0)}


def factors(chapter, scene, looking=ABOVE, **turned):
    with chapter.open(scene, SIZE, replaced(BASE, **turned), outputs=("color_linear",)) as renderer:
        drawn = renderer.render(looking).image("color_linear")[..., 0].astype(np.float64)
    assert np.isfinite(drawn).all()
    return drawn


def ground():
    """Return (H, W, 3) points of the ground at the middles of the pixels, and which of them the cube does not hide."""
    x = ((np.arange(64) + 0.5) / 64 * 2 - 1) * HALF
    points = np.stack(np.broadcast_arrays(x[None, :], 1e-4, x[:, None]), -1)
    return points, np.maximum(abs(points[..., 0]), abs(points[..., 2])) > 0.55


def lit(scene, place, *, near=0.0, axes=None, towards=(-0.5, 1.0, -0.3)):
    """Return (H, W) whether the ground sees a light at a place, None for a sun.

    What lies before the near plane of a face casts no shadow, nor gets any: `axes` (N, 3) are those of the faces of
    which the one with the greatest depth counts.
    """
    points = ground()[0].reshape(-1, 3)
    triangles = twin.triangles_of(scene)
    if place is None:
        nearest = twin.first_hit(points, np.broadcast_to(towards, points.shape), triangles, 1e-6)
        return np.isinf(nearest).reshape(64, 64)
    axes = np.concatenate([np.eye(3), -np.eye(3)]) if axes is None else axes
    rays = points - np.array(place)
    depth = (rays @ axes.T).max(axis=1)
    least = near / depth
    distances = twin.hits(np.broadcast_to(place, rays.shape), rays, triangles)
    hidden = ((distances > least[:, None]) & (distances < 1 - 1e-5)).any(axis=1)
    return (~hidden | (depth <= near)).reshape(64, 64)


def edges(truth):
    """Return (H, W) whether a pixel or any of the eight around it sees otherwise."""
    padded = np.pad(truth, 1, mode="edge")
    around = np.stack([padded[1 + y : 65 + y, 1 + x : 65 + x] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    return around.any(axis=0) & ~around.all(axis=0)


def hold(chapter, drawn, truth, chosen, *, mixed=True):
    """Hold factors of one light to a truth, wherever no edge is within a pixel.

    A texel of a face of 512 at 5.6 m covers 5.6 / 254 m across, sqrt 2 of that from corner to corner, and at most 1.9
    times as much on the ground: 0.06 m, which is less than a pixel of 0.094 m.
    """
    taps = lit_taps(drawn, 1, chapter.device)
    assert not ((taps == 1) != truth)[chosen & ~edges(truth)].any()
    assert not mixed or 100 < truth[chosen].sum() < chosen.sum() - 100


@pytest.mark.feature("shadows/depth-recording", "shadows/directional-fit", "shadows/cube-sampling")
@pytest.mark.parametrize(
    ("kind", "case"),
    [
        pytest.param(kind, case, marks=[pytest.mark.long] * ((kind, case) not in SAMPLE))
        for kind in LIGHTS
        for case in CASES
    ],
)
def test_place_and_scale_leave_shadows_where_rays_have_them(chapter, kind, case):
    scene, looking = yard(LIGHTS[kind]()), ABOVE
    truth = lit(scene, PLACES[kind])
    if case == "1e5 m away":
        scene, looking = moved(scene, looking, (1e5, -1e5, 1e5))
    elif case != "as it is":
        scene, looking = scaled(scene, looking, 1e-3 if case == "a thousandth" else 1e3)
    hold(chapter, factors(chapter, scene, looking), truth, ground()[1])


@pytest.mark.parametrize("reach", [math.inf, 4.0])
def test_a_light_inside_a_caster_lights_nothing_outside(chapter, reach):
    """The cube is closed: rays agree, and no texel leaks, whatever the range."""
    scene = yard(point((0.1, 1.1, -0.2), reach=reach))
    truth = lit(scene, (0.1, 1.1, -0.2))
    points, seen = ground()
    assert not truth[seen].any()
    hold(chapter, factors(chapter, scene), truth, seen, mixed=False)
    scene.instances.visible[1:7] = False  # and without it the lamp does light the ground
    near = np.linalg.norm(points - (0.1, 1.1, -0.2), axis=-1) < 3.9
    assert (lit_taps(factors(chapter, scene), 1, chapter.device)[near & seen] == 1).all()


@pytest.mark.feature("shadows/instance-culling")
@pytest.mark.parametrize("kind", ["spot", "point"])
def test_a_caster_may_be_larger_than_the_range_of_a_light(chapter, kind):
    """A square of 80 m whose middle is 40 m away, and whose edge hides half of what a range of 5.5 m reaches."""
    place = (0.1, 3.5, 0.2)
    light = point(place, reach=5.5)
    if kind == "spot":
        light = spot(place, (0.1, 0.0, 0.2), outer=math.radians(50), reach=5.5)
    scene = yard(light, extra=(placed((40.0, 1.6, 0.0), (80.0, 80.0), (0, 1, 0)),))
    points, _ = ground()
    below = View(pose_looking_at((0, 1.5, 0), (0, 0, 0), (0, 0, -1)), Orthographic(HALF, 0.1, 20.0))
    away = points - np.array(place)
    reached = np.linalg.norm(away, axis=-1) < 5.4
    if kind == "spot":
        reached &= -away[..., 1] > math.cos(math.radians(49)) * np.linalg.norm(away, axis=-1)
    scene.instances.visible[1:7] = False
    truth = lit(scene, place)
    hold(chapter, factors(chapter, scene, below), truth, reached)


@pytest.mark.parametrize(
    ("kind", "near"),
    [
        pytest.param(kind, near, marks=[pytest.mark.long] * ((kind, near) not in NEAR_SAMPLE))
        for kind in ("spot", "point")
        for near in (1e-3, 1e-2, 0.1, 0.3, 1.0)
    ],
)
def test_near_planes_cut_casters_and_nothing_else(chapter, kind, near):
    """`shadow_near` in length scales: what is nearer along the axis of a face casts no shadow, and gets none."""
    scene = yard(LIGHTS[kind]())
    axes = None
    if kind == "spot":
        axis = np.array((0.0, 0.5, 0.0)) - np.array(SPOT)
        axes = (axis / np.linalg.norm(axis))[None]
    truth = lit(scene, PLACES[kind], near=near * scene.length_scale, axes=axes)
    hold(chapter, factors(chapter, scene, shadow_near=near), truth, ground()[1], mixed=near < 0.1)


def test_near_planes_keep_depth_precise(chapter):
    """Reversed depth in floats: 1e-6 length scales or 0.1 to the near plane, depth has the same relative error."""
    light = spot((0.0, 5.0, 0.0), (0, 0, 0), outer=math.radians(40))
    texel = 5.0 * math.tan(math.radians(40)) / 255
    scene = yard(light, extra=(placed((0, 2 * texel, 0), (4, 4), (0, 1, 0)),))
    scene.instances.visible[1:7] = False
    below = View(pose_looking_at((0, texel, 0.3), (0, 0, 0)), Perspective(0.4, 1e-3))
    for near in (1e-6, 1e-3, 0.1):
        with chapter.open(
            scene, SIZE, replaced(BASE, shadow_near=near), outputs=("color_linear",)
        ) as renderer:
            drawn = renderer.render(below).image("color_linear")[..., 0]
            stored = read_face(renderer, 0)[206:306, 206:306].astype(np.float64)
        assert (drawn[24:40] == 0.0).all(), near
        assert (np.abs(stored - (5 - 2 * texel)) < 2e-6 * 5).all(), near


@pytest.mark.feature("shadows/depth-bias")
@pytest.mark.parametrize("kernel", [1, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize("bias", ["plane", "slope"])
@pytest.mark.parametrize(
    ("kind", "degrees"),
    [
        *(("sun", 75), ("spot", 0)),
        *(pytest.param(kind, 45, marks=pytest.mark.long) for kind in ("sun", "spot", "point")),
        *(pytest.param(*case, marks=pytest.mark.long) for case in (("sun", 0), ("spot", 75))),
        *(pytest.param("point", degrees, marks=pytest.mark.long) for degrees in (0, 75)),
        ("corner", 54.7),
    ],
)
def test_the_contact_gap_is_two_texels_and_the_kernel(chapter, kind, degrees, bias, kernel):
    """A square at some height above a plane hides its light: with `plane`, at two texels and the kernel's radius.

    Of t metres a texel (the distance over `scale`) and an angle of theta to the light, the gap is t (cos theta + sin
    theta) with `plane`. With `slope` it is t (cos theta + (1 + 2 sqrt 2 (radius + 1/2)) sin theta): depths at the
    corners of the kernel are off by sqrt 2 (radius + 1/2) tan theta, those of the receiver and those of the square.
    """
    angle, radius = math.radians(degrees), kernel // 2
    towards = np.array((math.sin(angle), math.cos(angle), 0.0))
    light = {
        "sun": lambda: sun(tuple(-towards)),
        "spot": lambda: spot(tuple(4 * towards), (0, 0, 0), outer=math.radians(30)),
        "point": lambda: point(tuple(4 * towards)),
        # Where three faces of a cube meet, depth is 1 / sqrt 3 of the distance.
        "corner": lambda: point(tuple(4 * np.array((1.0, 1.0, 0.98)) / math.sqrt(2.9604))),
    }[kind]()
    widest = 8.6 if kind == "sun" else 2 * 4.0 * math.tan(math.radians(30 if kind == "spot" else 45))
    gap = 2.0 + radius
    if bias == "slope":
        # Points half a metre beside the axis, 4 m away, are seen at up to 0.13 more.
        gap = math.cos(angle) + (1 + 2.83 * (radius + 0.5)) * math.sin(angle + 0.13)
    height = gap * widest / (512 - 2 * (radius + 1))
    scene = yard(light, extra=(placed((0, height, 0), (2, 2), (0, 1, 0)),))
    scene.instances.visible[1:7] = False
    below = View(pose_looking_at((0, height / 2, 0.15), (0, 0, 0)), Perspective(0.4, 1e-3))
    drawn = factors(chapter, scene, below, shadow_kernel=kernel, shadow_bias=bias)
    assert (drawn[28:40, 24:40] == 0.0).all()
    more = factors(
        chapter,
        scene,
        below,
        shadow_kernel=kernel,
        shadow_bias=bias,
        shadow_constant=2 * gap / math.cos(angle),
    )
    assert more[28:40, 24:40].max() > 0.5  # a bias of twice the height does leave a gap


@pytest.mark.feature("shadows/depth-bias")
@pytest.mark.parametrize("bias", ["plane", "slope"])
@pytest.mark.parametrize("kind", ["spot", "point"])
def test_wide_kernels_shade_no_plane_that_is_seen_aslant(chapter, kind, bias):
    """Points beside the axis of a face, too: there a plane that faces the light has a slope along the axis."""

    def light(degrees):
        angle = math.radians(degrees)
        towards = 4 * np.array((math.sin(angle) * 0.8, math.cos(angle), math.sin(angle) * 0.6))
        return point(tuple(towards)) if kind == "point" else spot(tuple(towards), (0, 0, 0), math.radians(30))

    scene = yard(light(0))
    scene.instances.visible[1:] = False
    settings = replaced(BASE, shadow_kernel=13, shadow_bias=bias, shadow_size=256)
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        for degrees in (0, 20, 60, 85):
            with scene.edit() as edit:
                edit.set_transform(scene.lights[0].node, matrix=light(degrees)[1])
            drawn = renderer.render(ABOVE).image("color_linear")[..., 0].astype(np.float64)
            taps = lit_taps(drawn, 13, chapter.device)
            assert set(np.unique(taps)) <= ({0, 169} if kind == "spot" else {169}), degrees
            assert (taps[28:36, 28:36] == 169).all()
