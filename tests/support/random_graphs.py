"""Random frames: passes of every kind that use each other's results in every way that is allowed.

Passes are made in an order in which the frame could run, so that each graph is valid by construction; then they are
shuffled, since the order of declaration must not matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from backends.contract import Access

SIZE = (160, 96)
SIZES: tuple[tuple[float, tuple[int, int] | None], ...] = (
    (1.0, None),
    (0.5, None),
    (0.25, None),
    (1.0, (64, 40)),
)
"""(scale, size), as passes declare them."""

COLORS = ("rgba8", "rgba16f", "rgba32f", "r32f")
NEAR = 30
"""A pass reads what one of so many values before it are: frames are long, not wide."""


@dataclass
class RandomGraph:
    """A frame to compile: all that the compiler is given."""

    nodes: tuple[Any, ...]
    outputs: tuple[str, ...]
    externals: dict[str, Any]
    keep: tuple[str, ...] = ()
    requirements: Callable[[Any], Any] | None = None
    size: tuple[int, int] = SIZE

    def compile(self, compile_graph: Callable[..., Any], **options: Any) -> Any:
        """Compile it with everything it needs."""
        known = {"externals": self.externals, "keep": self.keep, "requirements": self.requirements}
        return compile_graph(self.nodes, self.size, self.outputs, **(known | options))


@dataclass
class _Value:
    """What a pass wrote, as long as it can be read: until somebody draws on top of it."""

    name: str
    root: str
    format: str | None
    shape: tuple[float, tuple[int, int] | None] = (1.0, None)
    samples: int = 1
    bytes: int = 0
    continued: bool = False
    keepable: bool = True
    """Whether it is the frame's own: what is somebody else's is no output, and has no history."""


@dataclass
class _Maker:
    random: np.random.Generator
    words: Any
    count: int
    why_not: float
    names: dict[str, _Value] = field(default_factory=dict)
    """The value that each name stands for, those of passes that are left out included."""
    nodes: list[Any] = field(default_factory=list)
    externals: dict[str, Any] = field(default_factory=dict)
    recent: list[str] = field(default_factory=list)
    screens: dict[str, _Value] = field(default_factory=dict)
    """Externals that wait for somebody to write them, by their own names."""

    def chance(self, share: float) -> bool:
        return bool(self.random.random() < share)

    def one(self, items: Any) -> Any:
        return items[int(self.random.integers(len(items)))]

    def live(self, taken: set[str], fits: Callable[[_Value], bool]) -> list[str]:
        """The recent names whose values can still be read and whose resources this pass does not use yet."""
        return [
            name
            for name in self.recent[-NEAR:]
            if not (value := self.names[name]).continued and value.root not in taken and fits(value)
        ]

    # --- what comes from outside --------------------------------------------------------------------------------------

    def make_externals(self) -> None:
        """Textures, constants, and things of somebody else that passes of the frame write to."""
        touch = self.words.Touch
        ready = [touch("", frozenset(), frozenset()), _touch(touch, "", "vertex fragment compute", "uniform")]
        for number in range(int(self.random.integers(0, 3))):
            name = f"constants{number}"
            self._external(name, None, self.one(ready), None, bytes=256)
        for number in range(int(self.random.integers(0, 3))):
            enters = self.one(
                [
                    touch("read", frozenset(), frozenset()),
                    _touch(touch, "read", "fragment compute", "sampled"),
                    _touch(touch, "copy_target", "copy", "copy_write"),
                    _touch(touch, "color", "color", "color_read color_write"),
                ]
            )
            leaves = self.one([None, None, enters, _touch(touch, "read", "fragment", "sampled")])
            self._external(f"texture{number}", self.one(COLORS), enters, leaves)
        if self.chance(0.5):
            leaves = self.one(
                [None, _touch(touch, "", "host", "host_read"), _touch(touch, "", "copy", "copy_read")]
            )
            enters = self.one([ready[0], _touch(touch, "", "compute", "storage_write")])
            self._external("counters", None, enters, leaves, bytes=64)
        if self.chance(0.5):
            enters = self.one(
                [touch("undefined", frozenset(), frozenset()), touch("read", frozenset(), frozenset())]
            )
            leaves = self.one([None, _touch(touch, "copy_source", "copy", "copy_read")])
            self._external("screen", "rgba8", enters, leaves)
            self.screens["screen"] = self.names.pop(self.recent.pop())

    def _external(self, name: str, format: str | None, enters: Any, leaves: Any, bytes: int = 0) -> None:
        shape = self.one(SIZES)
        size = None if bytes else (shape[1] or (int(SIZE[0] * shape[0]), int(SIZE[1] * shape[0])))
        self.externals[name] = self.words.External(format, size, enters, leaves, bytes)
        value = _Value(name, name, format, (1.0, size), bytes=bytes, keepable=False)
        self.names[name] = value
        self.recent.append(name)

    # --- passes -------------------------------------------------------------------------------------------------------

    def make_pass(self, number: int) -> None:
        name = f"pass{number}"
        left_out = self.chance(self.why_not)
        taken: set[str] = set()
        kind = self.one(("graphics", "graphics", "compute", "compute", "copy"))
        made = {"graphics": self._graphics, "compute": self._compute, "copy": self._copy}[kind](name, taken)
        reads, writes = made or self._graphics(name, taken)
        if left_out:
            writes = [self._leave_out(access) for access in writes]
        else:
            writes += self._to_screen(writes)
            for access in writes:
                self._publish(access)
        order = self.random.permutation(len(reads))
        reason = "nothing to do" if left_out else ""
        self.nodes.append(self.words.Node(name, tuple(reads[i] for i in order), tuple(writes), reason))

    def _to_screen(self, writes: list[Access]) -> list[Access]:
        """What a pass writes besides `writes`: an external by its own name, if it can."""
        use = next((access.use for access in writes if access.use != "storage"), "storage")
        for name, value in self.screens.items():
            if use in ("storage", "copy"):
                return [Access(name, use)] if self.chance(0.3) else []
            shapes = [
                (self.names[access.of].shape if access.of else (access.scale, access.size), access.samples)
                for access in writes
                if access.use in ("color", "depth")
            ]
            if all(_pixels(shape) == _pixels(value.shape) and samples == 1 for shape, samples in shapes):
                return [Access(name, "color", clear=self.one([None, (0.0, 0.0, 0.0, 1.0)]))]
        return []

    def _publish(self, access: Access) -> None:
        if access.resource in self.screens:
            value = self.screens.pop(access.resource)
        elif access.of:
            before = self.names[access.of]
            before.continued = True
            value = replace(before, name=access.resource, continued=False)
        else:
            shape = (1.0, access.size) if access.size else (access.scale, None)
            value = _Value(
                access.resource, access.resource, access.format, shape, access.samples, access.bytes
            )
        self.names[access.resource] = value
        self.recent.append(access.resource)

    def _leave_out(self, access: Access) -> Access:
        """What a pass that is left out declares; its readers get another value, or there are none."""
        if access.of:
            other = access.of
        else:
            same = (access.format, access.samples, access.bytes)
            found = self.live(set(), lambda value: (value.format, value.samples, value.bytes) == same)
            other = self.one(found) if found else ""
        if other:
            self.names[access.resource] = self.names[other]
            self.recent.append(access.resource)
        return access if access.of or not other else replace(access, instead=other)

    def _graphics(self, name: str, taken: set[str]) -> tuple[list[Access], list[Access]]:
        shape, samples = self.one(SIZES), 4 if self.chance(0.15) else 1
        reads: list[Access] = []
        writes: list[Access] = []
        found = self.live(taken, lambda value: value.format is not None)
        if found and self.chance(0.6):
            begun = self.names[self.one(found)]
            shape, samples = begun.shape, begun.samples
        fits = lambda value: _pixels(value.shape) == _pixels(shape) and value.samples == samples  # noqa: E731
        depth = self.one(("none", "new", "on top", "tested", "tested", "tested"))
        found = self.live(taken, lambda value: value.format == "d32f" and fits(value))
        if depth == "new" or (depth == "on top" and not found):
            clear = (0.0,) if self.chance(0.8) else None
            writes.append(self._new(f"{name}.depth", "depth", "d32f", shape, samples, clear))
        elif found and depth != "none":
            old = self.one(found)
            taken.add(self.names[old].root)
            if depth == "on top":
                writes.append(Access(f"{name}.depth", "depth", of=old, samples=samples))
            else:
                reads.append(Access(old, "depth", samples=samples))
                if self.chance(0.3):
                    reads.append(Access(old, "sampled", samples=samples))
        for number in range(int(self.random.integers(0 if writes else 1, 4))):
            target = f"{name}.color{number}"
            found = self.live(taken, lambda value: value.format in COLORS and fits(value))
            if found and self.chance(0.5):
                old = self.one(found)
                taken.add(self.names[old].root)
                writes.append(Access(target, "color", of=old, samples=samples))
            else:
                clear = (0.0, 0.0, 0.0, 1.0) if self.chance(0.5) else None
                writes.append(self._new(target, "color", self.one(COLORS), shape, samples, clear))
        reads += self._shader_reads(taken, ((), (), ("vertex",), ("vertex", "fragment")))
        if self.chance(0.15):
            writes.append(Access(f"{name}.counts", "storage", bytes=int(self.random.integers(1, 5000))))
        return reads, writes

    def _compute(self, name: str, taken: set[str]) -> tuple[list[Access], list[Access]]:
        reads: list[Access] = []
        writes: list[Access] = []
        for number in range(int(self.random.integers(1, 3))):
            target = f"{name}.made{number}"
            found = self.live(taken, lambda value: value.samples == 1 and value.format != "d32f")
            if found and self.chance(0.3):
                old = self.one(found)
                taken.add(self.names[old].root)
                writes.append(Access(target, "storage", of=old, bytes=self.names[old].bytes))
            elif self.chance(0.4):
                writes.append(Access(target, "storage", bytes=int(self.random.integers(1, 100_000))))
            else:
                writes.append(self._new(target, "storage", self.one(COLORS), self.one(SIZES)))
        return reads + self._shader_reads(taken, ((),)), writes

    def _copy(self, name: str, taken: set[str]) -> tuple[list[Access], list[Access]] | None:
        found = self.live(taken, lambda value: value.samples == 1)
        if not found:
            return None
        source = self.one(found)
        value = self.names[source]
        taken.add(value.root)
        target = Access(f"{name}.copy", "copy", bytes=value.bytes)
        if value.format is not None:
            target = self._new(f"{name}.copy", "copy", value.format, value.shape)
        return [Access(source, "copy")], [target]

    def _new(
        self, name: str, use: Any, format: str, shape: Any, samples: int = 1, clear: Any = None
    ) -> Access:
        scale, size = shape
        return Access(name, use, format, scale=scale, clear=clear, samples=samples, size=size)

    def _shader_reads(self, taken: set[str], stages: tuple[tuple[str, ...], ...]) -> list[Access]:
        reads = []
        for _ in range(int(self.random.integers(0, 4))):
            found = self.live(taken, lambda value: True)
            if not found:
                break
            name = self.one(found)
            value = self.names[name]
            taken.add(value.root)
            if value.bytes:
                uses: tuple[Any, ...] = ("storage", "uniform", "indirect")
            else:
                uses = (
                    ("sampled", "storage") if value.samples == 1 and value.format != "d32f" else ("sampled",)
                )
            use = self.one(uses)
            where = () if use == "indirect" else self.one(stages)
            if use == "uniform" and stages != ((),):
                where = where or (
                    "fragment",
                )  # constants are read in both shaders of a draw, unless it says so
            reads.append(Access(name, use, samples=value.samples, stages=where))
            if value.bytes and self.chance(0.2):
                reads.append(Access(name, "indirect"))
        return [*dict.fromkeys(reads)]

    # --- what is wanted -----------------------------------------------------------------------------------------------

    def ends(self) -> list[str]:
        """The names of this frame's own values that nobody draws on top of."""
        return [name for name, value in self.names.items() if not value.continued and value.keepable]

    def make_histories(self) -> None:
        """Let some passes read what the frame before wrote."""
        found = [name for name in self.ends() if self.names[name].samples == 1]
        if not found:
            return
        for _ in range(int(self.random.integers(0, 1 + max(1, self.count // 4)))):
            number = int(self.random.integers(len(self.nodes)))
            node, name = self.nodes[number], self.one(found)
            value = self.names[name]
            old = {self.names[a.resource].root for a in node.reads if a.previous and a.resource in self.names}
            if node.kind == "copy" or value.root in old:
                continue
            read = Access(name, "storage" if value.bytes else "sampled", previous=True)
            self.nodes[number] = replace(node, reads=(*node.reads, read))


def _pixels(shape: tuple[float, tuple[int, int] | None]) -> tuple[int, int]:
    scale, size = shape
    return size or (int(SIZE[0] * scale), int(SIZE[1] * scale))


def _touch(make: Any, layout: str, stages: str, access: str) -> Any:
    return make(layout, frozenset(stages.split()), frozenset(access.split()), "_write" in access)


def random_graph(
    seed: int, words: Any, most: int = 12, count: int | None = None, why_not: float = 0.15
) -> RandomGraph:
    """Return a random frame of 1 to `most` passes, or of `count`; the same seed gives the same one.

    `words` is the chapter's module of the types of the frame graph.
    """
    random = np.random.default_rng(seed)
    maker = _Maker(random, words, count or int(random.integers(1, most + 1)), why_not)
    maker.make_externals()
    for number in range(maker.count):
        maker.make_pass(number)
    maker.make_histories()
    ends = maker.ends()
    wanted = {
        name for name in ends if maker.chance(max(0.25, 1.5 / maker.count) if maker.count < 100 else 0.1)
    }
    wanted |= {*ends[-1:]}
    keep = [name for name in ends if maker.chance(0.05)]
    order = random.permutation(len(maker.nodes))
    salt = int(random.integers(1 << 30))
    return RandomGraph(
        tuple(maker.nodes[i] for i in order),
        tuple(sorted(wanted)),
        maker.externals,
        tuple(keep),
        lambda resource: _requirement(resource, words, salt),
    )


def _requirement(resource: Any, words: Any, salt: int) -> Any:
    """A memory requirement that only depends on the resource's name: sizes are odd, alignments and padding differ."""
    random = np.random.default_rng([salt, *resource.name.encode()])
    size = int(random.integers(1, 1 << int(random.integers(4, 22))))
    types = int((1, 3, 6, 7)[int(random.integers(4))])
    alignment = 1 << int(random.integers(0, 13))
    return words.Requirement(size, alignment, types, max(0, int(random.integers(-size, size // 2 + 1))))
