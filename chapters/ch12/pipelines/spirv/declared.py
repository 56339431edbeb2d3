"""The declarations of a shader: blocks with their bytes, descriptors, entry points and specialization constants.

`parser` reads them from a compiled shader. `mismatch` compares a block with the numpy record that fills it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from common.errors import ShaderError

Number = int | float | bool

Kind = Literal[
    "uniform",
    "dynamic uniform",
    "storage",
    "dynamic storage",
    "texture",
    "sampled image",
    "sampler",
    "image",
    "uniform texels",
    "storage texels",
    "input attachment",
    "acceleration structure",
]
"""The kind of a binding. "texture" is an image with its sampler, "image" is one that shaders write to. SPIR-V has no
dynamic buffers, whose offset is given at each bind: `pipelines.vulkan_reflection` sets these kinds."""


@dataclass(frozen=True)
class Member:
    """A member of a block. `counts` are the lengths of an array, outermost first, 0 for an unsized one.

    `size` is without padding after the member; an unsized array counts as 0. `strides` belong to `counts`;
    `matrix_stride` is the distance between the columns of a matrix (rows, if `row_major`). All are in bytes.
    """

    name: str
    type: str  # as GLSL writes it; the name of a struct
    offset: int
    size: int
    counts: tuple[int, ...] = ()
    strides: tuple[int, ...] = ()
    matrix_stride: int = 0
    row_major: bool = False
    members: tuple[Member, ...] = ()


@dataclass(frozen=True)
class Block:
    """The struct of a buffer or of push constants; `size` is the smallest size of its data in bytes."""

    name: str
    size: int
    members: tuple[Member, ...]


@dataclass(frozen=True)
class Resource:
    """A variable with a descriptor. `count` is 1, the length of an array, or 0 for an unsized array."""

    set: int
    binding: int
    kind: Kind
    count: int
    name: str  # of the variable; "" for a block without an instance name
    type: str  # as GLSL writes it; the name of a block
    block: Block | None = None


@dataclass(frozen=True)
class EntryPoint:
    """The function where a stage begins. `local_size` is the size of a work group; None for stages without groups."""

    stage: str
    name: str
    local_size: tuple[int, int, int] | None = None


@dataclass(frozen=True)
class SpecConstant:
    """A constant whose value is set when a pipeline is built; `size` is in bytes, as the driver expects it."""

    id: int
    name: str
    type: str
    size: int
    default: Number

    def encoded(self, value: Number) -> bytes:
        """Return `value` as the bytes that the driver reads; raise ShaderError if the constant cannot have it."""
        try:
            value = value.item() if isinstance(value, np.generic) else value
            if isinstance(value, bool) != (
                self.type == "bool"
            ):  # VkBool32 is 0 or 1, and a number is no bool
                raise ValueError
            if isinstance(value, float) and not (self.type in ("float", "double") and math.isfinite(value)):
                raise ValueError
            return struct.pack("<" + number_format(self.type, self.size), value)
        except (struct.error, ValueError, OverflowError):
            raise ShaderError(
                f"The specialization constant '{self.name}' is {self.type}: it cannot be {value!r}."
            ) from None


@dataclass(frozen=True)
class Module:
    """The declarations of a SPIR-V module."""

    version: tuple[int, int]
    bound: int
    entries: tuple[EntryPoint, ...]
    resources: tuple[
        Resource, ...
    ]  # by set, binding and order of declaration; several names may share a binding
    push: Block | None
    constants: tuple[SpecConstant, ...]
    inputs: tuple[tuple[int, str], ...]  # (location, name) of values from the stage before or a vertex buffer


def number_format(type_: str, size: int) -> str:
    """Return the format letter of `struct` for a number of this GLSL type and size; a bool is VkBool32."""
    if type_.startswith(("f", "d")):
        return {2: "e", 4: "f", 8: "d"}[size]
    letter = {1: "b", 2: "h", 4: "i", 8: "q"}[size]
    return letter if type_.startswith("i") else letter.upper()


def extent(members: Sequence[Member]) -> int:
    """Return the bytes up to the end of the last member."""
    return max((member.offset + member.size for member in members), default=0)


def mismatch(members: Sequence[Member], record: np.dtype[Any], stride: int = 0) -> str:
    """Return the first difference between a numpy record and members of a block, as a sentence, or "" if they match.

    Every member must be a field at the same byte and of the same size. For the elements of an unsized array, pass the
    members of an element, and the array's `stride`: it must be the size of the record.
    """
    fields: Mapping[str, Any] = record.fields or {}
    for member in members:
        if member.name not in fields:
            return f"'{member.name}' at byte {member.offset} of the block is no field of the record."
        type_, offset = fields[member.name][:2]
        if offset != member.offset:
            return (
                f"'{member.name}' is at byte {member.offset} of the block and at byte {offset} of the record."
            )
        if type_.itemsize != member.size:
            return f"'{member.name}' has {member.size} bytes in the block and {type_.itemsize} in the record."
        inner = mismatch(member.members, type_.base) if member.members else ""
        if inner:
            return f"In '{member.name}', {inner}"
    for name in fields:
        if all(member.name != name for member in members):
            return f"The field '{name}' of the record is no member of the block."
    if stride and stride != record.itemsize:
        return f"The records are {stride} bytes apart in the block, and one has {record.itemsize}."
    return ""
