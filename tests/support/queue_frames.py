"""Frames of a few compute passes on two queues, carried out and submitted as a renderer does: for tests.

    step     compute   state = 1664525 * state@previous + 1013904223 + place + given
    spread   graphics  field = state * 3 (an image)
    mix      compute   mixed = field with its rows upside down, xor state (an image)
    sum      graphics  result = mixed + state

So a buffer is read by both queues while the next frame's is written, and images go to the other queue and back. The
graph, its executor and the queues are a chapter's, which is given as the name of its package.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np

from backends import shader_text
from backends.contract import Access, Pass
from backends.vulkan import api as vk
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.resources import create_buffer, destroy_buffer

N = 64
BYTES = 4 * N

IMAGES = ("field", "mixed")


def _text(declared: Sequence[str], work: str) -> str:
    """Return a kernel of an invocation for each number; what it declares is bound in this order."""
    lines = [
        f"layout(binding = {binding}, r32ui) uniform uimage2D {name};"
        if name in IMAGES
        else f"layout(binding = {binding}) buffer B{binding} {{ uint {name}[]; }};"
        for binding, name in enumerate(declared)
    ]
    main = f"void main() {{ uint i = gl_GlobalInvocationID.x; ivec2 at = ivec2(i % 8u, i / 8u); {work} }}"
    return "\n".join(("layout(local_size_x = 64) in;", *lines, main, ""))


SHADERS = {
    "step": _text(
        ("before", "state", "given"), "state[i] = 1664525u * before[i] + 1013904223u + i + given[i];"
    ),
    "spread": _text(("state", "field"), "imageStore(field, at, uvec4(state[i] * 3u));"),
    "mix": _text(
        ("field", "state", "mixed"),
        "imageStore(mixed, at, uvec4(imageLoad(field, ivec2(at.x, 7 - at.y)).x ^ state[i]));",
    ),
    "sum": _text(("mixed", "state", "result"), "result[i] = imageLoad(mixed, at).x + state[i];"),
}
HELD = {
    "step": ("state@previous", "state", "given"),
    "spread": ("state", "field"),
    "mix": ("field", "state", "mixed"),
    "sum": ("mixed", "state", "result"),
}


def storage(name: str, **more: Any) -> Access:
    """Return a use of a buffer or an image of numbers."""
    return Access(name, "storage", **more)


READS = {
    "step": (storage("state", previous=True), storage("given")),
    "spread": (storage("state"),),
    "mix": (storage("field"), storage("state")),
    "sum": (storage("mixed"), storage("state")),
}
WRITES = {
    "step": (storage("state", bytes=BYTES),),
    "spread": (storage("field", format="r32ui"),),
    "mix": (storage("mixed", format="r32ui"),),
    "sum": (storage("result", bytes=BYTES),),
}


class Dispatch(Pass):
    """One of the passes; `version` is what its recording depends on."""

    def __init__(self, device: Any, name: str, queue: str) -> None:
        kinds: Any = ["image" if one in IMAGES else "storage" for one in HELD[name]]
        text = shader_text.build_text(SHADERS[name], "comp", "vulkan", name=f"<{name}>")
        self.kernel = Kernel(device, text, kinds, dispatches=64)
        self.name, self.queue, self.version = name, queue, 0
        self.reads, self.writes = READS[name], WRITES[name]
        self.images: Any = None
        self.times_recorded = 0

    def key(self, slot: int) -> int:
        """Return what the recording depends on."""
        return self.version

    def record(self, commands: Any) -> None:
        """Record the dispatch."""
        mine = self.images.in_slot[commands.slot.index]
        held = [Sampled(mine[name].view) if name in IMAGES else mine[name] for name in HELD[self.name]]
        self.kernel.record(commands.handle, held, (1, 1, 1))
        self.times_recorded += 1


def expected(frames: int, given: int = 0) -> list[np.ndarray]:
    """Return the results of frames, whose first one finds a state of zeros."""
    i = np.arange(N, dtype=np.uint32)
    state, found = np.zeros(N, np.uint32), []
    for _ in range(frames):
        state = np.uint32(1664525) * state + np.uint32(1013904223) + i + np.uint32(given)
        field = (state * np.uint32(3)).reshape(8, 8)
        found.append((field[::-1].reshape(-1) ^ state) + state)
    return found


class Stream:
    """Frames of the passes; `results` has what those were that were waited for. Like a renderer, as far as is asked."""

    def __init__(
        self, device: Any, package: str, stack: ExitStack, own: bool, alone: bool, alias: bool
    ) -> None:
        self.device = device

        def part(module: str) -> Any:
            return import_module(f"{package}.{module}")

        frames, queueing, types = (
            part("frames.queues.vulkan_submission"),
            part("frames.queues.vulkan_queues"),
            part("graph.types"),
        )
        idle = types.Touch("", frozenset(), frozenset())
        for_host = types.Touch("", frozenset({"host"}), frozenset({"host_read"}))

        def owned(made: Any) -> Any:
            stack.callback(made.close)
            return made

        def buffer(use: Any, name: str) -> Any:
            usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
            made = create_buffer(device, BYTES, usage, use, name, families=queues.families)
            stack.callback(destroy_buffer, device, made)
            return made

        queues = queueing.Queues(device, own)
        on = {name: "compute" if name in ("step", "mix") else "graphics" for name in SHADERS}
        self.made = {name: Dispatch(device, name, queue) for name, queue in on.items()}
        for made in self.made.values():
            stack.callback(made.kernel.close)
        self.given = buffer("upload", "given")
        self.given.mapped[:] = 0
        self._results = [buffer("readback", f"result {slot}") for slot in range(2)]
        externals = {
            "given": types.External(None, None, idle, bytes=BYTES),
            "result": types.External(None, None, idle, for_host, BYTES),
        }
        nodes = [types.Node(one.name, one.reads, one.writes, queue=one.queue) for one in self.made.values()]
        memory = part("graph.memory.vulkan_images").GraphMemory(device, {"copy_target"}, queues.families)
        names = part("graph.sync.queues").QUEUES[: 1 if alone else 2]
        self.graph = part("graph.frame_graph").compile_graph(
            nodes, (8, 8), (), externals, memory.requirement, alias, queues=names
        )
        resources = owned(part("frames.vulkan_resources").Resources(device))
        descriptors = owned(part("pipelines.vulkan_descriptors").Descriptors(device))
        self._profiler = owned(part("frames.vulkan_profiler").Profiler(device))
        self._frames = owned(frames.QueueFrames(device, queues))
        held = [{"given": self.given, "result": result} for result in self._results]
        self.executor = owned(
            part("graph.execute.vulkan").GraphExecutor(
                device, self.graph, self.made, memory, resources, descriptors, lambda _: held, queues=queues
            )
        )
        for made in self.made.values():
            made.images = self.executor.images
        self._frames.follow(self.executor, self._profiler)
        self._commands = part("frames.vulkan_commands").Commands(device)
        self._clear()
        outputs: dict[str, str] = {}
        self._plan = SimpleNamespace(
            nodes={node.name: node for node in nodes}, read_from=outputs, externals=externals, kept=set()
        )
        self.results: list[np.ndarray] = []
        self.recorded: list[bool] = []
        self._slots: list[Any] = []

    def _clear(self) -> None:
        from backends.vulkan.once import submit_once

        with submit_once(self.device) as commands:
            for held in self.executor.images.in_slot:
                if "state" in held:
                    self.device.fn.vkCmdFillBuffer(commands, held["state"].handle, 0, vk.VK_WHOLE_SIZE, 0)

    def draw(self) -> Any:
        """Submit a frame, after taking the result of the one that its slot had."""
        slot = self._frames.begin()
        if slot in self._slots:
            self._take(slot)
        self.recorded.append(self._frames.record(slot, self._commands))
        self._frames.submit(slot)
        self._slots.append(slot)
        return slot

    def _take(self, slot: Any) -> None:
        self._slots.remove(slot)
        result = self._results[slot.index]
        self.device.memory.invalidate(result.allocation)
        self.results.append(result.view(np.uint32)[:N].copy())

    def finish(self) -> list[np.ndarray]:
        """Wait for all frames, and return the results of all."""
        for slot in list(self._slots):
            self._frames.wait(slot)
            self._take(slot)
        return self.results


@contextmanager
def stream(
    device: Any,
    package: str,
    own: bool = True,
    alone: bool = False,
    alias: bool = True,
) -> Iterator[Stream]:
    """Give a stream of frames of the chapter `package`.

    `own` lets compute have a queue of its own, `alone` compiles the graph for one queue.
    """
    with ExitStack() as stack:
        made = Stream(device, package, stack, own, alone, alias)
        stack.callback(device.wait_idle)
        yield made
