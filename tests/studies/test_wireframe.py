"""The study wireframe against distances to projected edges in double precision."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch01.studies.wireframe import EDGE, FACE, Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.scene.primitive import scene_of
from common.view.camera import Perspective, View
from tests.support import gl_functions, gpu_functions
from tests.support.bounds import codes_off

INCLUDE = "../chapters/ch01/studies/wireframe/edge.glsl"
SIZE = (64, 56)
YFOV = math.radians(40.0)
VIEW = View(pose_looking_at((1.3, 1.1, 2.2), (0.0, 0.0, 0.0)), Perspective(YFOV, 0.05))
BACKGROUND = np.array([0.05, 0.05, 0.06])


def solid(positions, triangles):
    """Return a scene of one mesh."""
    positions = np.array(positions, np.float64)
    return scene_of("solid", positions, positions, positions[:, :2], np.ravel(triangles), Material(), [])


CORNERS = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) * 0.55
FACES = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])


def projected(points: np.ndarray) -> np.ndarray:
    """Return (N, 2) pixels, row 0 on top, of points (N, 3) in the world."""
    seen = (np.asarray(points, np.float64) - VIEW.eye) @ VIEW.world_from_view[:3, :3]
    scale = SIZE[1] / 2 / math.tan(YFOV / 2)
    return seen[:, :2] / -seen[:, 2:] * scale * (1, -1) + np.array(SIZE) / 2


def distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return (H, W) signed pixels from the line through a and b to the pixels' centres."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    d = b - a
    return (d[0] * (y - a[1]) - d[1] * (x - a[0])) / np.hypot(*d)


@pytest.mark.feature("debug-draw/wireframe")
def test_the_factor_is_the_distance_to_the_nearest_edge(stage):
    rng = np.random.default_rng(1)
    weights = rng.dirichlet((0.6, 0.6, 0.6), 400)
    weights[:9] = [(0, 0.5, 0.5), (1, 0, 0), (1 / 3, 1 / 3, 1 / 3)] * 3
    along_x, along_y = rng.uniform(-0.1, 0.1, (2, 400, 3))
    thickness = rng.uniform(0.5, 6.0, 400)
    inputs = {"w": weights, "dx": along_x, "dy": along_y, "t": thickness}
    inputs = {name: values.astype(np.float32) for name, values in inputs.items()}
    evaluate = gpu_functions.evaluate if stage.backend == "vulkan" else gl_functions.evaluate
    got = evaluate(stage.device, [INCLUDE], "f = edge_factor(w, dx, dy, t);", inputs, {"f": "float"})["f"]
    w, dx, dy, t = (values.astype(np.float64) for values in inputs.values())
    truth = np.clip((w / np.hypot(dx, dy)).min(axis=1) / t, 0, 1)
    assert np.abs(got - truth).max() < 1e-5
    assert (got[weights.min(axis=1) == 0] == 0).all() and 0.02 < (got == 1).mean() < 0.98


@pytest.mark.feature("debug-draw/wireframe")
@pytest.mark.parametrize("thickness", [1.5, 6.0])
def test_a_tilted_triangle_shows_the_distance_in_pixels_to_its_edges(stage, thickness):
    corners = np.array([(-0.8, -0.5, 0.6), (0.9, -0.4, -0.7), (0.1, 0.8, 0.2)])
    picture = stage.draw(
        "wireframe",
        SIZE,
        0.0,
        VIEW,
        scene=solid(corners, (0, 1, 2)),
        settings=Settings(way="barycentric", thickness=thickness),
    )["color"]
    a, b, c = projected(corners)
    inward = np.stack([distances(a, b), distances(b, c), distances(c, a)])
    centroid = (a + b + c) / 3
    inward *= np.sign(inward[0, int(centroid[1]), int(centroid[0])])
    nearest = inward.min(axis=0)
    factor = np.clip(nearest / thickness, 0, 1)[..., None]
    shown = np.where(
        nearest[..., None] > 0, np.array(EDGE) * (1 - factor) + np.array(FACE) * factor, BACKGROUND
    )
    sure = np.abs(nearest) > 0.02  # corners lie on a grid of 1/256 pixel
    assert (nearest > thickness).sum() > 100
    # The same grid moves an edge, by less than 1/256 pixel at each end.
    assert np.abs(picture / 255 - shown)[sure].max() < codes_off(stage.device) / 255 + 0.006 / thickness


@pytest.mark.feature("debug-draw/wireframe")
@pytest.mark.parametrize("time", [0.0, 2.0, 5.0, 9.0])
def test_no_face_pixel_hides_a_visible_edge(stage, time):
    if not stage.device.has("wireframe"):
        pytest.skip("the device has no lines in place of filled triangles")
    hidden = hidden_pixels(stage, time, Settings(way="line"))
    assert hidden == 0
    # And that is the offset's doing: with faces left where they are, half of an edge may be gone.
    if time == 2.0:
        assert hidden_pixels(stage, time, Settings(way="line", push_back=0.0)) > 0


def hidden_pixels(stage, time: float, settings: Settings) -> int:
    """Return how many pixels, of those that visible edges of a tetrahedron go through, show another colour."""
    picture = stage.draw("wireframe", SIZE, time, VIEW, scene=solid(CORNERS, FACES), settings=settings)[
        "color"
    ]
    angle = 0.3 * time
    turn = np.array(
        [(math.cos(angle), 0, math.sin(angle)), (0, 1, 0), (-math.sin(angle), 0, math.cos(angle))]
    )
    world = CORNERS @ turn.T
    normals = [np.cross(world[b] - world[a], world[c] - world[a]) for a, b, c in FACES]
    outward = [n * np.sign(n @ world[face[0]]) for n, face in zip(normals, FACES, strict=True)]
    front = [n @ (VIEW.eye - world[face[0]]) > 0 for n, face in zip(outward, FACES, strict=True)]
    assert 1 <= sum(front) <= 3
    visible = {
        tuple(sorted(edge))
        for seen, (a, b, c) in zip(front, FACES, strict=True)
        for edge in ((a, b), (b, c), (c, a))
        if seen
    }
    places, wrong, checked = projected(world), 0, 0
    for one, other in visible:
        a, b = places[one], places[other]
        major = int(abs(b[1] - a[1]) > abs(b[0] - a[0]))
        first, last = sorted((a[major], b[major]))
        # Between the corners, at each centre along the longer axis, the line passes through one pixel of the other.
        for k in range(math.ceil(first + 1), math.floor(last - 1)):
            at = a + (b - a) * (k + 0.5 - a[major]) / (b[major] - a[major])
            if abs(at[1 - major] % 1 - 0.5) > 0.45:
                continue  # between two pixels: either may be taken
            row, column = int(at[1]), int(at[0])
            wrong += int(np.abs(picture[row, column] / 255 - EDGE).max() > 0.01)
            checked += 1
    assert checked > 30
    return wrong


def test_without_the_feature_edges_come_from_barycentric_coordinates(stage):
    scene = solid(CORNERS, FACES)
    both = [
        stage.draw(
            "wireframe", (24, 24), 0.0, VIEW, scene=scene, settings=Settings(way=way), without=without
        )["color"]
        for way, without in (("line", ("wireframe",)), ("line", ("all",)), ("barycentric", ()))
    ]
    assert (both[0] == both[2]).all() and (both[1] == both[2]).all()
    with stage.open(
        "wireframe", (24, 24), scene, settings=Settings(way="line"), without=("all",)
    ) as renderer:
        assert not renderer.plan.native("wireframe")
        assert renderer.render(VIEW).work["draws"] == 1


def test_lines_of_both_backends_differ_in_few_pixels_beside_an_edge(vulkan_device, gl_context):
    if not (vulkan_device.has("wireframe") and gl_context.has("wireframe")):
        pytest.skip("a device has no lines in place of filled triangles")
    from tests.studies.conftest import Opener

    settings, scene = Settings(way="line"), solid(CORNERS, FACES)
    one, other = (
        Opener(backend, device).draw("wireframe", SIZE, 0.0, VIEW, scene=scene, settings=settings)["color"]
        for backend, device in (("vulkan", vulkan_device), ("gl", gl_context))
    )
    rows, columns = np.nonzero(np.abs(one.astype(int) - other).max(axis=-1) > 1)
    # Drivers may choose what a line of one pixel covers: a thin rectangle, or Bresenham's pixels.
    ends = projected(CORNERS)
    pairs = [(a, b) for a in range(4) for b in range(a)]
    nearest = np.min([np.abs(distances(ends[a], ends[b])) for a, b in pairs], axis=0)
    assert (nearest[rows, columns] < 1).all()
    edges = (np.abs(one / 255 - EDGE).max(axis=-1) < 0.01).sum()
    assert len(rows) < 0.2 * edges
