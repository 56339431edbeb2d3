"""Bytes of the G-buffer's formats, scenes that emit, and what the formats of normals lose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from common.scene import Material
from tests.support.scenes import quad_scene
from tools.exercises import Answer
from tools.exercises.checking import Given

BYTES = {"rgba8": 4, "rgba8_srgb": 4, "rgb10a2": 4, "r32ui": 4, "rgba16f": 8, "rgba32f": 16}
ERRORS = {"0.004": 0.004, "0.1": 0.1, "0.5": 0.5, "2": 2.0}
"""Degrees to choose from."""


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its formats, and round a million normals as two of them do."""
    deferred: Any = given.module("shading.deferred")
    sizes = {name: [BYTES[format] for format in formats] for name, formats in deferred.FORMATS.items()}
    plain = {name: sum(found[:3]) for name, found in sizes.items()}
    settings = given.settings()

    def has_emission(material: Material) -> str:
        return "yes" if deferred.emits(quad_scene(material), settings) else "no"

    glass = Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend")
    normals = np.random.default_rng(5).normal(size=(1_000_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    codes = np.rint(_to_square(normals) * 32767)
    up = np.rint(_to_square(np.array([[0.0, 0.0, 1.0]])) * 32767).astype(np.int64)[0]
    return {
        "octahedral": plain["octahedral"],
        "glowing": sum(sizes["octahedral"]),
        "half": plain["half"],
        "full": sum(sizes["full"]),
        "megabytes": plain["octahedral"] * 1920 * 1080 / 2**20,
        "unlit": has_emission(Material(unlit=True)),
        "glass": has_emission(replace(glass, emissive=(3.0, 3.0, 3.0))),
        "ten_bits": _nearest(_largest_angle(normals, (np.rint(normals * 511 + 512) - 512) / 511)),
        "twice_sixteen": _nearest(_largest_angle(normals, _to_sphere(codes / 32767))),
        "code": int((up[0] & 0xFFFF) | (up[1] & 0xFFFF) << 16),
    }


def _to_square(n: np.ndarray) -> np.ndarray:
    p = n[:, :2] / np.abs(n).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1.0, -1.0)
    square: np.ndarray = np.where(n[:, 2:] < 0, folded, p)
    return square


def _to_sphere(p: np.ndarray) -> np.ndarray:
    z = 1 - np.abs(p).sum(axis=1, keepdims=True)
    below = np.maximum(-z, 0)
    return np.concatenate([p - np.where(p >= 0, below, -below), z], axis=1)


def _largest_angle(exact: np.ndarray, kept: np.ndarray) -> float:
    """Return the largest angle in degrees."""
    crossed = np.linalg.norm(np.cross(exact, kept), axis=1)
    return float(np.degrees(np.arctan2(crossed, (exact * kept).sum(axis=1))).max())


def _nearest(degrees: float) -> str:
    """Return the choice whose ratio to an angle is nearest to 1."""
    return min(ERRORS, key=lambda name: abs(np.log(ERRORS[name] / degrees)))
