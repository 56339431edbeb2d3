"""The phase function in float64, at nodes of an integral over 1 - cos and between directions that float32 holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

OCTAVES, NODES = 32, 16
"""1 - cos is cut into octaves below 2, and each has nodes of Gauss and Legendre, so sums over nodes are integrals."""

POINTS = OCTAVES * NODES


def density(one_minus_cosine: ArrayLike, g: ArrayLike) -> Float64:
    """Return the phase function per steradian, in float64."""
    size = np.abs(np.asarray(g, np.float64))
    turned = np.where(np.asarray(g) < 0, 2 - np.asarray(one_minus_cosine, np.float64), one_minus_cosine)
    result: Float64 = (1 - size**2) / (4 * np.pi * ((1 - size) ** 2 + 2 * size * turned) ** 1.5)
    return result


def nodes() -> tuple[Float64, Float64]:
    """Return (POINTS,) values of 1 - cos, rising from 0 to 2, and the weights of an integral over it.

    The first octave begins at 0.
    """
    place, weight = np.polynomial.legendre.leggauss(NODES)
    edges = np.concatenate([[0.0], 2.0 ** np.arange(2 - OCTAVES, 2)])
    low, width = edges[:-1, None], np.diff(edges)[:, None]
    return (low + width * (place + 1) / 2).ravel(), (width * weight / 2).ravel()


def directions() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return unit vectors of float32: (3,) in which light arrives, and (POINTS, 3) in which it leaves, one for each
    node. No axis is near, so that all components round."""
    first = np.array([0.36, -0.48, 0.8])
    beside = np.cross(first, (0.6, 0.64, -0.48))
    beside /= np.linalg.norm(beside)
    angle = 2 * np.arcsin(np.sqrt(nodes()[0] / 2))[:, None]
    return first.astype(np.float32), (np.cos(angle) * first + np.sin(angle) * beside).astype(np.float32)


def exact(anisotropies: NDArray[np.float32]) -> Float64:
    """Return the phase function (G, POINTS) between the directions as float32 holds them, scaled to length 1."""
    first, leaving = (vector.astype(np.float64) for vector in directions())
    first, leaving = first / np.linalg.norm(first), leaving / np.linalg.norm(leaving, axis=1, keepdims=True)
    apart = ((first - leaving) ** 2).sum(axis=1) / 2
    return density(apart, anisotropies[:, None])
