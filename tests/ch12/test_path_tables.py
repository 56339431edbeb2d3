"""The tables by which rays are sent towards light: what is drawn how often. No device."""

from __future__ import annotations

import numpy as np

from chapters.ch12.paths import model
from common.environment import Environment, constant
from common.environment.directions import (
    cube_solid_angles,
    cube_uv,
    panorama_direction,
    panorama_solid_angles,
)
from common.scene import Material
from tests.support.scenes import quad_scene
from tests.support.shadows import placed

LUMINANCE = np.array((0.2126, 0.7152, 0.0722))


def test_the_light_of_a_panorama_is_all_in_the_cells():
    for rows in (3, 40, 1030):
        pixels = np.random.default_rng(rows).exponential(size=(rows, 2 * rows))
        cells = model.cell_radiance(pixels, 16)
        assert cells.shape == (6, 16, 16)
        power = (pixels * panorama_solid_angles(rows)).sum()
        assert abs((cells * cube_solid_angles(16)).sum() / power - 1.0) < 0.01
        assert np.abs(model.cell_radiance(np.full((rows, 2 * rows), 3.0), 16) - 3.0).max() < 1e-9


def test_directions_are_drawn_by_their_light():
    """Even light: by solid angle. A small sun: most rays go to it and around it, a few anywhere."""
    size = model.CELLS
    even = model.environment_entries(constant(3.0, 64)).view(np.float32)[: 6 * size * size, 2]
    angles = np.tile(cube_solid_angles(size), (6, 1, 1)).reshape(-1) / (4 * np.pi)
    assert abs(even.sum() - 1.0) < 1e-5 and np.abs(even / angles - 1.0).max() < 1e-4
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[20, 37] = 1e4
    drawn = model.environment_entries(Environment("sun", pixels)).view(np.float32)[: 6 * size * size, 2]
    face, uv = cube_uv(panorama_direction(np.array((37.5 / 128, 20.5 / 64))))
    column, row = (uv * size).astype(int)
    near = drawn.reshape(6, size, size)[int(face), row - 3 : row + 4, column - 3 : column + 4]
    assert near.sum() > 0.95 and drawn.min() > 0.0
    assert not len(model.environment_entries(None))


def test_triangles_are_drawn_by_luminance_and_area():
    """Two lamps of different size and colour, one hidden, one that emits nothing, one that is unlit."""
    red, blue = Material(emissive=(4.0, 0.0, 0.0)), Material(emissive=(0.0, 0.0, 3.0))
    kinds = (red, blue, Material(), Material(emissive=(1.0, 1.0, 1.0), unlit=True))
    sizes = ((2.0, 1.0), (3.0, 2.0), (1.0, 1.0), (1.0, 1.0), (5.0, 5.0))
    squares = tuple(placed((0, 0, number), size, (0, 0, 1)) for number, size in enumerate(sizes))
    scene = quad_scene(materials=kinds, matrices=squares, instance_materials=(0, 1, 2, 3, 0))
    with scene.edit() as edit:
        edit.set_visible(4, False)
    triangles, weights, first = model.emissive_triangles(scene)
    assert triangles.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    wanted = np.repeat([4.0 * LUMINANCE[0] * 2.0, 3.0 * LUMINANCE[2] * 6.0], 2) / 2
    assert np.abs(weights - wanted).max() < 1e-5
    assert first.tolist() == [0, 2, *(model.NO_LIGHT,) * 3]
    tables = model.tables(scene, model.NOTHING)
    entries = tables.words[: tables.emitters].view(np.float32)[:4, 2]
    assert np.abs(entries - wanted / wanted.sum()).max() < 1e-6
    assert tables.words[tables.triangles : tables.triangles + 4, :2].tolist() == triangles.tolist()
    assert tables.words[tables.instances :].reshape(-1)[:5].tolist() == first.tolist()
    smaller = model.tables(scene, model.NOTHING, tables.words.nbytes - 1)
    assert smaller.emitters == 0 and (smaller.words == model.NO_LIGHT).all()
