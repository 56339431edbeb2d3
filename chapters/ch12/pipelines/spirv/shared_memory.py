"""The size of a kernel's shared memory, read from its SPIR-V.

Shared memory contains every variable of the storage class Workgroup. The padding depends on the driver, so the size
here is without padding. A kernel with more bytes than the device's limit cannot run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .declared import Number
from .numbers import Mark, Op
from .words import instructions, words_of

_WORKGROUP = 4
"""The storage class (SPIR-V specification 1.6, section 3.7)."""

_SCALARS = (Op.BOOL, Op.INT, Op.FLOAT)


def shared_bytes(code: bytes, constants: Mapping[int, Number]) -> int:
    """Return the bytes of a module's shared variables; `constants` are values of specialization constants, by id.

    An array whose length is computed from specialization constants counts as one element.
    """
    special: dict[int, int] = {}
    lengths: dict[int, int] = {}
    types: dict[int, tuple[int, Sequence[int]]] = {}
    shared = []
    for _, opcode, operands in instructions(words_of(code)):
        if opcode == Op.DECORATE and operands[1] == Mark.SPEC_ID:
            special[operands[0]] = operands[2]
        elif opcode in (Op.CONSTANT, Op.SPEC_CONSTANT):
            value = constants.get(special.get(operands[1], -1), operands[2])
            lengths[operands[1]] = int(value)
        elif opcode in Op.TYPES:
            types[operands[0]] = opcode, operands[1:]
        elif opcode == Op.VARIABLE and operands[2] == _WORKGROUP:
            shared.append(types[operands[0]][1][1])  # the type that its pointer points to

    def size(type_: int) -> int:
        opcode, operands = types[type_]
        if opcode in _SCALARS:
            return operands[0] // 8 if operands else 4
        if opcode == Op.STRUCT:
            return sum(map(size, operands))
        if opcode == Op.ARRAY:
            return size(operands[0]) * lengths.get(operands[1], 1)
        return size(operands[0]) * operands[1] if opcode in (Op.VECTOR, Op.MATRIX) else 0

    return sum(map(size, shared))
