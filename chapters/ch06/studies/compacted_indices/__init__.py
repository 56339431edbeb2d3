"""Study: three ways to draw the meshlets that culling has left, with a plain vertex shader.

Meshlets are ranges of the list of indices, so one draw command for each draws any selection of them. A device pays for
each command, however few triangles it has. There are two ways to have fewer. Survivors that follow one another in the
list of indices make a *run*, and one command draws a run. Or a kernel copies the indices of all survivors, one after
the other, to a second list: then one command draws an instance. That costs memory and bandwidth: the kernel reads and
writes 12 bytes for each triangle, and the draw reads them again.

All places come from prefix sums in the order of the scene, never from atomic counters, so all three ways draw the same
triangles in the same order. The first instance of a command is the number of the instance, and the vertex shader is the
same for all.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

from backends.contract import Capabilities, Plan, resolve
from common.errors import UnsupportedError
from common.lessons import Study
from common.settings import knob

from ..meshlet_field import MOST_INSTANCES, Field

STUDY = Study(
    title="compacted indices",
    idea="Surviving meshlets are drawn by a command each, by a command for each run, or from a list of their indices.",
    order=4,
    features=("gpu-driven/command-compaction", "meshlets/survivor-compaction"),
    outputs=("color", "depth", "instance_id"),
)

WAYS = ("commands", "runs", "indices")
"""By their number in field.glsl."""

WRITE = "studies/compacted_indices/write.comp"
SHADERS = ("studies/meshlet_field/mesh.vert",)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    instances: int = knob(150, "objects of the field", minimum=1, maximum=MOST_INSTANCES)
    way: str = knob(
        "commands",
        "a command for each meshlet, for each run of meshlets, or for each instance, from copied indices",
        choices=WAYS,
    )
    culling: bool = knob(True, "leave meshlets out that are outside of the view or face away")
    turned: float = knob(
        0.0,
        "how far the camera of the picture is turned around the field; culling keeps its own",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    group: int = knob(64, "invocations of a work group of the kernels", choices=(8, 16, 32, 64, 128, 256))


def plan_of(capabilities: Capabilities, without: Set[str]) -> Plan:
    """Return the plan of the features that the study needs; raise UnsupportedError if the device lacks one."""
    plan = resolve((), ("multi-draw", "draw-indirect-count"), capabilities, without)
    for feature in ("multi-draw", "draw-indirect-count"):
        if not plan.native(feature):
            raise UnsupportedError(
                f"The study compacted-indices lets the GPU say how many commands a call has, and {capabilities.device} "
                f"is used without {feature}: the study edited-draws shows what such devices do."
            )
    return plan


def most_commands(field: Field, way: str) -> int:
    """Return the most commands that a way can write."""
    return len(field.instances) if way == "indices" else field.units


def counters(way: str, commands: int, triangles: int) -> dict[str, int]:
    """Return the counters of a frame from the GPU's totals."""
    copied = 3 * triangles if way == "indices" else 0
    return {"commands": commands, "triangles": triangles, "indices_copied": copied}
