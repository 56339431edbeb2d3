"""Reflection: what the stages of a pipeline declare, merged into the signature that its layout must have.

Which descriptors the sets of a pipeline hold and how many bytes of push constants it takes is in the SPIR-V already;
so nobody writes it down a second time. `merge` brings the stages together and finds out whether they agree. One thing
SPIR-V does not say is whether a buffer's offset comes with the bind: a name that begins with `dyn_` says so here, or
`dynamic`, a list of names. From a signature `pipelines.vulkan_layouts` makes the objects.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from backends.shader_text import ShaderSource
from backends.vulkan import api as vk
from common.errors import ShaderError
from common.names import suggest

from .spirv import parser
from .spirv.declared import Kind, Module, Number, Resource
from .spirv.words import SpirvError

STAGES = {
    "vert": vk.VK_SHADER_STAGE_VERTEX_BIT,
    "task": vk.VK_SHADER_STAGE_TASK_BIT_EXT,
    "mesh": vk.VK_SHADER_STAGE_MESH_BIT_EXT,
    "tesc": vk.VK_SHADER_STAGE_TESSELLATION_CONTROL_BIT,
    "tese": vk.VK_SHADER_STAGE_TESSELLATION_EVALUATION_BIT,
    "geom": vk.VK_SHADER_STAGE_GEOMETRY_BIT,
    "frag": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
    "comp": vk.VK_SHADER_STAGE_COMPUTE_BIT,
    "rgen": vk.VK_SHADER_STAGE_RAYGEN_BIT_KHR,
    "rint": vk.VK_SHADER_STAGE_INTERSECTION_BIT_KHR,
    "rahit": vk.VK_SHADER_STAGE_ANY_HIT_BIT_KHR,
    "rchit": vk.VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR,
    "rmiss": vk.VK_SHADER_STAGE_MISS_BIT_KHR,
    "rcall": vk.VK_SHADER_STAGE_CALLABLE_BIT_KHR,
}
"""The bit of each stage, in the order of the pipeline."""

_ORDER = list(STAGES)
_DYNAMIC: dict[Kind, Kind] = {"uniform": "dynamic uniform", "storage": "dynamic storage"}


@lru_cache(256)
def parse(code: bytes, constants: tuple[tuple[int, Number], ...] = ()) -> Module:
    """Return what a module declares, with these values of its constants; many pipelines share a stage."""
    return parser.parse(code, dict(constants))


@dataclass(frozen=True)
class Binding:
    """One binding of a set. `count` is 0 for an array with an open end; `stages` are those that declare it."""

    number: int
    kind: Kind
    count: int
    name: str
    stages: int


@dataclass(frozen=True)
class Push:
    """The bytes of push constants that a pipeline takes, and the stages that read them."""

    offset: int
    size: int
    stages: int


@dataclass(frozen=True)
class Signature:
    """What the stages of a pipeline ask for together. `sets` is by number; a set that no stage uses is empty."""

    sets: tuple[tuple[Binding, ...], ...]
    push: Push | None
    stages: int


@dataclass(frozen=True)
class Stage:
    """One stage of a pipeline: its SPIR-V, the text that it was made from, its specialization constants by id."""

    code: bytes
    source: ShaderSource | None = None
    constants: tuple[tuple[int, Number], ...] = ()

    @property
    def module(self) -> Module:
        """What the stage declares, with the values that its constants have."""
        try:
            return parse(self.code, self.constants)
        except SpirvError as error:
            if self.source is None:
                raise
            raise ShaderError(f"{self.source.name}: {error}", self.source.paths) from None

    @property
    def name(self) -> str:
        """The stage, as the suffix of a shader file says it."""
        return self.module.entries[0].stage


# --- merging ------------------------------------------------------------------------------------------------


def merge(stages: Sequence[Stage], dynamic: Collection[str] = ()) -> Signature:
    """Return what the stages of one pipeline ask for together; their order makes no difference.

    `dynamic` names buffers whose offset comes with the bind, beside those that begin with `dyn_`. Raises ShaderError,
    with the file and line of both declarations, where two stages disagree about a binding.
    """
    stages = sorted(stages, key=lambda stage: (_ORDER.index(stage.name), stage.code))
    found: dict[tuple[int, int], tuple[Stage, Resource]] = {}
    seen: dict[tuple[int, int], int] = {}
    moving: set[tuple[int, int]] = set()
    names: set[str] = set()
    for stage in stages:
        for resource in stage.module.resources:
            place = resource.set, resource.binding
            first_stage, first = found.setdefault(place, (stage, resource))
            joined = _joined(first, resource, stage is first_stage)
            if joined is None:
                raise _disagreement(first_stage, first, stage, resource)
            found[place] = first_stage, joined
            seen[place] = seen.get(place, 0) | STAGES[stage.name]
            if resource.block:
                own = {resource.name, resource.type} - {""}
                names |= own
                if any(name in dynamic or name.startswith("dyn_") for name in own):
                    moving.add(place)
    for name in dynamic:
        if name not in names:
            raise ShaderError(f"No stage has a buffer '{name}' that could be dynamic{_near(name, names)}")
    sets: list[list[Binding]] = [[] for _ in range(max((set_ + 1 for set_, _ in found), default=0))]
    for place in sorted(found):
        one = found[place][1]
        kind = _DYNAMIC[one.kind] if place in moving else one.kind
        sets[place[0]].append(Binding(place[1], kind, one.count, one.name or one.type, seen[place]))
    return Signature(
        tuple(tuple(bindings) for bindings in sets),
        _push(stages),
        sum({STAGES[stage.name] for stage in stages}),
    )


def _joined(first: Resource, other: Resource, same_stage: bool) -> Resource | None:
    """Return what two variables at one place are together, or None where they disagree.

    In one stage names may share a place, as `sampler2D t[]` and `sampler3D u[]` do, and of blocks that do the larger
    counts. An open array takes one with a length in: where a stage only indexes an array by constants, the compiler has
    given it the length that those need.
    """
    if first.kind != other.kind or (first.count != other.count and 0 not in (first.count, other.count)):
        return None
    if first.block and other.block and first.block.size != other.block.size:
        if not same_stage:
            return None
        first = max(first, other, key=lambda one: one.block.size if one.block else 0)
    return replace(first, count=min(first.count, other.count))


def _near(name: str, names: Collection[str]) -> str:
    near = suggest(name, names)
    return near if near.endswith("?") else f"{near}."


def _push(stages: Sequence[Stage]) -> Push | None:
    """Return one range for all stages: whoever pushes must name every stage of a range that he touches anyway."""
    blocks = [(stage, block) for stage in stages if (block := stage.module.push)]
    if not blocks:
        return None
    first = min(block.members[0].offset for _, block in blocks) // 4 * 4
    last = -(-max(block.size for _, block in blocks) // 4) * 4
    return Push(first, last - first, sum({STAGES[stage.name] for stage, _ in blocks}))


# --- where things are declared ------------------------------------------------------------------------------


def _disagreement(stage: Stage, one: Resource, other_stage: Stage, other: Resource) -> ShaderError:
    files = [path for found in (stage, other_stage) if found.source for path in found.source.paths]
    return ShaderError(
        f"Set {one.set}, binding {one.binding} is {_described(one)} in {declared_at(stage, one)} and "
        f"{_described(other)} in {declared_at(other_stage, other)}: declare the same in both, or give one of them "
        "another binding.",
        files,
    )


def _described(resource: Resource) -> str:
    name = f"'{resource.name or resource.type}'"
    many = (
        ""
        if resource.count == 1
        else f" with {resource.count} elements"
        if resource.count
        else " without an end"
    )
    size = f" of {resource.block.size} bytes" if resource.block else ""
    what = f"{resource.kind} block" if resource.block else resource.kind
    return f"the {what} {name}{size}{many}"


def declared_at(stage: Stage, resource: Resource) -> str:
    """Return "file:line" of a declaration, with the shader's name where an include has it."""
    word = re.escape(resource.type if resource.block else resource.name)
    return _place(stage, rf"\b(?:uniform|buffer)\b[^;{{}}()]*\b{word}\b", {resource.set, resource.binding})


def _place(stage: Stage, pattern: str, numbers: set[int]) -> str:
    """Return where `pattern` stands in a stage's text, at best behind a layout with all of `numbers`."""
    if stage.source is None:
        return f"the .{stage.name} shader"
    places = []
    for file in stage.source.files[1:]:
        text = "\n".join(line.partition("//")[0] for line in file.lines)
        for match in re.finditer(pattern, text):
            layout = text[max(text.rfind(end, 0, match.start()) for end in ";}") + 1 : match.start()]
            # One name may be declared under several conditions: the one that writes these numbers is meant.
            fits = numbers <= {int(number) for number in re.findall(r"\d+", layout)}
            places.append((not fits, file.name, text.count("\n", 0, match.start()) + 1))
    if not places:
        return stage.source.name
    _, name, line = min(places, key=lambda place: place[0])
    place = f"{name}:{line}"
    return place if name == stage.source.name else f"{stage.source.name} ({place})"


def check_pulled(stage: Stage) -> None:
    """Raise ShaderError where a vertex shader expects to be fed from vertex buffers."""
    if stage.name == "vert" and stage.module.inputs:
        location, name = stage.module.inputs[0]
        place = _place(stage, rf"\bin\b[^;{{}}()]*\b{re.escape(name)}\b", {location})
        raise ShaderError(
            f"{place}: '{name}' at location {location} comes from a vertex buffer, and this chapter has none: read it "
            "from a storage buffer, at VERTEX_ID.",
            stage.source.paths if stage.source else (),
        )


# --- specialization -----------------------------------------------------------------------------------------


def chosen(stages: Sequence[Stage], wanted: Mapping[str | int, Number]) -> list[Stage]:
    """Return the stages with values for the specialization constants that they have, by name or by id.

    Raises ShaderError for a constant that no stage has.
    """
    known = {key for stage in stages for one in stage.module.constants for key in (one.name, one.id)}
    for key in wanted:
        if key not in known:
            names = {str(name) for name in known if name != "" and not isinstance(name, int)}
            raise ShaderError(f"No stage has a specialization constant {key!r}{_near(str(key), names)}")
    return [
        replace(
            stage,
            constants=tuple(
                (one.id, wanted[key])
                for one in stage.module.constants
                for key in (one.id, one.name)
                if key in wanted
            ),
        )
        for stage in stages
    ]
