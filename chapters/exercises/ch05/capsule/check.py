"""Cloths whose particles begin inside of capsules: after a step they lie on the surface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.cloths import run, sheet
from tools.exercises.checking import Given

SKIN = 0.01
TOLERANCE = 1e-5


def check(given: Given) -> None:
    """Around the middle, around both ends, on the axis, outside; with a capsule that lies, is turned, moved, scaled."""
    layout = given.module("cloth.layout")
    given.need("capsule" in layout.SHAPES, "SHAPES in cloth/layout.py has no capsule yet.")
    given.need(
        layout.SHAPES[:3] == ("sphere", "plane", "box"), "The numbers of the shapes before it are other ones."
    )
    rng = np.random.default_rng(5)
    upright, tilted, other = np.eye(4), np.eye(4), np.eye(4)
    upright[0, 3], other[0, 3] = -3.0, 3.0
    tilted[:3, :3] = 1.5 * np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tilted[:3, 3] = (0.4, -0.3, 0.2)
    pieces = [
        _Piece(given, what, world, half, _local(half, rng))
        for what, world, half in (
            ("an upright capsule", upright, 0.5),
            ("a capsule that is turned, moved and scaled", tilted, 0.5),
            ("a capsule of no length, which is a sphere", other, 0.0),
        )
    ]
    points = np.concatenate([piece.world for piece in pieces])
    after = _moved(given, points, [piece.collider for piece in pieces])
    for piece, part in zip(pieces, np.split(after, len(pieces)), strict=True):
        piece.hold(part)


def _local(half: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return points (4, 3) in the axes of a capsule of radius 0.25, by where they are."""
    flat = rng.normal(size=(4, 3)) * (1, 0, 1)
    flat *= 0.15 / np.linalg.norm(flat, axis=1, keepdims=True)
    along = np.array([[0, y, 0] for y in (-0.8, -0.2, 0.3, 0.9)]) * half
    cap = rng.normal(size=(4, 3))
    cap *= 0.2 / np.linalg.norm(cap, axis=1, keepdims=True)
    cap[:, 1] = abs(cap[:, 1])
    end = np.array([0.0, half, 0.0])
    return {
        "beside its axis": flat + along,
        "in its upper end": cap + end,
        "in its lower end": -cap - end,
        "on its axis": along,
        "outside of it": np.concatenate([(flat + along)[:2] * (2.5, 1, 2.5), 2.0 * cap[2:] + 1.2 * end]),
    }


class _Piece:
    """A capsule, and the points that begin about it: `world` (N, 3)."""

    def __init__(
        self, given: Given, what: str, matrix: np.ndarray, half: float, local: dict[str, np.ndarray]
    ) -> None:
        self._given, self._what, self._matrix, self._half, self._local = given, what, matrix, half, local
        collider = given.module("cloth.types").Collider
        self.collider = collider("capsule", matrix, radius=0.25, half=(0.0, half, 0.0))
        self.world = np.concatenate(list(local.values())) @ matrix[:3, :3].T + matrix[:3, 3]

    def hold(self, world: np.ndarray) -> None:
        """Look where the points are after a step, by how they began."""
        need, half = self._given.need, self._half
        scale = float(np.linalg.norm(self._matrix[:3, 0]))
        after = (world - self._matrix[:3, 3]) @ self._matrix[:3, :3] / scale**2
        for ends, (where, begins) in zip(np.split(after, len(self._local)), self._local.items(), strict=True):
            said = f"What begins {where} ({self._what})"
            need(np.isfinite(ends).all(), f"{said} ends where no number is.")
            wanted = np.maximum(_distance(begins, half) * scale, 0.25 * scale + SKIN)
            found = _distance(ends, half) * scale
            worst = int(np.abs(found - wanted).argmax())
            need(
                abs(found[worst] - wanted[worst]) < TOLERANCE,
                f"{said} ends {found[worst]:.4f} m from the middle line, and it should be {wanted[worst]:.4f} m.",
            )
            if where != "on its axis":  # there each way out is as good as any
                off = np.linalg.norm(ends - _pushed(begins, ends, half), axis=1).max()
                need(off * scale < TOLERANCE, f"{said} is not put out along the shortest way.")


def _moved(given: Given, points: np.ndarray, colliders: list[Any]) -> np.ndarray:
    """Let a cloth begin at all points, without weight and with its springs at rest; return where it is after a step."""
    types = given.module("cloth.types")
    made = sheet(given.module("cloth.build").build_cloth, 5, len(points) // 5, pins=[])
    rest = np.linalg.norm(points[made.springs[:, 0]] - points[made.springs[:, 1]], axis=1)
    made = replace(
        made,
        anchor=np.zeros(3),
        positions=points,
        rest=rest,
        stiffness=np.full(3, 1e-3),
        thickness=SKIN,
        friction=0.0,
    )
    steps, still = types.Steps(substeps=1), types.Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)
    return _on_gpu(given, made, steps, still, colliders).astype(np.float64)


def _nearest(points: np.ndarray, half: float) -> np.ndarray:
    """Return (N, 3) the points of the middle line that are nearest."""
    return points.clip((0.0, -half, 0.0), (0.0, half, 0.0))


def _distance(points: np.ndarray, half: float) -> np.ndarray:
    """Return (N,) how far points are from the middle line."""
    return np.linalg.norm(points - _nearest(points, half), axis=1)


def _pushed(begins: np.ndarray, ends: np.ndarray, half: float) -> np.ndarray:
    """Return (N, 3) points as far from the middle line as `ends`, each straight out from where it began."""
    away = begins - _nearest(begins, half)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return _nearest(begins, half) + away * _distance(ends, half)[:, None]


def _on_gpu(given: Given, made: Any, steps: Any, forces: Any, colliders: list[Any]) -> np.ndarray:
    """Return the positions (P, 3) after a step of the kernels."""
    layout, jobs = given.module("cloth.layout"), given.module("cloth.dispatches")
    packed = layout.pack([made], colliders=len(colliders))
    arrays = jobs.frame_arrays(packed, steps, forces, jobs.Moment.still(1, begin=True), colliders)
    shaders = Path(given.module("pipelines.vulkan").CHAPTER)
    found = run(shaders, given.device, packed, jobs.dispatches(packed, steps, 1, "dispatch"), arrays)
    given.silent()
    return found["positions"].reshape(-1, 3)
