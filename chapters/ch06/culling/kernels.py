"""The kernels of culling and their memory, as passes see them; `vulkan.py` and `gl.py` implement them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from common import layouts

from ..frames.commands import Commands, Counted, MeshDraw
from ..meshlets.model import MESHLET, SceneMeshlets
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from .choice import Choice
from .lists import EARLY, LATE, PHASES, CullingLists, command_bytes

LISTS = (
    *("view", "instances", "draws", "batches", "meshlets", "offsets"),
    *("places", "commands", "state", "seen", "visible", "pyramid", "told"),
)
"""The buffers of `lists.glsl`, in the order of their bindings; the first one is a uniform block."""

TABLES = ("view", "draws", "meshlets", "words", "offsets", "state", "seen", "visible", "pyramid")
"""The buffers of `meshlets/tables.glsl`, in the order of their bindings."""

TRANSPARENT = ("view", "instances", "source", "target", "pyramid")
"""The buffers of `transparent.comp`; `source` are the slot's draw commands."""

IN_SLOT: Mapping[str, Literal["upload", "readback", "device"]] = {
    "view": "upload",
    "told": "readback",
    "target": "device",
    "visible": "device",
}
"""The buffers that exist once for each slot, with their memory. Slots take turns: `seen` is that of the other slot."""

CLEARED = ("state", "visible 0", "visible 1")
"""The buffers that begin with known words."""


def tables_of(lists: CullingLists, meshlets: SceneMeshlets | None) -> dict[str, np.ndarray]:
    """Return the contents of the buffers that never change while the draw lists stay the same."""
    return {
        "draws": lists.draws,
        "batches": lists.batches,
        "meshlets": np.zeros(0, MESHLET) if meshlets is None else meshlets.records,
        "words": np.zeros(0, np.uint32) if meshlets is None else meshlets.words,
    }


def sizes_of(
    lists: CullingLists, tables: Mapping[str, np.ndarray], pyramid_words: int, instances: int, copied: int
) -> dict[str, int]:
    """Return the bytes of each buffer, but for those that the scene's data has."""
    units = max(1, lists.units)
    return {
        **{name: max(table.nbytes, 16) for name, table in tables.items()},
        "view": layouts.dtype("FrameConstants").itemsize,
        "offsets": PHASES * max(1, len(lists.draws)) * 8,
        "places": units * 8,
        "commands": command_bytes(lists),
        "state": lists.state.words * 4,
        "visible": (instances + -(-lists.bits // 32) + 1) * 4,
        "pyramid": max(1, pyramid_words) * 4,
        "told": 256 * 4,
        "target": max(1, copied) * 20,
    }


def cleared(size: int) -> NDArray[np.uint32]:
    """Return the words that a buffer of `size` bytes begins with: 0, and at the end more draws than any list has."""
    words = np.zeros(size // 4, np.uint32)
    words[-1] = 1 << 24
    return words


def describe(choice: Choice, samples: int) -> dict[str, ComputeDescription]:
    """Return the kernels by name; those of a phase end in its number."""
    level = ("CULLING", choice.level)
    mesh = (("MESH_SHADERS", 1),) if choice.geometry == "mesh" else ()
    kernels = {}
    for phase in (EARLY, LATE) if choice.two_phases else (EARLY,):
        defines = (level, ("PHASE", phase), *mesh)
        for name in ("draws", "units"):
            kernels[f"{name} {phase}"] = ComputeDescription(
                f"culling/{name}.comp", defines, name=f"cull {name}, phase {phase}"
            )
    kernels["scan draws"] = ComputeDescription("culling/scan.comp", name="sums of draws")
    kernels["scan units"] = ComputeDescription("culling/scan.comp", (("UNITS", 1),), name="sums of units")
    kernels["commands"] = ComputeDescription("culling/commands.comp", mesh, name="draw commands")
    kernels["clear"] = ComputeDescription("culling/clear.comp", name="no draw commands")
    kernels["begin"] = ComputeDescription("culling/counters.comp", name="counters at 0")
    kernels["tell"] = ComputeDescription("culling/counters.comp", (("TELL", 1),), name="counters for the CPU")
    return kernels


class Kernels(Protocol):
    """The memory of culling on a backend, and its bindings."""

    counts_draws: bool
    """Whether the number of draws can be on the GPU; else commands behind the last one draw nothing."""

    def make_lists(
        self,
        lists: CullingLists,
        meshlets: SceneMeshlets | None,
        instances: int,
        copied: int,
        pyramid_words: int,
    ) -> None:
        """Create the buffers of new tables; the memory of earlier ones is freed after the last frame that uses it."""

    def make_bindings(self, kernels: Mapping[str, Built], meshlets: Built | None, depth: str) -> None:
        """Create the bindings of the kernels, by kind, for the images that the graph has now.

        `meshlets` is a pipeline with mesh shaders, if there are any.
        """

    def write_view(self, slot: int, constants: NDArray[np.uint8]) -> None:
        """Write the view of culling for a slot."""

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""

    def bind(self, commands: Commands, kind: str, pipeline: Built, slot: int) -> None:
        """Bind a pipeline with the buffers of its kind: "lists", "transparent" or "pyramid"."""

    def dispatch(self, commands: Commands, word: int) -> None:
        """Dispatch the groups whose numbers are in three words of `state`."""

    def counted(self, word: int) -> Counted:
        """Return the draw commands with the word of `state` that holds their number."""

    def mesh_draw(self, slot: int, constants: NDArray[np.uint32], word: int) -> MeshDraw:
        """Return the draw of mesh shaders whose arguments are at a word of `state`; Vulkan alone."""

    def target(self, slot: int) -> Any:
        """Return the draw commands of blended objects."""

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU, and bind again what the kernels replaced."""

    def close(self) -> None:
        """Free the buffers."""
