"""Ten and a thousand squares in ten materials, drawn by chapters 1 and 2: counters, and the processor's time."""

from __future__ import annotations

import numpy as np

from common.scene import Image, Material, Scene
from tests.support.scenes import facing, quad_scene, texture
from tools.exercises import Answer
from tools.exercises.checking import Given

MATERIALS, FRAMES = 10, 12


def measure(given: Given) -> dict[str, Answer]:
    """Draw both scenes with both chapters."""
    found = {
        (number, count): _drawn(Given(number, given.backend, given.device), count)
        for number in (1, 2)
        for count in (10, 1000)
    }
    given.silent()
    works = {key: work for key, (work, _) in found.items()}

    def slower(number: int) -> str:
        ratio = found[number, 1000][1] / found[number, 10][1]
        return "four times as long or more" if ratio >= 4 else "less than four times as long"

    return {
        "calls_1": works[1, 1000]["draws"],
        "calls_2": works[2, 1000]["draw_calls"],
        "binds_1": works[1, 1000]["descriptor_binds"],
        "more_binds_2": works[2, 1000]["descriptor_binds"] - works[2, 10]["descriptor_binds"],
        "time_1": slower(1),
        "time_2": slower(2),
    }


def _drawn(given: Given, count: int) -> tuple[dict[str, int], float]:
    """Return a frame's counters, and the least time in ms that the processor spent on one."""
    with given.open(_scene(count), (16, 16)) as made:
        for _ in range(3):
            made.render(facing()).image("color")
        times = []
        for _ in range(FRAMES):
            frame = made.render(facing())
            times.append(frame.cpu_ms)
            frame.image("color")  # waits, so that the next frame finds its slot free
    return frame.work, min(times)


def _scene(count: int) -> Scene:
    rng = np.random.default_rng(1)
    places = np.tile(np.diag([0.02, 0.02, 1.0, 1.0]), (count, 1, 1))
    places[:, :3, 3] = rng.uniform(-0.9, 0.9, (count, 3)) * (1, 1, 0.1)
    images = tuple(Image(f"texels {n}", np.full((2, 2, 4), 20 * n + 50, np.uint8)) for n in range(MATERIALS))
    materials = tuple(Material(unlit=True, base_color_texture=texture(n)) for n in range(MATERIALS))
    chosen = tuple(n % MATERIALS for n in range(count))
    return quad_scene(matrices=tuple(places), images=images, materials=materials, instance_materials=chosen)
