"""Modules put together word by word, after SPIR-V specification 1.6, section 3: opcodes below and above 255."""

from __future__ import annotations

import struct
from typing import Any

from common.errors import ShaderError
from tools.exercises.checking import Given, NotYet


def instruction(opcode: int, *operands: int) -> list[int]:
    """Return the words of one instruction: how many, and which, in the first."""
    return [(len(operands) + 1) << 16 | opcode, *operands]


MAIN = struct.unpack("<2I", b"main\0\0\0\0")
ENTRY = instruction(15, 5, 1, *MAIN)  # OpEntryPoint GLCompute %1 "main"


def assembled(*parts: list[int]) -> bytes:
    """Return a module of version 1.6 whose ids are below 100."""
    words = [0x07230203, 0x00010600, 0, 100, 0, *(word for part in parts for word in part)]
    return struct.pack(f"<{len(words)}I", *words)


def bound(type_: list[int], storage: int) -> bytes:
    """Return a module with one variable, of the type %10, at set 1, binding 3."""
    marks = instruction(71, 12, 34, 1), instruction(71, 12, 33, 3)  # OpDecorate DescriptorSet, Binding
    pointer = instruction(32, 11, storage, 10)
    return assembled(ENTRY, *marks, type_, pointer, instruction(59, 11, 12, storage))


def parsed(given: Given, code: bytes, what: str) -> Any:
    """Return what the copy's parser makes of a module that has `what`."""
    try:
        return given.module("pipelines.spirv.parser").parse(code)
    except ShaderError as error:
        raise NotYet(f"A module with {what} is refused: {error}") from None


def check(given: Given) -> None:
    """An old type, a new one, and a work group that is said in the new way."""
    for name, kind, type_ in (
        ("a sampler (opcode 26)", "sampler", instruction(26, 10)),
        ("an acceleration structure (opcode 5341)", "acceleration structure", instruction(5341, 10)),
    ):
        resources = parsed(given, bound(type_, 0), name).resources
        found = [(one.set, one.binding, one.kind) for one in resources]
        given.need(
            found == [(1, 3, kind)],
            f"A module with {name} at set 1 and binding 3 has {found or 'no resource'}.",
        )
    constants = [instruction(43, 20, 21 + n, size) for n, size in enumerate((8, 4, 2))]
    by_id = instruction(331, 1, 38, 21, 22, 23)  # OpExecutionModeId %1 LocalSizeId
    code = assembled(ENTRY, by_id, instruction(21, 20, 32, 0), *constants)
    module = parsed(given, code, "a work group, said by OpExecutionModeId (opcode 331)")
    size = module.entries[0].local_size
    given.need(
        size == (8, 4, 2),
        f"A work group of 8 x 4 x 2, said by OpExecutionModeId (opcode 331), is read as {size}.",
    )
