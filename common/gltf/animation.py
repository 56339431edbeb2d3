"""Animation clips of a glTF file: samplers decoded and checked, channels by node of the scene."""

from __future__ import annotations

from typing import Literal

import numpy as np

from common.gltf.accessors import Accessors
from common.gltf.document import Document, Object
from common.gltf.nodes import Forest
from common.gltf.refusal import refuse
from common.scene import Animation, AnimationChannel, Float64

Path = Literal["translation", "rotation", "scale", "weights"]
_WIDTHS: dict[Path, int] = {"translation": 3, "rotation": 4, "scale": 3}
_INTERPOLATIONS: dict[str, Literal["linear", "step", "cubic"]] = {
    "LINEAR": "linear",
    "STEP": "step",
    "CUBICSPLINE": "cubic",
}


def target_count(document: Document, node: int) -> int:
    """Return how many morph targets the mesh of a node has."""
    mesh = document.items("nodes")[node].get("mesh")
    if mesh is None:
        return 0
    return max(
        (len(entry.get("targets") or ()) for entry in document.items("meshes")[mesh]["primitives"]), default=0
    )


def read_animations(document: Document, accessors: Accessors, forest: Forest) -> list[Animation]:
    """Read all clips; channels that name no node, or a path that Strata does not have, are left out.

    Raises:
        Refusal: a channel without its sampler, key times that go backwards, values of the wrong number or
            type, a number that is not finite, a rotation that is zero.
    """
    times: dict[int, Float64] = {}
    animations = []
    for number, entry in enumerate(document.items("animations")):
        place = f"animations[{number}]"
        channels = []
        for index, channel in enumerate(entry["channels"]):
            animated = _channel(
                document, accessors, forest, entry, channel, f"{place}.channels[{index}]", times, place
            )
            if animated is not None:
                channels.append(animated)
        if channels:
            duration = max(float(channel.times[-1]) for channel in channels)
            animations.append(
                Animation(entry.get("name") or f"animation {number}", tuple(channels), duration)
            )
    return animations


def _channel(
    document: Document,
    accessors: Accessors,
    forest: Forest,
    animation: Object,
    channel: Object,
    place: str,
    shared_times: dict[int, Float64],
    animation_place: str,
) -> AnimationChannel | None:
    node, path = channel["target"].get("node"), channel["target"]["path"]
    if channel["sampler"] >= len(animation["samplers"]):
        refuse(
            f"{place}.sampler",
            f"is {channel['sampler']}, but there are only {len(animation['samplers'])} samplers",
        )
    if node is None or path not in ("translation", "rotation", "scale", "weights"):
        return None
    if "matrix" in document.items("nodes")[node] and path != "weights":
        document.warn(f"{place} moves nodes[{node}], which has a matrix, and was left out.")
        return None
    sampler = animation["samplers"][channel["sampler"]]
    interpolation = _INTERPOLATIONS[sampler.get("interpolation", "LINEAR")]
    place = f"{animation_place}.samplers[{channel['sampler']}]"
    times = shared_times.get(sampler["input"])
    if times is None:
        times = accessors.floats(sampler["input"], f"{place}.input", ("SCALAR",))[:, 0].astype(np.float64)
        if (np.diff(times) < 0).any():
            refuse(f"{place}.input", f"goes backwards after key {int(np.argmax(np.diff(times) < 0))}")
        shared_times[sampler["input"]] = times

    if path == "weights":
        width = target_count(document, node)
        if width == 0:
            document.warn(
                f"{place} drives weights of nodes[{node}], which has no morph target, and was left out."
            )
            return None
        kinds: tuple[str, ...] = ("SCALAR",)
    else:
        width = _WIDTHS[path]
        kinds = (f"VEC{width}",)
    values = accessors.floats(sampler["output"], f"{place}.output", kinds).astype(np.float64)
    shape = (len(times), 3, width) if interpolation == "cubic" else (len(times), width)
    if values.size != np.prod(shape):
        wanted = int(np.prod(shape)) // values.shape[1]
        refuse(f"{place}.output", f"has {len(values)} elements instead of {wanted} for {len(times)} keys")
    values = values.reshape(shape)
    if path == "rotation":
        keys = values[:, 1] if interpolation == "cubic" else values
        lengths = np.linalg.norm(keys, axis=1)
        if (lengths < 1e-9).any():
            refuse(
                f"{place}.output",
                f"has a zero quaternion at key {int(np.argmin(lengths))}, which is no rotation",
            )
    return AnimationChannel(forest.place[node], path, times, values, interpolation)
