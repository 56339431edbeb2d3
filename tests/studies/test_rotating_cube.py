"""The study rotating-cube against rays through a box in double precision: no triangle is in this truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from chapters.ch01.studies.rotating_cube import matrices
from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tests.support.bounds import codes_off, snapping

SIZE = (48, 40)
YFOV, NEAR = math.radians(40.0), 0.05
EYE = np.array([0.7, 1.1, 2.2])
VIEW = View(pose_looking_at(EYE, (0.0, 0.0, 0.0)), Perspective(YFOV, NEAR))
BACKGROUND = 255 * np.array([0.05, 0.05, 0.06])


def turned(angle: float) -> np.ndarray:
    """Return (3, 3) of the rotation about (1, 1, 1): Rodrigues' formula, axis products written out."""
    k = np.ones(3) / math.sqrt(3)
    cross = np.array([(0, -k[2], k[1]), (k[2], 0, -k[0]), (-k[1], k[0], 0)])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def rays(size: tuple[int, int], shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Return (H, W, 3) directions of length 1 along the view axis, in the world, through places `shift` pixels (right,
    down) of pixel centres."""
    width, height = size
    x = ((np.arange(width) + 0.5 + shift[0]) / width * 2 - 1) * math.tan(YFOV / 2) * width / height
    y = (1 - (np.arange(height) + 0.5 + shift[1]) / height * 2) * math.tan(YFOV / 2)
    grid = np.stack([*np.meshgrid(x, y), np.full((height, width), -1.0)], axis=-1)
    return grid @ VIEW.world_from_view[:3, :3].T


def box(time: float, shift: tuple[float, float] = (0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which pixels see the cube (H, W), the distance along the view axis, and the colour (H, W, 3) there."""
    object_from_world = turned(time).T
    eye, ray = object_from_world @ EYE, rays(SIZE, shift) @ object_from_world.T
    with np.errstate(divide="ignore"):
        slabs = np.stack([(side - eye) / ray for side in (-0.5, 0.5)])
    enter, leave = slabs.min(axis=0).max(axis=-1), slabs.max(axis=0).min(axis=-1)
    hit = enter < leave
    return hit, enter, eye + ray * enter[..., None] + 0.5


def moved(time: float, snap: float) -> np.ndarray:
    """Return by how much (H, W) the cube's reversed depth may be off, as a part of it, where corners are off by `snap`.

    What is interpolated between moved corners is what lies at most as far from the pixel's centre. Over the picture the
    depth of each face is linear, and the cube's the least of theirs, thus concave: what it gains on one side of a place
    it loses at least on the other side, so that no place within `snap` differs by more than a corner of that square.
    """
    _, distance, _ = box(time)
    corners = [box(time, (x, y))[1] for x in (-snap, snap) for y in (-snap, snap)]
    return np.max([np.abs(distance / corner - 1) for corner in corners], axis=0)


def near_an_edge(mask: np.ndarray) -> np.ndarray:
    """Return the pixels of a mask's border, on both sides of it."""
    padded = np.pad(mask, 1, mode="edge")
    around = [padded[y : y + mask.shape[0], x : x + mask.shape[1]] for y in range(3) for x in range(3)]
    return np.any([one != mask for one in around], axis=0)


@pytest.mark.feature("intro/rotating-cube")
@pytest.mark.parametrize("time", [0.0, 0.3, 1.7, 4.0])
def test_silhouette_depth_and_colour_are_those_of_a_box_met_by_rays(stage, time):
    frame = stage.draw("rotating-cube", SIZE, time, VIEW, outputs=("color", "depth"))
    color, depth = frame["color"].astype(np.float64), frame["depth"].astype(np.float64)
    hit, distance, expected = box(time)
    assert 0.1 < hit.mean() < 0.6
    differ = (depth > 0) != hit
    assert not (differ & ~near_an_edge(hit)).any(), "the silhouette is off by more than a pixel"
    both = hit & (depth > 0)
    off = np.abs(depth * distance / NEAR - 1)  # reversed z: near / distance
    assert (off < 1e-4 + moved(time, snapping(stage.device)))[both].all()
    # Just inside of a silhouette or an edge the corner's grid of 1/256 pixel shows; elsewhere rounding alone.
    inner = both & ~near_an_edge(hit)
    error = np.abs(color - 255 * expected).max(axis=-1)
    assert error[inner].max() <= codes_off(stage.device) + 0.5
    assert np.abs(color[~hit & (depth == 0)] - BACKGROUND).max() <= 0.5


@pytest.mark.feature("intro/rotating-cube")
@pytest.mark.parametrize("time", [0.5, 2.5])
def test_the_outermost_pixels_are_where_the_corners_project_to(stage, time):
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    seen = (corners @ turned(time).T - EYE) @ VIEW.world_from_view[:3, :3]
    scale = SIZE[1] / 2 / math.tan(YFOV / 2)  # pixels for each unit of x / -z
    places = seen[:, :2] / -seen[:, 2:] * scale * (1, -1) + np.array(SIZE) / 2
    depth = stage.draw("rotating-cube", SIZE, time, VIEW, outputs=("depth",))["depth"]
    rows, columns = np.nonzero(depth)
    for covered, places_there in ((columns, places[:, 0]), (rows, places[:, 1])):
        assert abs(covered.min() - places_there.min()) <= 1
        assert abs(covered.max() + 1 - places_there.max()) <= 1


@pytest.mark.feature("intro/rotating-cube")
def test_a_full_turn_gives_the_first_image_again(stage):
    with stage.open("rotating-cube", SIZE, outputs=("color", "depth")) as renderer:
        pictures = []
        for time in (0.0, math.tau, 0.5 * math.tau):
            frame = renderer.render(VIEW, time)
            pictures.append((frame.image("color"), frame.image("depth")))
    first, turned_once, half = pictures
    assert all((a == b).all() for a, b in zip(first, turned_once, strict=True))
    assert (first[0] != half[0]).any()


def test_a_third_of_a_turn_exchanges_the_axes_and_so_the_colours(stage):
    frames = [
        stage.draw("rotating-cube", SIZE, time, VIEW, outputs=("color", "depth"))
        for time in (0.0, math.tau / 3)
    ]
    inside = ~near_an_edge(frames[0]["depth"] > 0) & (frames[0]["depth"] > 0)
    a, b = (frame["color"].astype(int)[inside] for frame in frames)
    # x has become y, y z, and z x: at a place (x, y, z) there is now the point of the cube that was at (y, z, x).
    assert np.abs(np.roll(a, -1, axis=-1) - b).max() <= 1
    assert np.abs(frames[0]["depth"] - frames[1]["depth"])[inside].max() < 1e-6


def test_frames_in_flight_keep_their_own_matrices(stage):
    """Each frame is read only after the next was enqueued: had they one buffer, the first would show the second."""
    with stage.open("rotating-cube", SIZE) as renderer:
        alone = [renderer.render(VIEW, time).image("color") for time in (0.0, 1.0)]
        frames = [renderer.render(VIEW, time) for time in (0.0, 1.0)]
        together = [frame.image("color") for frame in frames]
        held = [buffer.view(np.float32).copy() for buffer in renderer._uniforms]
    assert (alone[0] != alone[1]).any()
    assert all((a == b).all() for a, b in zip(alone, together, strict=True))
    # A driver may have read them before the next frame was written: then the pictures are right by luck.
    wanted = [matrices(VIEW, time, SIZE[0] / SIZE[1]).ravel() for time in (0.0, 1.0)]
    assert all((a == b).all() for a, b in zip(held, wanted, strict=True))


def test_a_resize_changes_the_aspect_and_nothing_else(stage):
    with stage.open("rotating-cube", (16, 16), outputs=("color", "depth")) as renderer:
        renderer.render(VIEW, 1.0)
        renderer.resize(SIZE)
        frame = renderer.render(VIEW, 1.0)
        assert frame.index == 0
        resized = frame.image("color")
    assert (resized == stage.draw("rotating-cube", SIZE, 1.0, VIEW)["color"]).all()
    assert chapters.outputs_of("1/rotating-cube") == ("color", "depth")
