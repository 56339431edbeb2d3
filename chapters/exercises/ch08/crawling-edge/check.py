"""Cascades along a walk: their scale, their places in texels, and the slices that they have to contain."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tools.exercises.checking import Given

BOX = np.array([(-20.0, 0.0, -30.0), (20.0, 12.0, 30.0)])
ASPECT, YFOV, CASCADES, SIZE, GUARD = 16 / 9, 1.0, 3, 512, 2
STEPS = 60


def check(given: Given) -> None:
    """A camera walks and turns below two suns. The middles of maps, from texel to texel."""
    cascades: Any = given.module("shadows.cascades")
    suns = np.array([(0.3, -1.0, 0.2), (-0.7, -0.4, 0.6)])
    suns /= np.linalg.norm(suns, axis=1)[:, None]
    random = np.random.default_rng(11)
    ends = cascades.splits(0.05, float(np.linalg.norm(BOX[1] - BOX[0])), CASCADES)
    first = None
    for step in range(STEPS):
        eye = np.array((-6.0, 1.7, 12.0)) + step * np.array((0.113, 0.004, -0.271))
        view = View(
            pose_looking_at(eye, eye + random.normal(size=3), (0.1, 1.0, 0.0)), Perspective(YFOV, 0.05)
        )
        faces = cascades.directional_faces(suns, BOX, view, np.zeros(3), ASPECT, CASCADES, SIZE, GUARD)
        first = faces if first is None else first
        for number, face in enumerate(faces):
            sun, cascade = divmod(number, CASCADES)
            where = f"Step {step}, sun {sun}, cascade {cascade}"
            axes = np.stack([face["right"], face["down"]]).astype(np.float64)
            scale = np.array([face["scale_x"], face["scale_y"]], np.float64)
            given.need(
                (scale == (first[number]["scale_x"], first[number]["scale_y"])).all(),
                f"{where}: the map has {scale[0]:.4f} texels a metre, and in the first frame it had "
                f"{first[number]['scale_x']:.4f}.",
            )
            if cascade == CASCADES - 1:
                continue
            middle = axes @ face["origin"].astype(np.float64)
            texels = middle * scale
            given.need(
                np.allclose(texels, np.round(texels), atol=4e-3),  # float32 of a few hundred texels
                f"{where}: the middle of the map is at texel ({texels[0]:.2f}, {texels[1]:.2f}) of the world, "
                "which is no whole one.",
            )
            at = (_corners(view, ends[cascade], ends[cascade + 1]) @ axes.T - middle) * scale
            given.need(
                np.abs(at).max() <= SIZE / 2 - GUARD + 1,
                f"{where}: a corner of the slice from {ends[cascade]:.1f} m to {ends[cascade + 1]:.1f} m lies "
                f"{np.abs(at).max():.0f} texels from the middle, beyond the edge of the map.",
            )


def _corners(view: View, begin: float, end: float) -> np.ndarray:
    """Return the (8, 3) corners of a slice of a view."""
    up = np.tan(YFOV / 2)
    ends = [
        (sx * up * ASPECT * d, sy * up * d, -d, 1.0) for d in (begin, end) for sx in (-1, 1) for sy in (-1, 1)
    ]
    corners: np.ndarray = (np.array(ends) @ view.world_from_view.T)[:, :3]
    return corners
