"""The factors of a ground under a cube against its whole map, put together by the table, in double precision."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, View
from tests.support.shadows import faces_of, read_face, sun, yard
from tools.exercises.checking import Given

SIZE, HALF = (96, 96), 3.0
VIEW = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(HALF, 0.1, 20.0))
DIRECTION = (0.5, -1.0, 0.3)
KERNEL = 5
HIGHER = 0.1
"""How much nearer to the sun a caster is than the ground, at least: the cube hovers higher, the bias is smaller."""


def check(given: Given) -> None:
    """A map of 4x4 tiles, a kernel of 5x5 texels."""
    scene = yard(
        sun(DIRECTION), sun((0.0, -1.0, 0.0), lux=1e-6)
    )  # the other one has tiles, and no light to speak of
    with given.open(
        scene,
        SIZE,
        ("color_linear",),
        view="shadow-factor",
        graph="forward",
        shadow_kernel=KERNEL,
        shadow_sun_size=512,
        shadow_cascades=1,
        ambient=0.0,
    ) as renderer:
        factors = renderer.render(VIEW).image("color_linear")[..., 0].astype(np.float64)
        face, depths = faces_of(renderer)[0], read_face(renderer, 0).astype(np.float64)
        origin = np.array(scene.origin)
    given.silent()
    at, wanted = _wanted(face, depths, origin)
    x = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 * HALF - HALF
    beside = np.maximum(abs(x[:, None]), abs(x[None, :])) > 0.55  # the cube hides the ground below it
    sure = (np.abs(at - np.round(at)) > 0.02).all(axis=-1) & beside
    wrong = sure & (np.abs(factors - wanted) > 0.5 / KERNEL**2)
    for row, column in np.argwhere(wrong)[:1].tolist():
        taps = KERNEL**2
        crossed = (
            np.floor(at[row, column] - KERNEL // 2) // 128 != np.floor(at[row, column] + KERNEL // 2) // 128
        ).any()
        given.need(
            False,
            f"{wrong.sum()} pixels have a wrong factor. The kernel of pixel ({column}, {row}) lies "
            f"{'over the edge of a tile' if crossed else 'in one tile'}: {wanted[row, column] * taps:.0f} of its "
            f"{taps} texels are lit, and in the picture {factors[row, column] * taps:.0f}.",
        )


def _wanted(face: np.ndarray, depths: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (H, W, 2) places in the map and (H, W) factors of the ground."""
    axes = np.stack([face[name] for name in ("right", "down", "ahead")]).astype(np.float64)
    scale, half = np.array([face["scale_x"], face["scale_y"]], np.float64), float(face["size"]) / 2
    start = face["origin"].astype(np.float64) + origin
    x = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 * HALF - HALF
    ground = np.stack(np.broadcast_arrays(x[None, :], 0.0, x[:, None]), -1)
    at = (ground - start) @ axes[:2].T * scale + half
    middle = np.floor(at).astype(int)
    lit = np.zeros(at.shape[:2])
    for dy in range(-(KERNEL // 2), KERNEL // 2 + 1):
        for dx in range(-(KERNEL // 2), KERNEL // 2 + 1):
            texel = middle + np.array((dx, dy))
            across = ((texel + 0.5 - half) / scale) @ axes[:2] + start
            plane = -across[..., 1] / axes[2, 1]  # how far along its axis the ground is there
            lit += depths[texel[..., 1], texel[..., 0]] >= plane - HIGHER
    return at, lit / KERNEL**2
