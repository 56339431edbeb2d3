"""Study: a call draws many meshes from commands in a buffer, and a kernel edits the commands before the call.

An indirect draw takes its arguments from a buffer: a command names the range of a mesh's indices, the first vertex and
the first instance. One call draws any number of such commands, so a scene takes one call for each pipeline state, here
two: closed meshes, whose back faces are culled, and open meshes, which show both sides.

The commands are ordinary memory, and a kernel may write them. Here it keeps what lies inside a circle that moves with
time. There are two ways. The kernel can set the count of instances of the others to zero; the call still reads all
commands. Or it can compact the list, in the order of the scene, and write the count of draws to a second buffer, which
the call reads as well. A count above the maximum that the call names is clamped by the GPU.

A shader finds the data of its draw by the first instance. Vulkan adds it to the number of the instance, and OpenGL has
it in `gl_BaseInstance`. Here it holds two numbers of 16 bits: the object, for the transform, and the material. Such a
*draw record* stays with its command wherever compaction moves it; the number of the draw (`gl_DrawID`) does not.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np

from backends.contract import Capabilities, Plan, resolve
from backends.stage import Work
from common.lessons import Study
from common.settings import knob
from common.view.camera import View

from ...pipelines.compute_description import ComputeDescription

STUDY = Study(
    title="edited draws",
    idea="One call draws a part of the scene from commands that a kernel has edited, and the GPU reads how many.",
    order=1,
    features=(
        "gpu-driven/multi-draw-indirect",
        "gpu-driven/base-instance",
        "gpu-driven/indirect-count",
        "gpu-driven/draw-records",
    ),
    outputs=("color", "depth", "instance_id"),
)

AS_VISIBLE = 0xFFFFFFFF


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    objects: int = knob(400, "meshes in the scene; an object's number has 16 bits", minimum=1, maximum=65_536)
    radius: float = knob(0.7, "of the circle around what is drawn", unit="m", minimum=0.0, maximum=10.0)
    way: str = knob(
        "count",
        "compacted commands and their count, zero instances, or a call for each draw from the CPU",
        choices=("count", "zero", "separate"),
    )
    asked: int = knob(
        -1,
        "draws that the kernel asks for in each part, way=count only; -1: those that are inside",
        minimum=-1,
        maximum=1 << 17,
    )
    materials: int = knob(8, "entries of the table; others get entry 0, which is grey", minimum=1, maximum=8)
    feed: str = knob("pulled", "what fetches vertices", choices=("pulled", "attributes"))
    show: str = knob(
        "material",
        "what colours mean; instance_id has the number of the object, or that of the draw within its call",
        choices=("material", "object", "draw"),
    )


@dataclass
class DrawWork(Work):
    """What a frame did: `draws` are the commands that its calls read, `triangles` those of their meshes.

    In the way "count", the GPU adds `counted`: the draws that the count buffer asked for.
    """

    calls: int = 0

    def add(self, draws: int, triangles: int, calls: int) -> None:
        """Count the draws of a part."""
        self.draws, self.triangles, self.calls = (
            self.draws + draws,
            self.triangles + triangles,
            self.calls + calls,
        )


KERNELS = {"count": "studies/edited_draws/compact.comp", "zero": "studies/edited_draws/zero.comp"}
SHADERS = ("studies/edited_draws/mesh.vert", "studies/edited_draws/mesh.frag")
ID_SHADERS = ("studies/edited_draws/mesh.vert", "studies/edited_draws/ids.frag")
UNIFORM_BYTES = 2 * 64


def way_of(settings: Settings, plan: Plan) -> str:
    """Return the way that the device can go: a count buffer, else zero instances, else calls from the CPU."""
    way = settings.way
    if way == "count" and not plan.native("draw-indirect-count"):
        way = "zero"
    return way if plan.native("multi-draw") else "separate"


def plan_of(capabilities: Capabilities, without: Set[str]) -> Plan:
    """Return the plan of the features that the ways need."""
    return resolve((), ("multi-draw", "draw-indirect-count"), capabilities, without)


def kernel_of(way: str) -> ComputeDescription:
    """Return the kernel that edits commands in a way."""
    return ComputeDescription(KERNELS[way], name=way)


def defines(settings: Settings, open_mesh: bool) -> tuple[tuple[str, int], ...]:
    """Return the macros of the draws of a part."""
    return (
        ("PULLED", int(settings.feed == "pulled")),
        ("OPEN", int(open_mesh)),
        ("SHOW", ("material", "object", "draw").index(settings.show)),
    )


def circle(settings: Settings, time: float) -> np.ndarray:
    """Return (4,) float32: x and z of the circle's middle, its radius, and the square of that."""
    angle, radius = 0.7 * time, np.float32(settings.radius)
    middle = np.array([0.55 * np.cos(angle), 0.55 * np.sin(angle)], np.float32)
    return np.array([*middle, radius, radius * radius], np.float32)


def push(settings: Settings, parts: list[tuple[int, int]], time: float) -> np.ndarray:
    """Return the push constants of the kernels, (12,) uint32: circle, (first, count) of both parts, the count asked."""
    asked = settings.asked if settings.asked >= 0 else AS_VISIBLE
    numbers = [*parts[0], *parts[1], asked, 0, 0, 0]
    return np.concatenate([circle(settings, time).view(np.uint32), np.array(numbers, np.uint32)])


def matrices(view: View, aspect: float) -> np.ndarray:
    """Return the uniforms of the draws, (32,) float32: view_from_world and clip_from_view, columns first."""
    both = np.stack([view.view_from_world().T, view.clip_from_view(aspect).T])
    return both.astype(np.float32).ravel()
