"""Meshlets of shapes from many eyes: none that has a front is lost, and what the cone proves is found."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.scene import Scene
from tests.support.towns import ball, grid, of_shapes
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """A ball, a wavy square and a stretched ball; eyes around and inside of them; broken records."""
    function: Any = getattr(given.module("meshlets.facing"), "may_face", None)
    given.need(callable(function), "meshlets/facing.py has no function may_face yet.")
    scene = _scene()
    built: Any = given.module("meshlets.build").build_meshlets(scene)
    packing: Any = given.module("meshlets.packing")
    records = built.records
    axes, cutoffs = packing.unpack_cones(records["cone"])
    triangles, of = _triangles(scene, built, packing)
    for eye in np.random.default_rng(9).normal(size=(60, 3)) * np.linspace(0.2, 8.0, 60)[:, None]:
        answer = np.asarray(function(records, eye))
        given.need(
            answer.shape == records.shape and answer.dtype == bool,
            f"The result should be ({len(records)},) bool, and is {answer.shape} {answer.dtype}.",
        )
        fronts = _fronts(triangles, eye)
        seen = np.bincount(of[fronts], minlength=len(records)) > 0
        lost = np.flatnonzero(seen & ~answer)
        given.need(
            not len(lost),
            f"From {np.round(eye, 2).tolist()} a triangle of meshlet {lost[0] if len(lost) else 0} is seen from its "
            "front, and the result is False.",
        )
        to = records["centre"].astype(np.float64) - eye
        distance = np.linalg.norm(to, axis=1)
        proof = (to * axes).sum(axis=1) - cutoffs * distance - records["radius"]
        sure = (proof > 1e-6) & (records["cone"] >> 24 != 127)
        given.need(
            not (answer & sure).any(),
            f"From {np.round(eye, 2).tolist()} a cone proves that its meshlet faces away, and the result is True.",
        )
        unsure = (proof < -1e-6) | (records["cone"] >> 24 == 127)
        given.need(
            answer[unsure].all(),
            f"From {np.round(eye, 2).tolist()} the bytes of a cone prove nothing, and the result is False.",
        )
    broken = records[:3].copy()
    broken["cone"][0] = 127 << 24
    broken["radius"][1] = np.nan
    broken["centre"][2] = np.nan
    given.need(
        np.asarray(function(broken, (0.0, 0.0, 100.0))).all()
        and np.asarray(function(broken, (0.0, 0.0, -100.0))).all(),
        "A meshlet without a cone, or with NaN in its bounds, may face any eye.",
    )


def _scene() -> Scene:
    places, triangles = ball(16, 24)
    long = (places * np.array((1.0, 3.0, 0.6), np.float32), triangles)
    return of_shapes(
        [(places, triangles), grid(24), long], [0, 0, 0], np.arange(3), np.tile(np.eye(4), (3, 1, 1))
    )


def _triangles(scene: Scene, built: Any, packing: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return all triangles (T, 3, 3) in float64, and the meshlet of each."""
    corners = packing.unpack_words(built.records, built.words).astype(np.int64).reshape(-1, 3)
    counts = packing.unpack_counts(built.records["counts"])[1]
    of = np.repeat(np.arange(len(counts)), counts)
    first = scene.meshes["first_vertex"][built.records["mesh"][of]].astype(np.int64)
    return scene.positions[corners + first[:, None]].astype(np.float64), of


def _fronts(triangles: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return (T,) whether the eye is in front of a triangle."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    fronts: np.ndarray = ((eye - triangles[:, 0]) * normals).sum(axis=1) > 1e-9
    return fronts
