"""The same calls give the same bits: after a reset, beside another renderer, in any order, however the GPU is fed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from assets import locate
from chapters.ch01.settings import Settings
from common.gltf import load_scene
from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Light, Material
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene
from tests.support.scenes import facing, nodes_at, quad_scene, translated

pytestmark = pytest.mark.newest

SIZE = (48, 32)
OUTPUTS = ("color", "color_linear", "depth", "instance_id")
WANTED = set(OUTPUTS)


def moving_scene():
    """Return opaque, masked and glass squares under a sun and a lamp that circles them."""
    materials = (
        Material(metallic=0.2, roughness=0.4, base_color=(0.9, 0.5, 0.3, 1.0)),
        Material(unlit=True, base_color=(0.2, 0.4, 0.9, 0.4), alpha_mode="blend", double_sided=True),
        Material(metallic=0.0, alpha_mode="mask", base_color=(0.6, 0.9, 0.6, 0.8)),
    )
    places = (translated(-0.5, z=0.1), translated(0.3, 0.2, 0.4), translated(0.5, -0.3))
    lights = (Light("directional", node=3, intensity=1.0), Light("point", node=4, intensity=2.0))
    scene = quad_scene(materials=materials, matrices=places, instance_materials=(0, 1, 2), lights=lights)
    nodes = nodes_at(*places, pose_looking_at((1, 1, 2), (0, 0, 0)), np.eye(4))
    nodes.has_matrix[4] = False
    channel = AnimationChannel(
        4,
        "translation",
        np.array((0.0, 0.5, 1.0)),
        np.array([(-1, 0, 1), (1, 0.5, 1), (-1, 0, 1.0)]),
        "linear",
    )
    return replace(scene, nodes=nodes, animations=[Animation("circle", (channel,), 1.0)])


def film(renderer, calls):
    """Return every output of a frame per (view, time)."""
    pictures = []
    for view, time in calls:
        frame = renderer.render(view, time)
        pictures.append({name: frame.image(name) for name in OUTPUTS})
    return pictures


def equal(a, b):
    """Whether two films have the same bits."""
    return len(a) == len(b) and all(
        np.array_equal(x[name], y[name]) for x, y in zip(a, b, strict=True) for name in OUTPUTS
    )


CALLS = [
    (facing(ymag=1.2), 0.0),
    (facing(distance=1.7), 0.3),
    (facing(ymag=0.8), 0.9),
    (facing(ymag=1.2), 0.2),
]


@pytest.fixture(scope="module")
def scene():
    return moving_scene()


@pytest.fixture(scope="module")
def reference(chapter, scene):
    """The film of `CALLS`, by a renderer that has no past."""
    with chapter.open(scene, SIZE, outputs=WANTED) as made:
        pictures = film(made, CALLS)
    assert len({one["color_linear"].tobytes() for one in pictures}) == len(CALLS)
    return pictures


@pytest.mark.parametrize("before", [1, 2, 5], ids="{} frames before".format)
def test_a_reset_makes_a_renderer_new(chapter, scene, reference, before):
    """Whichever slot the film begins in, and whatever was drawn before it."""
    with chapter.open(scene, SIZE, outputs=WANTED) as made:
        for number in range(before):
            made.render(facing(distance=2.0 + number), 0.1 * number)
        made.reset_history("test")
        assert equal(film(made, CALLS), reference)
        assert made.render(*CALLS[0]).index == len(CALLS)


def test_frames_that_nobody_waits_for_are_the_same_frames(chapter, scene, reference):
    """Queued two deep, each read as late as it can be."""
    with chapter.open(scene, SIZE, outputs=WANTED) as made:
        frames, pictures = [], []
        for call in CALLS:
            frames.append(made.render(*call))
            if len(frames) > 1:
                pictures.append({name: frames[-2].image(name) for name in OUTPUTS})
        pictures.append({name: frames[-1].image(name) for name in OUTPUTS})
    assert equal(pictures, reference)


@pytest.mark.parametrize("order", ["in turns", "one after the other", "the other way round"])
def test_two_renderers_of_one_scene_do_not_disturb_each_other(chapter, scene, reference, order):
    with (
        chapter.open(scene, SIZE, outputs=WANTED) as a,
        chapter.open(scene, SIZE, outputs=WANTED) as b,
    ):
        if order == "in turns":
            pairs = [(film(a, [call])[0], film(b, [call])[0]) for call in CALLS]
            films = [list(one) for one in zip(*pairs, strict=True)]
        elif order == "one after the other":
            films = [film(a, CALLS), film(b, CALLS)]
        else:
            late = film(b, CALLS)
            films = [film(a, CALLS), late]
    assert all(equal(one, reference) for one in films)


def test_two_renderers_see_an_edit_each_when_it_draws(chapter):
    """One draws between two edits, the other only after both: in the end they agree."""
    scene = moving_scene()
    with (
        chapter.open(scene, SIZE, outputs=WANTED) as a,
        chapter.open(scene, SIZE, outputs=WANTED) as b,
    ):
        first = film(a, CALLS[:1]) + film(b, CALLS[:1])
        with scene.edit() as edit:
            edit.set_transform(0, matrix=translated(0.1, 0.1, 0.2))
            edit.set_light(1, Light("point", node=4, intensity=5.0))
        film(a, CALLS[1:3])
        with scene.edit() as edit:
            edit.set_material(0, Material(unlit=True, base_color=(0.1, 0.8, 0.1, 1.0)))
            edit.set_visible(2, False)
        late = film(a, CALLS[:1]) + film(b, CALLS[:1])
    assert equal(first[:1], first[1:])
    assert equal(late[:1], late[1:])
    assert not equal(first[:1], late[:1])
    with chapter.open(scene, SIZE, outputs=WANTED) as made:
        assert equal(film(made, CALLS[:1]), late[:1])


def test_what_is_asked_for_does_not_change_what_is_seen(chapter, scene, reference):
    for name in OUTPUTS:
        with chapter.open(scene, SIZE, outputs={name}) as made:
            assert np.array_equal(made.render(*CALLS[0]).image(name), reference[0][name]), name


def test_the_order_of_objects_in_the_file_is_no_matter_where_depth_decides(chapter):
    """Opaque squares at different depths, listed in any order: the same picture, and ids that follow their objects."""
    materials = tuple(Material(unlit=True, base_color=(i / 4, 1 - i / 4, 0.5, 1)) for i in range(4))
    places = [translated(0.3 * i - 0.4, 0.2 * i - 0.3, 0.1 * i) for i in range(4)]
    pictures = []
    for order in ((0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)):
        scene = quad_scene(
            materials=materials, matrices=tuple(places[i] for i in order), instance_materials=order
        )
        with chapter.open(scene, SIZE, outputs=WANTED) as made:
            (one,) = film(made, CALLS[:1])
        names = np.array([-1, *order])
        pictures.append((one["color_linear"], one["depth"], names[one["instance_id"]]))
    for other in pictures[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(pictures[0], other, strict=True))
    assert len(np.unique(pictures[0][2])) == 5


def test_what_stands_at_one_depth_is_drawn_in_the_scene_s_order(chapter):
    """Two squares that overlap in one plane, seen at a slant first: the next frame does not remember how they stood."""
    scene = quad_scene(Material(unlit=True), matrices=(translated(-0.5), translated(0.5)))
    straight = facing(ymag=2.0)
    slants = [replace(straight, world_from_view=pose_looking_at((x, 0, 2.0), (0, 0, 0))) for x in (-2.0, 2.0)]
    with chapter.open(scene, SIZE, outputs={"instance_id"}) as made:
        pictures = []
        for slant in slants:
            made.render(slant)
            pictures.append(made.render(straight).image("instance_id"))
    with chapter.open(scene, SIZE, outputs={"instance_id"}) as made:
        expected = made.render(straight).image("instance_id")
    assert np.array_equal(pictures[0], expected)
    assert np.array_equal(pictures[1], expected)


@pytest.mark.variants("vulkan", "without-all")  # on OpenGL test_agreement.py draws it twice
def test_a_scene_with_everything_is_the_same_twice(chapter):
    """The atrium at two times, forwards and backwards: 200 objects, textures, masks, glass, a moving node."""
    scene = load_scene(locate("atrium"))
    view = view_of_scene(scene, evaluate_pose(scene, 0.0), None, SIZE[0] / SIZE[1])
    with chapter.open(scene, SIZE, Settings(), outputs=WANTED) as made:
        pictures = film(made, [(view, 0.0), (view, 1.3), (view, 1.3), (view, 0.0)])
        made.reset_history("test")
        again = film(made, [(view, 1.3), (view, 0.0)])
    assert equal(pictures[:2], [pictures[3], pictures[2]])
    assert equal(again, [pictures[1], pictures[0]])


@pytest.mark.core
def test_the_previous_frame_leaves_no_trace(chapter, scene, reference):
    """A frame of garbage in between, overexposed by 20 stops and of the background alone: the next one is as always."""
    away = replace(facing(), world_from_view=pose_looking_at((0, 0, 2), (0, 0, 4)), ev100=-20.0)
    with chapter.open(scene, SIZE, outputs=WANTED) as made:
        for index in (0, 2, 1):
            made.render(away, math.pi)
            assert equal(film(made, CALLS[index : index + 1]), reference[index : index + 1])
