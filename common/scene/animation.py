"""Keyframes sampled at a time: channels with the same keys are interpolated together, in float64."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import normalize, slerp
from common.scene import Animation, AnimationChannel, Float64


@dataclass(frozen=True)
class Track:
    """Channels of a clip that share path, interpolation and key times.

    `values` is (C, K, V): channels, keys, components; (C, K, 3, V) for cubic splines.
    """

    path: str
    interpolation: str
    duration: float
    nodes: NDArray[np.intp]
    times: Float64
    values: Float64


def playing(animations: Iterable[Animation]) -> list[Animation]:
    """Return the clips that can play together.

    A file either has alternative clips for the same nodes (walk, run) or one clip for every object. Both come
    out right by one rule: a clip that drives a property which an earlier clip drives already is left out.
    """
    taken: set[tuple[int, str]] = set()
    together = []
    for animation in animations:
        driven = {(channel.node, channel.path) for channel in animation.channels}
        if not driven & taken:
            taken |= driven
            together.append(animation)
    return together


def build_tracks(animations: Iterable[Animation]) -> list[Track]:
    """Return the tracks of all clips that can play together."""
    tracks = []
    for animation in playing(animations):
        # A property named twice in one clip follows the last channel.
        channels = {(channel.node, channel.path): channel for channel in animation.channels}.values()
        groups: dict[tuple[object, ...], list[AnimationChannel]] = {}
        for channel in channels:
            key = (channel.path, channel.interpolation, id(channel.times), channel.values.shape)
            groups.setdefault(key, []).append(channel)
        for group in groups.values():
            first = group[0]
            nodes = np.array([channel.node for channel in group], np.intp)
            values = np.stack([channel.values for channel in group])
            tracks.append(
                Track(first.path, first.interpolation, animation.duration, nodes, first.times, values)
            )
    return tracks


def sample(track: Track, time: float) -> Float64:
    """Return (C, V) the values of a track's channels at `time`; the clip starts again after its duration.

    Before the first key and after the last their values hold. Rotations take the shorter arc at constant
    speed (linear) or are normalised (cubic); the spline is Hermite's with tangents per second (glTF 2.0,
    appendix C).
    """
    times, values = track.times, track.values
    cubic = track.interpolation == "cubic"
    if track.duration > 0:
        time = time % track.duration
    last = len(times) - 1
    key = int(np.searchsorted(times, time, side="right")) - 1
    if key < 0 or key >= last or track.interpolation == "step":
        key = min(max(key, 0), last)
        held = values[:, key, 1] if cubic else values[:, key]
        return normalize(held) if track.path == "rotation" else held
    span = times[key + 1] - times[key]
    u = (time - times[key]) / span  # searchsorted leaves no span of zero here
    if cubic:
        start, leaving = values[:, key, 1], values[:, key, 2] * span
        end, arriving = values[:, key + 1, 1], values[:, key + 1, 0] * span
        result = (
            (2 * u**3 - 3 * u**2 + 1) * start
            + (u**3 - 2 * u**2 + u) * leaving
            + (3 * u**2 - 2 * u**3) * end
            + (u**3 - u**2) * arriving
        )
        return normalize(result) if track.path == "rotation" else result
    if track.path == "rotation":
        return slerp(values[:, key], values[:, key + 1], np.full(len(values), u))
    return (1 - u) * values[:, key] + u * values[:, key + 1]
