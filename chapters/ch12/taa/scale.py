"""Fewer pixels than the picture has: what is drawn at a scale, and what has the size of the picture.

Everything before the pass `taa` is drawn at the scale, and the graph is compiled for that size. The pass writes its
history at the size of the picture, and so do all passes that use the history. Depth and motion vectors are enlarged for
outputs and for those passes: each pixel takes the nearest one that was drawn. Instance ids are drawn at the size of the
picture, with a depth of their own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from backends.contract import Access
from common.errors import UserError

from ..graph.types import GraphError, Node
from ..settings import Settings
from . import model

SAMPLES = 16
"""Samples of each pixel of the picture in a period of jitter, at least, on average."""

DRAWN = "_drawn"
"""What a name ends with that is drawn at the scale, where the name itself is that of the enlarged image."""

ENLARGED = {"depth": "d32f", "motion": "rg16f"}
"""The images that are enlarged, with their formats."""

OWN_DEPTH = "depth_of_ids"
"""The depth of a pass that finds instance ids by itself."""


def check(settings: Settings) -> None:
    """Raise UserError for a scale below 1 with settings that need the size of the picture, or that have no history."""
    scale = settings.taa.taa_scale
    if scale == 1.0:
        return
    if settings.taa.taa == "off":
        raise UserError(f"taa_scale={scale:g} draws fewer pixels than the picture has: set taa=full as well.")
    if model.scale(settings) < 1.0 and settings.taa.taa_filter != "none" and settings.taa.taa == "full":
        raise UserError(
            f"taa_filter={settings.taa.taa_filter} has no effect with taa_scale={scale:g}, where samples are weighted "
            "by their distance from the pixel of the picture: set taa_filter=none, or taa_scale=1."
        )
    rates = settings.rates
    if model.scale(settings) < 1.0 and (rates.rate_policy == "sobel" or rates.rate_tint):
        knob = "rate_tint" if rates.rate_tint else "rate_policy=sobel"
        raise UserError(
            f"{knob} compares pixels of the picture with those that are drawn, and taa_scale={scale:g} draws others: "
            "set taa_scale=1."
        )


def drawn_size(settings: Settings, size: tuple[int, int]) -> tuple[int, int]:
    """Return the (width, height) in pixels that is drawn for a picture of `size` pixels."""
    scale = model.scale(settings)
    return size if scale == 1.0 else (max(1, round(size[0] * scale)), max(1, round(size[1] * scale)))


def period(settings: Settings) -> int:
    """Return the frames after which the jitter repeats: enough for SAMPLES samples of each pixel of the picture."""
    scale, period = model.scale(settings), settings.taa.jitter_period
    return period if scale == 1.0 else max(period, math.ceil(SAMPLES / scale**2))


def enlarged(nodes: Sequence[Node], settings: Settings, size: tuple[int, int]) -> list[Node]:
    """Return the nodes of a frame with a picture of `size` pixels, where the graph has the size that is drawn.

    Raises GraphError if no pass fills the picture.
    """
    if model.scale(settings) == 1.0:
        return list(nodes)
    own = [node for node in nodes if node.name.startswith(ENLARGE)]
    others = [node for node in nodes if node not in own]
    taa = next((node for node in others if node.name == "taa" and not node.why_not), None)
    if taa is None:
        raise GraphError(
            f"taa_scale={settings.taa.taa_scale:g} draws fewer pixels than the picture has, and no pass 'taa' of this "
            "frame fills it: switch it on, or set taa_scale=1."
        )
    whole = {taa.name, *(node.name for node in others if OWN_DEPTH in _written(node))}
    names: set[str] = set()
    for _ in others:  # a pass that uses what has the picture's size has this size
        names = {name for node in others if node.name in whole for name in _written(node)}
        more = {node.name for node in others if names.intersection(_used(node))} - whole
        if not more:
            break
        whole |= more
    drawn = {name: name + DRAWN for name in ENLARGED if name not in names}
    return [
        *(
            _sized(node if node.name in whole and node is not taa else _renamed(node, drawn), size)
            if node.name in whole
            else _renamed(node, drawn)
            for node in others
        ),
        *(_sized(node, size) for node in own if node.writes[0].resource in drawn),
    ]


ENLARGE = "enlarge_"
"""What the names of the passes begin with that enlarge an image."""


def _written(node: Node) -> list[str]:
    return [access.resource for access in node.writes]


def _used(node: Node) -> list[str]:
    """Return the names of this frame that a node reads or continues."""
    read = [access.resource for access in node.reads if not access.previous]
    return read + [access.of for access in node.writes if access.of]


def _sized(node: Node, size: tuple[int, int]) -> Node:
    """Return a node whose images have sizes in parts of `size`."""

    def sized(access: Access) -> Access:
        if access.of or access.bytes or access.size:
            return access
        sides = (max(1, round(side * access.scale)) for side in size)
        width, height = (-(-side // texel) for side, texel in zip(sides, access.texel, strict=True))
        return replace(access, size=(width, height), scale=1.0, texel=(1, 1))

    return replace(node, writes=tuple(map(sized, node.writes)))


def _renamed(node: Node, names: dict[str, str]) -> Node:
    """Return a node with other names of resources."""

    def renamed(access: Access) -> Access:
        return replace(
            access,
            resource=names.get(access.resource, access.resource),
            of=names.get(access.of, access.of),
            instead=names.get(access.instead, access.instead),
        )

    return replace(node, reads=tuple(map(renamed, node.reads)), writes=tuple(map(renamed, node.writes)))
