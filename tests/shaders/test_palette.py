"""The colours of `shaders/palette.glsl` against `common/images/palette.py`, and that against closed forms."""

from __future__ import annotations

import numpy as np

from common.images import palette
from tests.support.gpu_functions import evaluate

IDS = np.concatenate(
    [np.arange(300), 2**32 - 1 - np.arange(300), np.random.default_rng(1).integers(0, 2**32, 400)]
).astype(np.uint32)


def test_heat_goes_from_black_over_blue_green_and_red_to_white(vulkan_device):
    t = np.linspace(-0.2, 1.2, 141, dtype=np.float32)
    got = evaluate(vulkan_device, ["palette.glsl"], "color = heat(t);", {"t": t}, {"color": "vec3"})["color"]
    assert np.abs(got - palette.heat(t)).max() < 1e-6
    assert np.array_equal(palette.heat(np.arange(7) / 6), palette.HEAT)
    assert np.allclose(palette.heat(1 / 12), (0, 0, 0.5))
    ends = palette.heat([-1.0, 2.0])
    assert np.array_equal(ends, [(0, 0, 0), (1, 1, 1)])


def test_colors_of_ids_are_the_same_on_cpu_and_gpu(vulkan_device):
    body = "color = id_color(id); part = part_id(id, 7u); bits = scrambled(id);"
    outputs = {"color": "vec3", "part": "uint", "bits": "uint"}
    got = evaluate(vulkan_device, ["palette.glsl"], body, {"id": IDS}, outputs)
    assert np.array_equal(got["bits"], palette.scrambled(IDS))
    assert np.array_equal(got["part"], palette.part_id(IDS, 7))
    assert np.abs(got["color"] - palette.id_color(IDS)).max() < 1e-5


def test_the_hash_is_that_of_its_authors_formula():
    """Jarzynski and Olano, written out with Python's whole numbers."""
    for value in (0, 1, 12345, 2**32 - 1):
        state = (value * 747796405 + 2891336453) % 2**32
        word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) % 2**32
        assert palette.scrambled(value) == (word >> 22) ^ word


def test_colors_of_ids_are_bright_and_seldom_meet():
    colors = palette.id_color(np.arange(1000))
    assert colors.min() >= 0 and colors.max() <= 1 and colors.max(axis=-1).min() >= 0.6
    assert len(np.unique(np.round(colors * 255), axis=0)) > 990
    assert np.abs(np.diff(colors, axis=0)).max(axis=-1).min() > 0.005  # neighbours can be told apart
