"""The kernels of our BVH, and the buffers at their bindings by name. No device."""

from __future__ import annotations

from collections.abc import Iterable

from ...pipelines.compute_description import ComputeDescription
from ..passes import BUFFERS
from .fast import Step
from .model import CONSTANTS

TRIANGLES, NODES, INSTANCES, QUALITY = "triangles", "nodes", "instances", "quality"
"""The kernels of each frame: corners of triangles that deform, boxes of nodes, records of instances, and costs."""

PAGE, PLACES, MORE_PLACES, TOLD = "page", "places", "more places", "told"
"""Names of what other objects own: a page of geometry, the instances that draws read in up to two parts, and the costs
that the CPU reads."""

_SHARED = tuple(CONSTANTS.items())
EVERY_FRAME = {
    TRIANGLES: ComputeDescription("rays/bvh/refit.comp", (*_SHARED, ("TRIANGLES", 1)), name="ray triangles"),
    NODES: ComputeDescription("rays/bvh/refit.comp", _SHARED, name="ray nodes"),
    INSTANCES: ComputeDescription("rays/bvh/instances.comp", _SHARED, name="ray instances"),
}
COST = {QUALITY: ComputeDescription("rays/bvh/quality.comp", _SHARED, name="ray costs")}

BOUND: dict[str, tuple[str, ...]] = {
    TRIANGLES: (*BUFFERS, "meshes", PAGE),
    NODES: (*BUFFERS, "list"),
    INSTANCES: (*BUFFERS, PLACES, "slots", MORE_PLACES),
    QUALITY: (*BUFFERS, TOLD),
}
"""The names of the buffers at the bindings of each kernel, from 0 on."""


def title(step: Step) -> str:
    """Return the name of the kernel of a step."""
    if step.file == "refit.comp":
        return TRIANGLES
    parts = (
        step.file.removesuffix(".comp"),
        step.part.lower(),
        "upper" * step.upper,
        "back" * bool(step.sorts),
    )
    return " ".join(part for part in parts if part)


def rebuild_kernels(
    steps: Iterable[Step],
) -> tuple[dict[str, ComputeDescription], dict[str, tuple[str, ...]]]:
    """Return the kernels of the steps of rebuilds by name, and the names of their buffers."""
    described: dict[str, ComputeDescription] = {}
    bound: dict[str, tuple[str, ...]] = {}
    for step in steps:
        name = title(step)
        if name in described or step.file == "refit.comp":
            continue
        defines = (*_SHARED, *(((step.part, 1),) if step.part else ()), *((("UPPER", 1),) * step.upper))
        described[name] = ComputeDescription(f"rays/bvh/{step.file}", defines, name=f"ray {name}")
        if step.sorts is None:
            bound[name] = (*BUFFERS, "pairs", "halves", *(("slots",) * step.upper))
        else:
            bound[name] = ("other", "pairs", "counts") if step.sorts else ("pairs", "other", "counts")
    return described, bound
