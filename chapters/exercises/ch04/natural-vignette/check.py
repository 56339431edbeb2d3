"""A white wall through the pass: what is left of its light at each pixel, by the angle at which it is seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Material, Scene
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import quad_scene
from tools.exercises.checking import Given

SIZE = (24, 16)
YFOV = 1.2
POSE = pose_looking_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
WIDE = View(POSE, Perspective(YFOV, 0.1))
PARALLEL = View(POSE, Orthographic(1.0, 0.1, 4.0))


def check(given: Given) -> None:
    """The fourth power of the cosine, nothing without the setting, and nothing where all rays are parallel."""
    wall = quad_scene(Material(unlit=True), matrices=(np.diag([4.0, 4.0, 1.0, 1.0]),))
    given.settings(vignette=True)
    plain, steps = _drawn(given, wall, WIDE, False)
    given.need(
        "vignette" not in steps,
        "Without the setting the pass runs all the same: what does it say to `needed`?",
    )
    given.need(np.allclose(plain, 1.0, atol=1e-4), "Without the setting the wall is not white any more.")
    seen, steps = _drawn(given, wall, WIDE, True)
    given.need("vignette" in steps, "With vignette=True no pass of the frame is called 'vignette'.")
    behind = steps.index("vignette") > steps.index("lighting") and steps.index("vignette") < steps.index(
        "tonemap"
    )
    given.need(behind, f"The pass runs at the wrong place: {', '.join(steps)}.")
    wanted = _fourth_power(SIZE)
    row, column = np.unravel_index(np.abs(seen[..., 0] - wanted).argmax(), wanted.shape)
    given.need(
        np.allclose(seen, wanted[..., None], atol=2e-3),
        f"At pixel ({column}, {row}) {seen[row, column, 0]:.3f} of the light is left, and it should be "
        f"{wanted[row, column]:.3f}.",
    )
    parallel, _ = _drawn(given, wall, PARALLEL, True)
    given.need(
        np.allclose(parallel, 1.0, atol=2e-3),
        "An orthographic view has parallel rays: nothing gets darker there.",
    )
    blurred, steps = _drawn(given, wall, WIDE, True, aperture=2.0)
    given.need(
        steps.index("vignette") > steps.index("depth_of_field"),
        "With a lens, the pass has to come behind it.",
    )
    given.need(np.allclose(blurred, seen, atol=5e-3), "A wall that is in focus is another one with a lens.")


def _drawn(given: Given, scene: Scene, view: View, on: bool, **knobs: Any) -> tuple[np.ndarray, list[str]]:
    """Return linear light (H, W, 3), and the steps of the frame in their order."""
    with given.open(scene, SIZE, ("color", "color_linear"), graph="deferred", vignette=on, **knobs) as made:
        opened: Any = made
        picture = made.render(view).image("color_linear")
        steps = [step.name for step in opened.graph.steps]
    given.silent()
    return picture, steps


def _fourth_power(size: tuple[int, int]) -> np.ndarray:
    """Return (H, W): the fourth power of the cosine between each pixel's ray and the axis."""
    width, height = size
    y = (1.0 - (np.arange(height) + 0.5) / height * 2.0) * np.tan(YFOV / 2)
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) * np.tan(YFOV / 2) * width / height
    return (1.0 + x[None, :] ** 2 + y[:, None] ** 2) ** -2.0
