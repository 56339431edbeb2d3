"""A grey wall with grain: what is done beside what, and by how much each pixel is brighter or darker."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.scene import Material, Scene
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given
from tools.frames.overlap import overlaps

SIZE = (37, 21)
"""No multiple of a work group's."""
GREY, GRAIN = 0.3, 0.5
ALIKE = 0.15
"""Of 777 numbers drawn by lot, correlations are 0.04 or so."""


def check(given: Given) -> None:
    """Nothing without the setting; with it a pass beside the others, and noise that is another one in each frame."""
    given.settings(grain=GRAIN)
    wall = quad_scene(
        Material(unlit=True, base_color=(GREY, GREY, GREY, 1.0)), matrices=(np.diag([4.0, 4.0, 1.0, 1.0]),)
    )
    (plain,) = _drawn(given, wall, 0.0, 1)
    given.need(np.allclose(plain, GREY, rtol=0.02), "Without the setting the wall is not grey any more.")
    first, second, third, again = _drawn(given, wall, GRAIN, 4)
    noise = [(picture[..., 0] / plain[..., 0] - 1.0) / GRAIN for picture in (first, second, third)]
    for one, picture in zip(noise, (first, second, third), strict=True):
        given.need(np.ptp(picture, 2).max() < 0.02, "Grain has a colour, and it should be grey.")
        row, column = np.unravel_index(np.abs(one).argmax(), one.shape)
        given.need(
            np.abs(one).max() <= 1.03,
            f"At pixel ({column}, {row}) the light is {1.0 + GRAIN * one[row, column]:.2f} times what it was, and "
            f"grain={GRAIN} lets it be between {1.0 - GRAIN} and {1.0 + GRAIN}.",
        )
        given.need(
            abs(one.std() * np.sqrt(3.0) - 1.0) < 0.1 and abs(one.mean()) < 0.1,
            f"Noise of equal chances from -1 to 1 has the mean 0 and the deviation 0.577: here {one.mean():.2f} and "
            f"{one.std():.2f}.",
        )
        for what, a, b in (("row", one[:, 1:], one[:, :-1]), ("column", one[1:], one[:-1])):
            given.need(abs(_alike(a, b)) < ALIKE, f"Neighbours in a {what} have the same grain.")
    given.need(
        max(abs(_alike(noise[0], noise[1])), abs(_alike(noise[0], noise[2]))) < ALIKE,
        "Two frames have the same grain: what is recorded once and submitted again has to read its frame's number.",
    )
    given.need(
        np.array_equal(first, again),
        "Frame 0 has another grain after the history was reset: frames and pixels say which, and nothing else.",
    )


def _drawn(given: Given, scene: Scene, grain: float, frames: int) -> list[np.ndarray]:
    """Return linear pictures (H, W, 3) of some frames, of which the last of several is number 0 again."""
    with given.open(scene, SIZE, graph="deferred", grain=grain) as made:
        opened: Any = made
        _look(given, opened.graph, grain > 0)
        found = []
        for number in range(frames):
            if number == 3:
                opened.reset_history("the check begins anew")
            coded = np.asarray(opened.render(facing()).image("color"))[..., :3] / 255.0
            found.append(np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4))
    given.silent()
    return found


def _look(given: Given, graph: Any, wanted: bool) -> None:
    """Look where the pass is, and what it can run beside."""
    steps = {step.name: number for number, step in enumerate(graph.steps)}
    if not wanted:
        given.need(
            "grain" not in steps,
            "Without the setting the pass runs all the same: what does it say to `needed`?",
        )
        return
    given.need("grain" in steps, "With grain=0.5 no pass of the frame is called 'grain'.")
    step = graph.steps[steps["grain"]]
    given.need(
        step.kind == "compute" and step.queue == "compute",
        f"The pass runs on the queue for {step.queue}: it asks for none, or draws.",
    )
    beside = {graph.steps[other].name for other in overlaps(graph)[steps["grain"]].now}
    late = [name for name in ("gbuffer", "lighting") if name not in beside]
    given.need(
        not late,
        f"'{' and '.join(late)}' cannot run beside 'grain', since one waits for the other: what does grain read, and "
        "which pass reads grain?",
    )


def _alike(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.reshape(-1), b.reshape(-1))[0, 1])
