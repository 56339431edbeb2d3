"""What a shader declares: blocks with their bytes, descriptors, entry points and specialization constants.

`parser` reads it from a compiled shader. `mismatch` compares a block with the numpy record that fills it.
"""

from __future__ import annotations

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
"""What a binding holds. "texture" is an image with its sampler, "image" one that shaders write to. SPIR-V does not know
of dynamic buffers, whose offset comes with the bind: who makes the layout decides that."""


@dataclass(frozen=True)
class Member:
    """A member of a block. `counts` are the elements of an array, outermost first, 0 where its end is open.

    `size` is in bytes and without padding behind the member; an open array counts as none. `strides` belong to
    `counts`; `matrix_stride` lies between the columns of a matrix (rows, if `row_major`). All are in bytes.
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
    """The struct behind a buffer or behind push constants; `size` are the bytes that must be there."""

    name: str
    size: int
    members: tuple[Member, ...]


@dataclass(frozen=True)
class Resource:
    """A variable that is reached through a descriptor. `count` is 1, the length of an array, or 0 where it is open."""

    set: int
    binding: int
    kind: Kind
    count: int
    name: str  # of the variable; "" for a block without an instance name
    type: str  # as GLSL writes it; the name of a block
    block: Block | None = None


@dataclass(frozen=True)
class EntryPoint:
    """Where a stage begins. `local_size` are the invocations of a work group; None where there are no groups."""

    stage: str
    name: str
    local_size: tuple[int, int, int] | None = None


@dataclass(frozen=True)
class SpecConstant:
    """A constant that gets its value when a pipeline is built; `size` are the bytes that the driver expects."""

    id: int
    name: str
    type: str
    size: int
    default: Number

    def encoded(self, value: Number) -> bytes:
        """Return `value` as the driver reads it; raise ShaderError where the constant cannot hold it."""
        try:
            if isinstance(value, float) and self.type not in ("float", "double"):
                raise ValueError
            return struct.pack("<" + number_format(self.type, self.size), value)
        except (struct.error, ValueError, OverflowError):
            raise ShaderError(
                f"The specialization constant '{self.name}' is {self.type}: it cannot be {value}."
            ) from None


@dataclass(frozen=True)
class Module:
    """What a SPIR-V module declares."""

    version: tuple[int, int]
    bound: int
    entries: tuple[EntryPoint, ...]
    resources: tuple[
        Resource, ...
    ]  # by set, binding and order of declaration; more than one where names share a place
    push: Block | None
    constants: tuple[SpecConstant, ...]
    inputs: tuple[tuple[int, str], ...]  # (location, name) of what the stage before or a vertex buffer gives


def number_format(type_: str, size: int) -> str:
    """Return the letter with which `struct` packs a number of this GLSL type and size; a bool is VkBool32."""
    if type_.startswith(("f", "d")):
        return {2: "e", 4: "f", 8: "d"}[size]
    letter = {1: "b", 2: "h", 4: "i", 8: "q"}[size]
    return letter if type_.startswith("i") else letter.upper()


def extent(members: Sequence[Member]) -> int:
    """Return the bytes up to the end of the last member."""
    return max((member.offset + member.size for member in members), default=0)


def mismatch(members: Sequence[Member], record: np.dtype[Any], stride: int = 0) -> str:
    """Return where a numpy record differs from these members of a block, as a sentence, or "" where nothing does.

    Every member must be a field at the same byte and of the same size; an array that stays open must be the record's
    own business. `stride` is that of an array of the records, which must then be the size of one.
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
