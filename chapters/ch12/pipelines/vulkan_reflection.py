"""Reflection: the declarations of a pipeline's stages, merged into the signature of its layout.

SPIR-V already contains the descriptors of each set and the size of the push constants, so no other code repeats them.
`merge` combines the stages and checks that they agree. SPIR-V has no dynamic buffers, whose offset is given at each
bind: a buffer is dynamic if its name begins with `dyn_`, or is in the list `dynamic`. `pipelines.vulkan_layouts`
creates the Vulkan objects from a signature.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from backends.shader_text import ShaderSource
from backends.vulkan import api as vk
from common.errors import ShaderError
from common.names import suggest

from .specialization import Values, assigned
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
    """Return the declarations of a module with these values of its constants; cached, since pipelines share stages."""
    return parser.parse(code, dict(constants))


@dataclass(frozen=True)
class Binding:
    """One binding of a set. `count` is 0 for an unsized array; `stages` are those that declare it."""

    number: int
    kind: Kind
    count: int
    name: str
    stages: int


@dataclass(frozen=True)
class Push:
    """The range of push constants of a pipeline, in bytes, and the stages that read them."""

    offset: int
    size: int
    stages: int


@dataclass(frozen=True)
class Signature:
    """The bindings and push constants of all stages of a pipeline. `sets` is by number; an unused set is empty."""

    sets: tuple[tuple[Binding, ...], ...]
    push: Push | None
    stages: int


@dataclass(frozen=True)
class Stage:
    """One stage of a pipeline: its SPIR-V, its source text, and the values of specialization constants by id."""

    code: bytes
    source: ShaderSource | None = None
    constants: tuple[tuple[int, Number], ...] = ()

    @property
    def module(self) -> Module:
        """The declarations of the stage, with the values of its constants."""
        try:
            return parse(self.code, self.constants)
        except SpirvError as error:
            if self.source is None:
                raise
            raise ShaderError(f"{self.source.name}: {error}", self.source.paths) from None

    @property
    def name(self) -> str:
        """The stage, as the suffix of a shader file."""
        return self.module.entries[0].stage


# --- merging ------------------------------------------------------------------------------------------------


def merge(stages: Sequence[Stage], dynamic: Collection[str] = ()) -> Signature:
    """Return the signature of a pipeline with these stages, in any order.

    `dynamic` names buffers whose offset is given at each bind, besides those that begin with `dyn_`. Raises
    ShaderError, with the file and line of both declarations, if two stages disagree about a binding.
    """
    stages = sorted(stages, key=lambda stage: (_ORDER.index(stage.name), stage.code))
    declaring: dict[tuple[int, int], tuple[Stage, Resource]] = {}
    seen: dict[tuple[int, int], int] = {}
    dynamic_places: set[tuple[int, int]] = set()
    names: set[str] = set()
    for stage in stages:
        for resource in stage.module.resources:
            place = resource.set, resource.binding
            first_stage, first = declaring.setdefault(place, (stage, resource))
            joined = _joined(first, resource, stage is first_stage)
            if joined is None:
                raise _disagreement(first_stage, first, stage, resource)
            declaring[place] = first_stage, joined
            seen[place] = seen.get(place, 0) | STAGES[stage.name]
            if resource.block:
                own = {resource.name, resource.type} - {""}
                names |= own
                if any(name in dynamic or name.startswith("dyn_") for name in own):
                    dynamic_places.add(place)
    for name in dynamic:
        if name not in names:
            raise ShaderError(f"No stage has a buffer '{name}' that could be dynamic{_near(name, names)}")
    sets: list[list[Binding]] = [[] for _ in range(max((set_ + 1 for set_, _ in declaring), default=0))]
    for place in sorted(declaring):
        declaration = declaring[place][1]
        kind = _DYNAMIC[declaration.kind] if place in dynamic_places else declaration.kind
        sets[place[0]].append(
            Binding(place[1], kind, declaration.count, declaration.name or declaration.type, seen[place])
        )
    return Signature(
        tuple(tuple(bindings) for bindings in sets),
        _push(stages),
        sum({STAGES[stage.name] for stage in stages}),
    )


def _joined(first: Resource, other: Resource, same_stage: bool) -> Resource | None:
    """Return the combination of two variables at one binding, or None if they disagree.

    Within a stage several names may share a binding, as `sampler2D t[]` and `sampler3D u[]` do; of several blocks the
    larger one counts. An unsized array and an array with a length combine to an unsized one: if a stage indexes an
    array only by constants, the compiler gives the array a length.
    """
    if first.kind != other.kind or (first.count != other.count and 0 not in (first.count, other.count)):
        return None
    if first.block and other.block and first.block.size != other.block.size:
        if not same_stage:
            return None
        first = max(first, other, key=lambda declaration: declaration.block.size if declaration.block else 0)
    return replace(first, count=min(first.count, other.count))


def _near(name: str, names: Collection[str]) -> str:
    near = suggest(name, names)
    return near if near.endswith("?") else f"{near}."


def _push(stages: Sequence[Stage]) -> Push | None:
    """Return one range for all stages: vkCmdPushConstants must name every stage of a range that it writes anyway."""
    blocks = [(stage, block) for stage in stages if (block := stage.module.push)]
    if not blocks:
        return None
    first = min(block.members[0].offset for _, block in blocks) // 4 * 4
    last = -(-max(block.size for _, block in blocks) // 4) * 4
    return Push(first, last - first, sum({STAGES[stage.name] for stage, _ in blocks}))


# --- places of declarations ---------------------------------------------------------------------------------


def _disagreement(stage: Stage, declaration: Resource, other_stage: Stage, other: Resource) -> ShaderError:
    files = [
        path for declaring in (stage, other_stage) if declaring.source for path in declaring.source.paths
    ]
    return ShaderError(
        f"Set {declaration.set}, binding {declaration.binding} is {_described(declaration)} in "
        f"{declared_at(stage, declaration)} and "
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
    """Return "file:line" of a declaration, or "shader (file:line)" if it is in an include."""
    word = re.escape(resource.type if resource.block else resource.name)
    return _place(stage, rf"\b(?:uniform|buffer)\b[^;{{}}()]*\b{word}\b", {resource.set, resource.binding})


def _place(stage: Stage, pattern: str, numbers: set[int]) -> str:
    """Return the place of `pattern` in a stage's text, preferably after a layout with all of `numbers`."""
    if stage.source is None:
        return f"the .{stage.name} shader"
    places = []
    for file in stage.source.files[1:]:
        text = "\n".join(line.partition("//")[0] for line in file.lines)
        for match in re.finditer(pattern, text):
            layout = text[max(text.rfind(end, 0, match.start()) for end in ";}") + 1 : match.start()]
            # A name may be declared under several conditions: prefer the declaration with these numbers.
            fits = numbers <= {int(number) for number in re.findall(r"\d+", layout)}
            places.append((not fits, file.name, text.count("\n", 0, match.start()) + 1))
    if not places:
        return stage.source.name
    _, name, line = min(places, key=lambda place: place[0])
    place = f"{name}:{line}"
    return place if name == stage.source.name else f"{stage.source.name} ({place})"


def check_pulled(stage: Stage) -> None:
    """Raise ShaderError if a vertex shader has inputs from vertex buffers."""
    if stage.name == "vert" and stage.module.inputs:
        location, name = stage.module.inputs[0]
        place = _place(stage, rf"\bin\b[^;{{}}()]*\b{re.escape(name)}\b", {location})
        raise ShaderError(
            f"{place}: '{name}' at location {location} comes from a vertex buffer, and this chapter has none: read it "
            "from a storage buffer, at VERTEX_ID.",
            stage.source.paths if stage.source else (),
        )


# --- specialization -----------------------------------------------------------------------------------------


def chosen(stages: Sequence[Stage], values: Values, offered: Values = ()) -> list[Stage]:
    """Return the stages with values of their specialization constants; see `specialization.assigned`."""
    constants = assigned([stage.module.constants for stage in stages], values, offered)
    return [replace(stage, constants=own) for stage, own in zip(stages, constants, strict=True)]
