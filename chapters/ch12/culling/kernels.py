"""The kernels of culling and their memory, as passes see them; `vulkan.py` and `gl.py` implement them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import layouts

from ..frames.commands import Commands, Counted, MeshDraw
from ..meshlets.model import MESHLET, SceneMeshlets
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from .choice import Choice
from .lists import EARLY, LATE, MOST_TASKS, PHASES, CullingLists, command_bytes

LISTS = (
    *("view", "instances", "draws", "batches", "meshlets", "offsets"),
    *("places", "commands", "state", "seen", "visible", "pyramid", "told"),
)
"""The buffers of `lists.glsl`, in the order of their bindings; the first one is a uniform block."""

TABLES = ("view", "draws", "meshlets", "words", "offsets", "state", "seen", "visible", "pyramid")
"""The buffers of `meshlets/tables.glsl`, in the order of their bindings."""

TRANSPARENT = ("view", "instances", "source", "target", "pyramid last", "visible")
"""The buffers of `transparent.comp`; `source` are the slot's draw commands."""

OVERLAY = ("frame", "view", "instances", "visible", "pyramid", "spheres")
"""The buffers of `overlay.glsl`, in the order of their bindings; the first two are uniform blocks."""

COUNTERS = "told"
"""The buffers that are never made anew, since the counters of frames that were drawn can still be read."""

PYRAMIDS = ("pyramid", "pyramid last")
"""The buffers of the pyramids by number. Each keeps its content while culling is frozen."""

IN_SLOT: Mapping[str, Literal["upload", "readback", "device"]] = {
    "view": "upload",
    "told": "readback",
    "target": "device",
    "visible": "device",
}
"""The buffers that exist once for each slot, with their memory. Slots take turns: `seen` is that of the other slot."""


def tables_of(
    lists: CullingLists, meshlets: SceneMeshlets | None, spheres: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the contents of the buffers that never change while the draw lists stay the same."""
    return {
        "spheres": spheres,
        "draws": np.concatenate([lists.draws, lists.levels]),
        "batches": lists.batches,
        "meshlets": np.zeros(0, MESHLET) if meshlets is None else meshlets.records,
        "words": np.zeros(0, np.uint32) if meshlets is None else meshlets.words,
    }


def sizes_of(
    lists: CullingLists,
    tables: Mapping[str, np.ndarray],
    pyramid_words: int,
    instances: int,
    copied: int,
    two_pyramids: bool,
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
        **{name: max(1, pyramid_words) * 4 for name in PYRAMIDS[: 1 + two_pyramids]},
        "told": 256 * 4,
        "target": max(1, copied) * 20,
    }


def first_words(sizes: Mapping[str, int], blended: NDArray[np.int64]) -> dict[str, NDArray[np.uint32]]:
    """Return the words with which the buffers begin that kernels do not write as a whole.

    `blended` are instances that count as seen until a kernel says something else; there may be no kernel that does.
    """
    state, visible = (np.zeros(sizes[name] // 4, np.uint32) for name in ("state", "visible"))
    state[-1] = 1 << 24  # more draws than any list has
    visible[blended] = 1
    return {"state": state, "visible 0": visible, "visible 1": visible}


def describe(choice: Choice, code: Mapping[str, int]) -> dict[str, ComputeDescription]:
    """Return the kernels by name; those of a phase end in its number. `code` is the define of commands with a code."""
    mesh = (("MESH_SHADERS", 1), ("MOST_TASKS", MOST_TASKS)) if choice.geometry == "mesh" else ()
    kernels = {}
    for phase in (EARLY, LATE) if choice.two_phases else (EARLY,):
        defines = (*choice.defines, ("PHASE", phase), *mesh)
        for name in ("draws", "units"):
            kernels[f"{name} {phase}"] = ComputeDescription(
                f"culling/{name}.comp", defines, name=f"cull {name}, phase {phase}"
            )
    kernels["scan draws"] = ComputeDescription("culling/scan.comp", name="sums of draws")
    kernels["scan units"] = ComputeDescription("culling/scan.comp", (("UNITS", 1),), name="sums of units")
    kernels["commands"] = ComputeDescription(
        "culling/commands.comp", (*mesh, *choice.level_defines, *code.items()), name="draw commands"
    )
    kernels["clear"] = ComputeDescription("culling/clear.comp", name="no draw commands")
    kernels["begin"] = ComputeDescription("culling/counters.comp", name="counters at 0")
    kernels["tell"] = ComputeDescription("culling/counters.comp", (("TELL", 1),), name="counters for the CPU")
    return kernels


class OverlayDraw(NamedTuple):
    """A draw of the overlay: `instances` times `vertices`, which shaders compute; `constants` are pushed."""

    pipeline: Built
    vertices: int
    instances: int
    constants: NDArray[np.uint32]


class Kernels:
    """The memory of culling on a backend, and its bindings: what both APIs have in common."""

    def __init__(self, backend: Any) -> None:
        self._backend = backend
        self.buffer_bytes = min(int(backend.device.capabilities.limits["maxStorageBufferRange"]), 1 << 30)
        """The largest buffer that shaders see."""
        self.counts_draws: bool = backend.plan.native("draw-indirect-count")
        """Whether the number of draws can be on the GPU; else commands behind the last one draw nothing."""

    # --- memory ---

    def make_buffers(self, sizes: Mapping[str, int], contents: Mapping[str, np.ndarray]) -> None:
        """Create new buffers of these sizes in bytes; earlier ones are freed after the last frame that uses them.

        `contents` are of the buffers of these names, which end in a slot's number where there is one for each.
        """
        raise NotImplementedError

    def _own(self, name: str) -> Any:
        """Return the buffer that was made with a name, None if there is none."""
        raise NotImplementedError

    def _buffer(self, name: str, slot: int = 0) -> Any:
        """Return a buffer as the kernels of a slot see it: an own one, one of the scene, or that of the other slot."""
        of_scene = {"frame": "frame", "instances": "instances", "source": "commands"}
        if name in of_scene:
            return getattr(self._backend.data.slots[slot], of_scene[name])
        if name == "seen":
            return self._buffer("visible", 1 - slot)
        if name == PYRAMIDS[1]:  # there is a second pyramid only where something reads it
            return self._own(name) or self._own(PYRAMIDS[0])
        return self._own(f"{name} {slot}" if name in IN_SLOT else name)

    def make_bindings(
        self, kernels: Mapping[str, Built], meshlets: Built | None, overlay: Built | None, depth: str
    ) -> None:
        """Create the bindings of the kernels, by kind, for the images that the graph has now.

        `meshlets` is a pipeline with mesh shaders, and `overlay` one of the overlay, if there are any.
        """
        raise NotImplementedError

    # --- frames ---

    def write_view(self, slot: int, constants: NDArray[np.uint8]) -> None:
        """Write the view of culling for a slot."""
        self._buffer("view", slot).mapped[: len(constants)] = constants

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        raise NotImplementedError

    def bind(self, commands: Any, kind: str, pipeline: Built, slot: int) -> None:
        """Bind a pipeline with the buffers of its kind: "lists", "transparent", or one of PYRAMIDS."""
        raise NotImplementedError

    def dispatch(self, commands: Commands, word: int) -> None:
        """Dispatch the groups whose numbers are in three words of `state`."""
        commands.dispatch_indirect(self._buffer("state"), 4 * word)

    def counted(self, word: int) -> Counted:
        """Return the draw commands with the word of `state` that holds their number."""
        return Counted(self._buffer("commands"), self._buffer("state"), 4 * word, self.counts_draws)

    def mesh_draw(self, slot: int, constants: NDArray[np.uint32], word: int) -> MeshDraw:
        """Return the draw of mesh shaders whose arguments are at a word of `state`; Vulkan alone."""
        raise NotImplementedError

    def draw_overlay(self, commands: Any, slot: int, draw: OverlayDraw) -> None:
        """Record a draw of the overlay."""
        raise NotImplementedError

    def target(self, slot: int) -> Any:
        """Return the draw commands of blended objects."""
        return self._buffer("target", slot)

    def finish(self, commands: Any, slot: int) -> None:
        """Make the counters visible to the CPU, and bind again what the kernels replaced."""
        raise NotImplementedError

    def close(self) -> None:
        """Free the buffers."""
        raise NotImplementedError
