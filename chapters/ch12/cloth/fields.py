"""The properties of cloth and colliders in a glTF file, and their checks.

    "extras": {"strata": {"cloth": {"pins": [0, 7], "kg_per_m2": 0.25, "stretch_n_per_m": 400, ...}}}
    "extras": {"strata": {"collider": {"shape": "sphere", "radius_m": 0.5}}}

`pins` are the numbers of the held vertices, in the node's only primitive.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, cast

from common.errors import SceneError
from common.names import suggest
from common.scene import Nodes

CLOTH = (
    "columns",
    "rows",
    "pins",
    "kg_per_m2",
    "stretch_n_per_m",
    "shear_n_per_m",
    "bend_n_per_m",
    "damping_per_s",
    "drag",
    "thickness_m",
    "friction",
)
"""The properties of a cloth (`build.build_cloth` checks their values)."""

SHAPES = ("sphere", "plane", "box")
MOST_RADIUS = 1e6
"""Metres; a larger sphere is a plane."""


def properties(nodes: Nodes, name: str) -> dict[int, Any]:
    """Return `extras.strata.NAME` by node, in the order of the nodes."""
    by_node = {}
    for node in sorted(nodes.extras):
        strata = nodes.extras[node].get("strata")
        if isinstance(strata, dict) and name in strata:
            by_node[node] = strata[name]
    return by_node


def named(nodes: Nodes, node: int) -> str:
    """Return the name of a node for a message."""
    name = nodes.names[node] if node < len(nodes.names) else ""
    return f"node {node} '{name}'" if name else f"node {node}"


def check_cloth(value: Any, node_name: str) -> dict[str, Any]:
    """Return the properties of a cloth, with checked names. Raises SceneError, whose message has `node_name`."""
    return _object(value, f"extras.strata.cloth of {node_name}", CLOTH)


def check_collider(value: Any, node_name: str) -> tuple[Literal["sphere", "plane", "box"], float | None]:
    """Return the shape of a collider, and its radius in metres or None. Raises SceneError."""
    where = f"extras.strata.collider of {node_name}"
    entry = _object(value, where, ("shape", "radius_m"))
    shape = entry.get("shape")
    if shape not in SHAPES:
        raise SceneError(
            f"'shape' in {where} is {brief(shape)}: it must be {', '.join(SHAPES[:-1])} or {SHAPES[-1]}."
        )
    if "radius_m" in entry and shape != "sphere":
        raise SceneError(f"'radius_m' in {where} means nothing for a {shape}: leave it out.")
    radius: Any = entry.get("radius_m")
    if "radius_m" in entry and not (_real(radius) and 0.0 < radius <= MOST_RADIUS):
        raise SceneError(
            f"'radius_m' in {where} is {brief(radius)}: give metres, above 0 and at most {MOST_RADIUS:g}."
        )
    return cast(Literal["sphere", "plane", "box"], shape), radius


def _object(value: Any, where: str, known: Sequence[str]) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise SceneError(f"The {where} is {brief(value)}: write an object with fields, or leave it out.")
    for name in value:
        if name not in known:
            near = suggest(str(name), known)
            raise SceneError(
                f"The {where} has an unknown field '{name}'{near}" + ("" if near.endswith("?") else ".")
            )
    return value


def _real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def brief(value: Any) -> str:
    """Return a value of a file as text, on one line of bounded length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."
