"""The validation layers, which watch layouts and hazards, have nothing to say; and the picture is what it was."""

from __future__ import annotations

from common.scene import Material
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Draw a few frames, so that both slots are used again, with and without the resolve pass."""
    scene = quad_scene(Material(unlit=True, base_color=(0.5, 0.5, 0.5, 1.0)))
    for samples in (1, 4):
        with given.open(scene, (32, 32), msaa=samples) as made:
            for _ in range(3):
                picture = made.render(facing()).image("color")
        said = given.complaints()
        given.need(
            not said,
            f"With msaa={samples} the layers have {len(said)} things to say about a frame: "
            "`strata run FOLDER --scene cornell --frames 3 --out a.png` shows them.",
        )
        given.need(abs(int(picture[16, 16, 0]) - 188) <= 1, "The picture is not the one that it was.")
