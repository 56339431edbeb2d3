"""What devices allow to the study cluster-list, and the sentence for what is too much."""

from __future__ import annotations

from dataclasses import dataclass

from backends.contract import Capabilities, Plan
from common.errors import UnsupportedError

from ..meshlet_field import Field
from . import MOST_TRIANGLES, ROW, Settings, blocks_of


@dataclass(frozen=True)
class Limits:
    """What a device allows: vertices and triangles of a meshlet, work groups of task shaders, draws of a call."""

    vertices: int
    triangles: int
    task_groups: int
    draws: int


def check_plan(plan: Plan, capabilities: Capabilities) -> None:
    """Raise UnsupportedError on a device without mesh shaders."""
    if not plan.native("mesh-shader"):
        raise UnsupportedError(
            f"The study cluster-list draws with mesh shaders, which {capabilities.device} is used without: the study "
            "compacted-indices draws the same meshlets with a vertex shader."
        )


def triangles_of(settings: Settings, limits: Limits) -> int:
    """Return the most triangles of a meshlet; raise UnsupportedError for meshlets that the device cannot draw."""
    triangles = settings.triangles or min(limits.triangles, MOST_TRIANGLES)
    for wanted, most, what in (
        (settings.vertices, limits.vertices, "vertices"),
        (triangles, limits.triangles, "triangles"),
    ):
        if wanted > most:
            raise UnsupportedError(
                f"Meshlets of {wanted} {what} are too large for this device, whose mesh shaders write at most {most}: "
                f"set fewer {what}."
            )
    return triangles


def check_draws(settings: Settings, field: Field, limits: Limits, at_once: int) -> None:
    """Raise UnsupportedError if the study needs more work groups or draws than the device takes at once."""
    wanted, most, what = -(-field.units // at_once), limits.draws, "draws"
    if settings.way == "tasks":
        wanted, most, what = len(blocks_of(field)), limits.task_groups, "work groups of task shaders"
    if wanted > most:
        raise UnsupportedError(
            f"This field may take {wanted} {what}, and a call of this device has at most {most}: set fewer instances."
        )


def at_once_of(settings: Settings, capabilities: Capabilities) -> int:
    """Return the most meshlets of a draw.

    The driver in software keeps the output of all mesh shaders of a draw, about 60 KB for each: few of them fit into
    the caches of the processor.
    """
    return settings.at_once or (64 if capabilities.is_software else ROW)
