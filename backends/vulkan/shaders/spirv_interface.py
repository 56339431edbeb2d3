"""What a pipeline expects of its program, read from the SPIR-V of its stages: the few instructions that say so.

Only for comparing an edited shader with the one before. Opcodes and operands: SPIR-V specification 1.6, section 3.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from backends.shader_interface import Field, Interface, Slot

_NAME, _MEMBER_NAME, _DECORATE, _MEMBER_DECORATE, _FUNCTION, _VARIABLE, _CONSTANT = 5, 6, 71, 72, 54, 59, 43
_TYPES = range(19, 34)  # OpTypeVoid to OpTypeFunction
_ACCELERATION_STRUCTURE = 5341
_BOOL, _INT, _FLOAT, _VECTOR, _MATRIX = 20, 21, 22, 23, 24
_IMAGE, _SAMPLER, _SAMPLED_IMAGE, _ARRAY, _RUNTIME_ARRAY, _STRUCT, _POINTER = 25, 26, 27, 28, 29, 30, 32
_ARRAY_STRIDE, _MATRIX_STRIDE, _BUILT_IN, _LOCATION, _BINDING, _SET, _OFFSET = 6, 7, 11, 30, 33, 34, 35
_UNIFORM_CONSTANT, _INPUT, _UNIFORM, _OUTPUT, _PUSH, _STORAGE = 0, 1, 2, 3, 9, 12
_BLOCKS = {_UNIFORM: "uniform block", _PUSH: "block of push constants", _STORAGE: "storage block"}
_DIMENSIONS = ("1D", "2D", "3D", "Cube", "2DRect", "Buffer", "SubpassData")
_SCALARS = {_BOOL: "bool", _INT: "int", _FLOAT: "float"}
_SHORT = {"float": "", "int": "i", "uint": "u", "bool": "b", "double": "d"}


class _Variable(NamedTuple):
    pointer: int
    id: int
    storage: int


class Module:
    """The declarations of one SPIR-V module, whose code was checked by `check_module`."""

    def __init__(self, code: bytes) -> None:
        self._words = words = struct.unpack(f"={len(code) // 4}I", code)
        self._names: dict[int, str] = {}
        self._members: dict[tuple[int, int], str] = {}
        self._marks: dict[tuple[int, int], int] = {}  # (id, decoration) -> its number
        self._member_marks: dict[tuple[int, int, int], int] = {}
        self._types: dict[int, tuple[int, tuple[int, ...]]] = {}
        self._constants: dict[int, int] = {}
        self.variables: list[_Variable] = []
        at = 5
        while at < len(words):
            count, opcode = words[at] >> 16, words[at] & 0xFFFF
            if opcode == _FUNCTION or count == 0:
                break  # declarations come first
            self._note(opcode, words[at + 1 : at + count])
            at += count

    def _note(self, opcode: int, rest: tuple[int, ...]) -> None:
        if opcode == _NAME:
            self._names[rest[0]] = _text(rest[1:])
        elif opcode == _MEMBER_NAME:
            self._members[rest[0], rest[1]] = _text(rest[2:])
        elif opcode == _DECORATE:
            self._marks[rest[0], rest[1]] = rest[2] if len(rest) > 2 else 1
        elif opcode == _MEMBER_DECORATE:
            self._member_marks[rest[:3]] = rest[3] if len(rest) > 3 else 1  # type: ignore[index]
        elif opcode in _TYPES or opcode == _ACCELERATION_STRUCTURE:
            self._types[rest[0]] = opcode, rest[1:]
        elif opcode == _CONSTANT:
            self._constants[rest[1]] = rest[2]
        elif opcode == _VARIABLE:
            self.variables.append(_Variable(*rest[:3]))

    # --- types ---

    def pointee(self, variable: _Variable) -> int:
        """Return the type that a variable points to."""
        return self._types[variable.pointer][1][1]

    def kind(self, type_: int) -> str:
        """Return a type as GLSL writes it, with the strides of arrays and matrices."""
        opcode, rest = self._types[type_]
        if opcode == _INT:
            return "int" if rest[1] else "uint"
        if opcode == _FLOAT:
            return "float" if rest[0] == 32 else "double" if rest[0] == 64 else "float16_t"
        if opcode in (_VECTOR, _MATRIX):
            inner, count = self.kind(rest[0]), rest[1]
            if opcode == _VECTOR:
                return f"{_SHORT.get(inner, inner)}vec{count}"
            rows = inner[-1]
            return f"mat{count}" + ("" if rows == str(count) else f"x{rows}")
        if opcode in (_ARRAY, _RUNTIME_ARRAY):
            count_text = str(self._constants.get(rest[1], "?")) if opcode == _ARRAY else ""
            stride = self._marks.get((type_, _ARRAY_STRIDE))
            return f"{self.kind(rest[0])}[{count_text}]" + (f" every {stride} bytes" if stride else "")
        if opcode == _SAMPLED_IMAGE:
            return "sampler" + self._image(rest[0])
        if opcode == _IMAGE:
            return "image" + self._image(type_)
        if opcode == _STRUCT:
            return "struct"
        if opcode == _POINTER:
            return "reference"
        return {_SAMPLER: "sampler", _ACCELERATION_STRUCTURE: "accelerationStructureEXT"}.get(
            opcode, _SCALARS.get(opcode, f"type {opcode}")
        )

    def _image(self, type_: int) -> str:
        sampled, dimension, depth, arrayed, many, _, format_ = self._types[type_][1][:7]
        letter = {"int": "i", "uint": "u"}.get(self.kind(sampled), "")
        name = _DIMENSIONS[dimension] + "MS" * many + "Array" * arrayed + "Shadow" * (depth == 1)
        return name + (f" of {letter}" if letter else "") + (f" in format {format_}" if format_ else "")

    def fields(self, struct_: int, offset: int = 0, prefix: str = "") -> list[Field]:
        """Return the members of a struct with their bytes, and those of structs in it."""
        fields = []
        for number, member in enumerate(self._types[struct_][1]):
            at = offset + self._member_marks.get((struct_, number, _OFFSET), 0)
            name = prefix + self._members.get((struct_, number), str(number))
            stride = self._member_marks.get((struct_, number, _MATRIX_STRIDE))
            kind = self.kind(member) + (f" in columns of {stride} bytes" if stride else "")
            fields.append(Field(name, at, kind))
            inner = member
            while self._types[inner][0] in (_ARRAY, _RUNTIME_ARRAY):
                inner, name = self._types[inner][1][0], name + "[]"
            if self._types[inner][0] == _STRUCT:
                fields += self.fields(inner, at, name + ".")
        return fields

    def _bytes(self, type_: int) -> int:
        """Return the bytes of a type; 0 for an array whose end is open."""
        opcode, rest = self._types[type_]
        if opcode in (_INT, _FLOAT):
            return rest[0] // 8
        if opcode in (_VECTOR, _MATRIX):
            return self._bytes(rest[0]) * rest[1]
        if opcode == _ARRAY:
            return self._constants.get(rest[1], 0) * self._marks.get((type_, _ARRAY_STRIDE), 0)
        if opcode == _STRUCT:
            return max(
                (
                    self._member_marks.get((type_, number, _OFFSET), 0) + self._bytes(member)
                    for number, member in enumerate(rest)
                ),
                default=0,
            )
        return 8 if opcode == _POINTER else 0

    # --- what is at each place ---

    def slot(self, variable: _Variable) -> Slot:
        """Return what a variable stands for."""
        type_ = self.pointee(variable)
        block, suffix = type_, ""
        while self._types[block][0] in (_ARRAY, _RUNTIME_ARRAY):
            block, suffix = self._types[block][1][0], suffix + "[]"
        name = self._names.get(variable.id, "")
        if self._types[block][0] != _STRUCT or variable.storage not in _BLOCKS:
            return Slot(name, self.kind(type_))
        fields = tuple(self.fields(block))
        name = name or (fields[0].name if fields else "") or self._names.get(block, "")
        return Slot(name, _BLOCKS[variable.storage] + suffix, self._bytes(block), fields)

    def place(self, variable: _Variable, stage: str) -> str:
        """Return where the host fills a variable, "" where it does not."""
        if variable.storage == _PUSH:
            return "push constants"
        binding = self._marks.get((variable.id, _BINDING))
        if variable.storage in (_UNIFORM_CONSTANT, _UNIFORM, _STORAGE) and binding is not None:
            return f"set {self._marks.get((variable.id, _SET), 0)}, binding {binding}"
        location = self._marks.get((variable.id, _LOCATION))
        if location is not None and variable.storage == _INPUT and stage == "vert":
            return f"vertex input {location}"
        if location is not None and variable.storage == _OUTPUT and stage == "frag":
            return f"output {location}"
        return ""

    def locations(self, storage: int) -> dict[int, str]:
        """Return the names of what a stage hands on (`_OUTPUT`) or gets (`_INPUT`), by location."""
        return {
            self._marks[variable.id, _LOCATION]: self._names.get(variable.id, "")
            for variable in self.variables
            if variable.storage == storage and (variable.id, _LOCATION) in self._marks
        }


def _text(words: Sequence[int]) -> str:
    raw = struct.pack(f"={len(words)}I", *words)
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


def interface_of(stages: Mapping[str, bytes]) -> Interface:
    """Return what the SPIR-V of each stage ("vert", "frag", "comp", ...) expects of the host, all stages together."""
    slots: dict[str, Slot] = {}
    for stage, code in stages.items():
        module = Module(code)
        for variable in module.variables:
            place = module.place(variable, stage)
            if place:
                slot = module.slot(variable)
                # Stages share their bindings; one that sees something else in a place is compared by itself.
                slots[place if slots.get(place, slot) == slot else f"{place} of stage {stage}"] = slot
    return dict(sorted(slots.items()))


def unwritten(stages: Mapping[str, bytes]) -> str:
    """Return what the fragment shader reads and no vertex shader writes, as the middle of a sentence; "" if nothing.

    Vulkan leaves that undefined, where OpenGL refuses to link.
    """
    if not {"vert", "frag"} <= stages.keys():
        return ""
    written = Module(stages["vert"]).locations(_OUTPUT)
    for location, name in sorted(Module(stages["frag"]).locations(_INPUT).items()):
        if location not in written:
            return f"the fragment shader reads location {location}, '{name}', which no vertex shader writes"
    return ""
