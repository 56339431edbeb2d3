"""The study line-canvas: lines end where their ends project to, and counts are closed forms."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from chapters.ch01.studies.line_canvas import CAPACITY, Settings
from chapters.ch01.studies.line_canvas.canvas import VERTEX, Canvas
from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View

SIZE = (64, 56)
YFOV = math.radians(40.0)
VIEW = View(pose_looking_at((1.6, 1.3, 2.4), (0.0, 0.0, 0.0)), Perspective(YFOV, 0.05))
BACKGROUND = np.rint(255 * np.array([0.05, 0.05, 0.06])).astype(int)


def projected(points: np.ndarray) -> np.ndarray:
    """Return (N, 2) pixels, row 0 on top, of points (N, 3) in the world."""
    seen = (np.asarray(points, np.float64) - VIEW.eye) @ VIEW.world_from_view[:3, :3]
    scale = SIZE[1] / 2 / math.tan(YFOV / 2)
    return seen[:, :2] / -seen[:, 2:] * scale * (1, -1) + np.array(SIZE) / 2


def drawn(stage, monkeypatch, fill, view=VIEW, size=SIZE, width=1.0):
    """Return the picture and the work of a frame whose lines `fill(canvas)` adds."""
    with stage.open("line-canvas", size, settings=Settings(width=width)) as renderer:
        monkeypatch.setattr(renderer, "fill", lambda canvas, settings, time: fill(canvas))
        frame = renderer.render(view)
        return frame.image("color").astype(int), frame.work


def shape_of(kind: str) -> tuple[np.ndarray, object]:
    """Return 8 corners found without the canvas, and what adds the shape to one."""
    signs = np.array(list(itertools.product((-1, 1), repeat=3)), np.float64)
    if kind == "box":
        matrix = np.array([(0.5, 0.1, 0, 0.1), (0, 0.4, 0.1, 0), (0.1, 0, 0.6, -0.1), (0, 0, 0, 1)])
        return signs @ matrix[:3, :3].T + matrix[:3, 3], lambda canvas: canvas.box(matrix, (1, 0.5, 0))
    seen = View(pose_looking_at((0.2, 0.3, 0.8), (0.0, 0.0, 0.0)), Perspective(math.radians(50), 0.2))
    far = 0.2 / 1.4  # reversed z: near / distance
    corners = []
    for x, y, which in signs:
        distance = 0.2 if which < 0 else 1.4
        height = math.tan(math.radians(25)) * distance
        corners.append((x * height * 1.25, y * height, -distance))
    world = np.array(corners) @ seen.world_from_view[:3, :3].T + seen.eye
    matrix = np.linalg.inv(seen.clip_from_world(1.25))
    return world, lambda canvas: canvas.frustum(matrix, far, (1, 0.5, 0))


@pytest.mark.feature("debug-draw/line-canvas")
@pytest.mark.parametrize("kind", ["box", "frustum"])
def test_the_edges_of_a_box_and_of_a_frustum_join_their_corners(stage, monkeypatch, kind):
    corners, add = shape_of(kind)
    signs = np.array(list(itertools.product((0, 1), repeat=3)))
    edges = {frozenset((a, b)) for a in range(8) for b in range(8) if np.abs(signs[a] - signs[b]).sum() == 1}
    canvas = Canvas()
    add(canvas)
    assert canvas.count == len(edges) == 12
    ends = canvas.ends["position"].astype(np.float64)
    nearest = np.linalg.norm(ends[:, :, None] - corners, axis=-1)
    assert nearest.min(axis=-1).max() < 1e-5
    assert {frozenset(pair) for pair in nearest.argmin(axis=-1).tolist()} == edges
    for line in range(12):  # each by itself, so that the ends seen are its own
        one = ends[line]
        picture, work = drawn(stage, monkeypatch, lambda canvas, one=one: canvas.lines(one, (1, 0.5, 0)))
        assert (work["lines"], work["lines_dropped"], work["draws"]) == (1, 0, 1)
        rows, columns = np.nonzero((picture == (255, 128, 0)).all(axis=-1))
        assert len(rows) > 3 and (
            (picture == BACKGROUND).all(axis=-1).sum() + len(rows) == picture[..., 0].size
        )
        places = projected(one)
        inside = ((places > 0) & (places < SIZE)).all()
        if inside:
            for found, wanted in ((columns + 0.5, places[:, 0]), (rows + 0.5, places[:, 1])):
                assert abs(found.min() - wanted.min()) <= 1 and abs(found.max() - wanted.max()) <= 1
        along = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
        off = (columns + 0.5 - places[0, 0]) * along[1] - (rows + 0.5 - places[0, 1]) * along[0]
        assert np.abs(off).max() <= 0.5 + 1 / 128


@pytest.mark.feature("debug-draw/line-canvas")
def test_lines_cover_the_pixels_that_are_less_than_half_their_width_away(stage, monkeypatch):
    def fill(canvas):
        canvas.lines([((-20, 3.5, 0), (10, 3.5, 0)), ((8.5, -12, 0), (8.5, -4, 0))], (0, 1, 1))

    view = View(pose_looking_at((0, 0, 5), (0, 0, 0)), Orthographic(28.0, 0.1, 10.0))  # a metre is a pixel
    for width, half in ((1.0, 0), (3.0, 1), (5.0, 2)):
        picture, _ = drawn(stage, monkeypatch, fill, view, width=width)
        covered = (picture == (0, 255, 255)).all(axis=-1)
        expected = np.zeros_like(covered)
        expected[24 - half : 25 + half, 12 - half : 42 + half] = True  # half a width beyond its ends
        expected[32 - half : 40 + half, 40 - half : 41 + half] = True
        # A centre that lies on a border may fall to either side.
        y, x = np.indices(covered.shape)
        ends = np.isin(x, [11 - half, 12 - half, 41 + half, 42 + half]) | np.isin(
            y, [31 - half, 32 - half, 39 + half, 40 + half]
        )
        assert (covered == expected)[~ends].all() and covered[~ends].sum() > 20


@pytest.mark.feature("debug-draw/line-canvas")
@pytest.mark.parametrize(("n1", "n2"), [(1, 1), (2, 5), (10, 10)])
def test_a_plane_is_its_outline_and_what_divides_it(n1, n2):
    canvas = Canvas()
    canvas.plane((1, 2, 3), (4, 0, 0), (0, 0, 6), n1, n2, (1, 1, 1), (1, 0, 0))
    assert canvas.count == 4 + (n1 - 1) + (n2 - 1)
    ends = canvas.ends["position"]
    assert (canvas.ends["color"][:4] == 0x0000FF).all() and (canvas.ends["color"][4:] == 0xFFFFFF).all()
    outline = {tuple(point) for point in ends[:4].reshape(-1, 3).tolist()}
    assert outline == {(-1, 2, 0), (3, 2, 0), (3, 2, 6), (-1, 2, 6)}
    first = ends[4 : 4 + n1 - 1].astype(np.float64)
    assert np.allclose(first[:, :, 0], (-1 + 4 * np.arange(1, n1) / n1)[:, None], atol=1e-6)
    assert (first[:, 0, 2] == 0).all() and (first[:, 1, 2] == 6).all()
    second = ends[4 + n1 - 1 :].astype(np.float64)
    assert np.allclose(second[:, :, 2], (6 * np.arange(1, n2) / n2)[:, None], atol=1e-6)


@pytest.mark.feature("debug-draw/line-canvas")
def test_lines_beyond_65536_are_dropped_and_reported(stage, monkeypatch):
    assert CAPACITY == 65_536 and VERTEX.itemsize == 16
    many = np.zeros((CAPACITY - 2, 2, 3))
    many[:, :, 2] = 50.0  # behind the camera: nothing of them is drawn
    wall = np.array([((-1, 0, 0), (1, 0, 0))] * 5, np.float64)

    def fill(canvas):
        canvas.lines(many, (1, 1, 1))
        canvas.lines(wall, (0, 1, 0))
        canvas.lines(wall, (1, 0, 0))

    picture, work = drawn(stage, monkeypatch, fill, size=(16, 14))
    assert (work["lines"], work["lines_dropped"]) == (CAPACITY, 8)
    colors = {tuple(color) for color in picture.reshape(-1, 3).tolist()}
    assert colors == {tuple(BACKGROUND), (0, 255, 0)}  # what came first is there, what came later is not


@pytest.mark.feature("debug-draw/line-canvas")
def test_an_empty_canvas_draws_nothing_and_a_line_from_behind_the_camera_is_cut(stage, monkeypatch):
    picture, work = drawn(stage, monkeypatch, lambda canvas: None, size=(16, 14))
    assert (work["draws"], work["lines"]) == (0, 0) and (picture == BACKGROUND).all()
    behind = VIEW.eye + VIEW.world_from_view[:3, :3] @ (0.3, -0.2, 1.0)
    for ends in ([(0, 0, 0), behind], [behind, (0, 0, 0)]):
        picture, _ = drawn(
            stage, monkeypatch, lambda canvas, ends=ends: canvas.lines(ends, (0, 1, 0)), width=7.0
        )
        covered = (picture == (0, 255, 0)).all(axis=-1)
        # It comes out of the middle and leaves the picture, as wide all the way.
        start, ahead = projected(np.array([(0.0, 0.0, 0.0), 0.5 * behind]))
        along = (ahead - start) / np.linalg.norm(ahead - start)
        y, x = np.indices(covered.shape) + 0.5
        way = (x - start[0]) * along[0] + (y - start[1]) * along[1]
        off = np.abs((x - start[0]) * along[1] - (y - start[1]) * along[0])
        assert covered[(way > -3.4) & (off < 3.45)].all() and covered.sum() > 200
        assert not covered[(way < -3.6) | (off > 3.55)].any()
