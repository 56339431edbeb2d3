"""A turned square with one and with four samples a pixel; times are those of the record that is kept of the chapter."""

from __future__ import annotations

import json
import math

import numpy as np

from common.numerics.transforms import rotation
from common.paths import ROOT
from common.scene import Material
from tests.support.scenes import facing, quad_scene
from tools.exercises import Answer
from tools.exercises.checking import Given

RECORD = ROOT / "docs" / "benchmarks" / "ch01-software.json"


def measure(given: Given) -> dict[str, Answer]:
    """Draw it both ways and count."""
    matrix = rotation((0, 0, 1), math.radians(30)) @ np.diag([40 / 64, 40 / 64, 1, 1])
    scene = quad_scene(Material(unlit=True), matrices=(matrix,))
    pictures, works = [], []
    for samples in (1, 4):
        with given.open(scene, (64, 64), ("color", "color_linear"), msaa=samples) as made:
            frame = made.render(facing())
            pictures.append(frame.image("color_linear")[..., 0])
            works.append(frame.work)
    given.silent()
    one, four = pictures
    return {
        "passes": works[1]["passes"],
        "more_draws": works[1]["draws"] - works[0]["draws"],
        "greys": len(np.unique(np.round(four, 4))),
        "changed": int((np.abs(four - one) > 1e-3).sum()),
        "time": _time(),
    }


def _time() -> str:
    points = {point["name"]: point["gpu_ms"] for point in json.loads(RECORD.read_text("utf-8"))["points"]}
    ratio = points["msaa=4"] / points["medium"]
    if ratio < 1.25:
        return "about as long"
    return "half as long again, up to twice" if ratio < 2 else "about four times as long"
