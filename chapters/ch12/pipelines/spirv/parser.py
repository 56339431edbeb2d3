"""A parser of SPIR-V: it reads the entry points, blocks, descriptors and constants of a compiled shader.

A module is a list of instructions (`words.py`). Each type, constant and variable that an instruction declares has a
number, its id. Names and decorations refer to ids that come later. So the parser first fills tables by id, and then
combines their entries: variable -> pointer type -> type that it points to.

All declarations come before the first function. In the bodies of functions, only the lengths of instructions are
checked. Source: SPIR-V specification 1.6, section 3 (opcodes and numbers, in `numbers.py`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from .declared import (
    Block,
    EntryPoint,
    Kind,
    Member,
    Module,
    Number,
    Resource,
    SpecConstant,
    extent,
    number_format,
)
from .numbers import (
    BUFFER,
    DIMENSIONS,
    LOCAL_SIZE,
    LOCAL_SIZE_ID,
    PARTS,
    PREFIXES,
    SCALARS,
    STAGES,
    SUBPASS,
    WORKGROUP_SIZE,
    Mark,
    Op,
    Storage,
)
from .words import SpirvError, instructions, text, words_of


def parse(code: bytes, specialization: Mapping[int, Number] | None = None) -> Module:
    """Return the declarations of a module, with these values of specialization constants (by id) or their defaults.

    Raises SpirvError for bytes that are not SPIR-V, for damaged SPIR-V, and for variables that a program cannot fill.
    """
    try:
        return _Declarations(code, specialization or {}).module()
    except IndexError:
        raise SpirvError("A type in the SPIR-V lacks a part that it must have.") from None
    except RecursionError:
        raise SpirvError("The structs in the SPIR-V are nested too deeply.") from None


# --- tables by id -------------------------------------------------------------------------------------------


class _Declarations:
    """The tables of one module."""

    def __init__(self, code: bytes, specialization: Mapping[int, Number]) -> None:
        words = words_of(code)
        self._version, self._bound = (words[1] >> 16 & 0xFF, words[1] >> 8 & 0xFF), words[3]
        self._chosen = specialization
        self._names: dict[int, str] = {}
        self._member_names: dict[tuple[int, int], str] = {}
        self._marks: dict[tuple[int, int], int] = {}  # (id, decoration) -> its number
        self._member_marks: dict[tuple[int, int, int], int] = {}  # (id, member, decoration) -> its number
        self._types: dict[int, tuple[int, Sequence[int]]] = {}  # id -> opcode, operands after the id
        self._forward: set[int] = set()
        self._values: dict[int, Number] = {}  # of constants that are one number
        self._composites: dict[int, Sequence[int]] = {}
        self._specials: dict[int, SpecConstant] = {}  # by their own ids, which several constants may share
        self._variables: list[tuple[int, int, int]] = []  # (id, pointer type, storage class)
        self._entries: list[tuple[int, int, str]] = []  # (execution model, id of the function, name)
        self._sizes: dict[int, tuple[bool, Sequence[int]]] = {}  # function -> whether ids, work-group size
        declaring = True
        for at, opcode, operands in instructions(words):
            if opcode == Op.FUNCTION:
                declaring = False
            if declaring:
                try:
                    self._note(opcode, operands)
                except IndexError:
                    raise SpirvError(
                        f"The instruction at word {at} of the SPIR-V, with opcode {opcode}, is too short."
                    ) from None

    def _note(self, opcode: int, operands: Sequence[int]) -> None:
        if opcode == Op.NAME:
            self._names[self._id(operands[0])] = text(operands[1:])
        elif opcode == Op.MEMBER_NAME:
            self._member_names[self._id(operands[0]), operands[1]] = text(operands[2:])
        elif opcode == Op.DECORATE:
            self._marks[self._id(operands[0]), operands[1]] = operands[2] if len(operands) > 2 else 1
        elif opcode == Op.MEMBER_DECORATE:
            place = self._id(operands[0]), operands[1], operands[2]
            self._member_marks[place] = operands[3] if len(operands) > 3 else 1
        elif opcode == Op.ENTRY_POINT:
            self._entries.append((operands[0], self._id(operands[1]), text(operands[2:])))
        elif opcode in (Op.EXECUTION_MODE, Op.EXECUTION_MODE_ID):
            if operands[1] in (LOCAL_SIZE, LOCAL_SIZE_ID):
                self._sizes[self._id(operands[0])] = operands[1] == LOCAL_SIZE_ID, operands[2:5]
        elif opcode == Op.FORWARD_POINTER:
            self._forward.add(self._id(operands[0]))
        elif opcode in Op.TYPES or opcode == Op.ACCELERATION_STRUCTURE:
            self._note_type(opcode, self._new(operands[0]), operands[1:])
        elif Op.TRUE <= opcode <= Op.SPEC_OP:
            self._note_constant(opcode, operands[0], self._new(operands[1]), operands[2:])
        elif opcode == Op.VARIABLE:
            self._variables.append((self._new(operands[1]), self._id(operands[0]), operands[2]))

    def _id(self, word: int) -> int:
        if not 0 < word < self._bound:
            raise SpirvError(
                f"The SPIR-V uses the id {word}, and its header says that ids are below {self._bound}."
            )
        return word

    def _new(self, word: int) -> int:
        if self._id(word) in self._types or word in self._values:
            raise SpirvError(f"The SPIR-V declares the id {word} twice.")
        return word

    def _note_type(self, opcode: int, id_: int, operands: Sequence[int]) -> None:
        for part in operands[PARTS[opcode]] if opcode in PARTS else ():  # so that no type contains itself
            if part not in self._types and part not in self._forward:
                raise SpirvError(f"The SPIR-V uses the type {part} before it declares it.")
        if id_ in self._forward and opcode != Op.POINTER:
            raise SpirvError(f"The SPIR-V says that the type {id_} is a pointer, and declares another one.")
        self._types[id_] = opcode, operands

    def _note_constant(self, opcode: int, type_: int, id_: int, operands: Sequence[int]) -> None:
        if opcode in (Op.COMPOSITE, Op.SPEC_COMPOSITE):
            self._composites[id_] = operands
            return
        if opcode in (Op.TRUE, Op.FALSE, Op.SPEC_TRUE, Op.SPEC_FALSE):
            value: Number = opcode in (Op.TRUE, Op.SPEC_TRUE)
            name, size = "bool", 4  # VkBool32
        elif opcode in (Op.CONSTANT, Op.SPEC_CONSTANT):
            name, size = self._scalar(type_)
            value = _decoded(name, size, operands)
        else:
            return
        number = self._marks.get((id_, Mark.SPEC_ID))
        if number is not None:
            if not (number in self._specials and self._specials[number].name):
                self._specials[number] = SpecConstant(number, self._names.get(id_, ""), name, size, value)
            value = self._chosen.get(number, value)
        self._values[id_] = value

    # --- types ---

    def _type(self, id_: int) -> tuple[int, Sequence[int]]:
        if id_ not in self._types:
            raise SpirvError(f"The SPIR-V uses the type {id_}, which it does not declare.")
        return self._types[id_]

    def _scalar(self, type_: int) -> tuple[str, int]:
        """Return GLSL's name of a scalar type, and its size in bytes."""
        opcode, operands = self._type(type_)
        if opcode == Op.BOOL:
            return "bool", 4
        widths = (8, 16, 32, 64) if opcode == Op.INT else (16, 32, 64)
        if opcode not in (Op.INT, Op.FLOAT) or operands[0] not in widths:
            raise SpirvError(
                f"The type {type_} of the SPIR-V should be a number, and has the opcode {opcode}."
            )
        width, sign = operands[0], operands[1] if opcode == Op.INT else 0
        usual = ("float" if opcode == Op.FLOAT else "int" if sign else "uint") + f"{width}_t"
        return SCALARS.get((opcode, width, sign), usual), width // 8

    def _shape(self, type_: int) -> tuple[str, int, tuple[int, int]]:
        """Return GLSL's name of a scalar, vector or matrix, its size in bytes without strides, and (columns, rows)."""
        opcode, operands = self._type(type_)
        if opcode == Op.VECTOR:
            scalar, size = self._scalar(operands[0])
            prefix = PREFIXES.get(scalar, scalar.removesuffix("_t"))
            return f"{prefix}vec{operands[1]}", size * operands[1], (1, operands[1])
        if opcode == Op.MATRIX:
            column, size, (_, rows) = self._shape(operands[0])
            columns = operands[1]
            shape = f"{columns}" if rows == columns else f"{columns}x{rows}"
            return f"{column.partition('vec')[0]}mat{shape}", size * columns, (columns, rows)
        return *self._scalar(type_), (1, 1)

    def _stripped(self, type_: int, name: str) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
        """Return the innermost type of an array of arrays, its lengths, and its strides in bytes."""
        counts: list[int] = []
        strides: list[int] = []
        opcode, operands = self._type(type_)
        while opcode in (Op.ARRAY, Op.RUNTIME_ARRAY):
            counts.append(self._length(operands[1], name) if opcode == Op.ARRAY else 0)
            strides.append(self._marks.get((type_, Mark.ARRAY_STRIDE), 0))
            type_ = operands[0]
            opcode, operands = self._type(type_)
        return type_, tuple(counts), tuple(strides)

    def _length(self, constant: int, name: str) -> int:
        value = self._values.get(constant)
        if value is None:
            raise SpirvError(
                f"The length of '{name}' is computed from specialization constants: make it a constant of its own, so "
                "that a layout can be made for it."
            )
        if not 0 < value < 2**32:
            raise SpirvError(f"The array '{name}' has {value} elements.")
        return int(value)

    def _members(self, struct_: int) -> tuple[Member, ...]:
        _, types = self._type(struct_)
        return tuple(self._member(struct_, number, type_) for number, type_ in enumerate(types))

    def _member(self, struct_: int, number: int, type_: int) -> Member:
        def mark(decoration: int) -> int:
            return self._member_marks.get((struct_, number, decoration), 0)

        name = self._member_names.get((struct_, number), "")
        inner, counts, strides = self._stripped(type_, name)
        opcode, operands = self._type(inner)
        members: tuple[Member, ...] = ()
        matrix_stride = mark(Mark.MATRIX_STRIDE)
        if opcode == Op.STRUCT:
            glsl_type, members = self._names.get(inner, ""), self._members(inner)
            size = extent(members)
        elif opcode == Op.POINTER:  # the address of a buffer
            glsl_type, size = self._names.get(operands[1], ""), 8
        else:
            glsl_type, size, (columns, rows) = self._shape(inner)
            if opcode == Op.MATRIX:
                size = matrix_stride * (rows if mark(Mark.ROW_MAJOR) else columns)
        if counts:
            size = counts[0] * strides[0]
        row_major = bool(mark(Mark.ROW_MAJOR))
        offset = mark(Mark.OFFSET)
        return Member(name, glsl_type, offset, size, counts, strides, matrix_stride, row_major, members)

    def _block(self, type_: int) -> Block:
        members = self._members(type_)
        return Block(self._names.get(type_, ""), extent(members), members)

    def _image(self, type_: int, prefix: str) -> str:
        """Return GLSL's name of an image type: "usampler2DArray", "image3D"."""
        _, operands = self._type(type_)
        sampled, dimension, depth, arrayed, multisampled = (operands[place] for place in range(5))
        if not dimension < len(DIMENSIONS):
            return f"{prefix} of dimension {dimension}"
        letter = PREFIXES.get(self._scalar(sampled)[0], "") if self._type(sampled)[0] != Op.VOID else ""
        shadow = "Shadow" if depth == 1 and prefix == "sampler" else ""
        return (
            letter
            + prefix
            + DIMENSIONS[dimension]
            + "MS" * (multisampled == 1)
            + "Array" * (arrayed == 1)
            + shadow
        )

    # --- resources and entry points ---

    def _kind(self, type_: int, storage: int) -> tuple[Kind, str] | None:
        """Return the kind of a descriptor of this type, and GLSL's name of the type; None if it is no descriptor."""
        opcode, operands = self._type(type_)
        if opcode == Op.STRUCT:
            old = (
                type_,
                Mark.BUFFER_BLOCK,
            ) in self._marks  # how storage buffers were written before SPIR-V 1.3
            stored = old or storage == Storage.STORAGE_BUFFER
            return "storage" if stored else "uniform", self._names.get(type_, "")
        if opcode == Op.SAMPLED_IMAGE:
            buffer = self._type(operands[0])[1][1] == BUFFER
            return "uniform texels" if buffer else "texture", self._image(operands[0], "sampler")
        if opcode == Op.IMAGE:
            dimension, written = operands[1], operands[5] == 2
            if dimension == SUBPASS:
                return "input attachment", self._image(type_, "subpassInput")
            if dimension == BUFFER:
                glsl_type = self._image(type_, "image" if written else "texture")
                return "storage texels" if written else "uniform texels", glsl_type
            return (
                ("image", self._image(type_, "image"))
                if written
                else ("sampled image", self._image(type_, "texture"))
            )
        if opcode == Op.SAMPLER:
            return "sampler", "sampler"
        if opcode == Op.ACCELERATION_STRUCTURE:
            return "acceleration structure", "accelerationStructureEXT"
        return None

    def _pointee(self, pointer: int) -> int:
        opcode, operands = self._type(pointer)
        if opcode != Op.POINTER:
            raise SpirvError(f"A variable of the SPIR-V has the type {pointer}, which is no pointer.")
        return operands[1]

    def _resource(self, variable: int, pointer: int, storage: int) -> Resource | None:
        name = self._names.get(variable, "")
        type_, counts, _ = self._stripped(self._pointee(pointer), name)
        descriptor = self._kind(type_, storage)
        if descriptor is None:
            return None
        kind, glsl_type = descriptor
        binding = self._marks.get((variable, Mark.BINDING))
        if binding is None:
            raise SpirvError(
                f"The {kind} '{name or glsl_type}' has no binding: write layout(set = ..., binding = ...)."
            )
        set_ = self._marks.get((variable, Mark.SET), 0)
        block = self._block(type_) if kind in ("uniform", "storage") else None
        return Resource(set_, binding, kind, math.prod(counts), name, glsl_type, block)

    def _entry(self, model: int, function: int, name: str) -> EntryPoint:
        if model not in STAGES:
            raise SpirvError(
                f"The entry point '{name}' has the execution model {model}, which is no stage known here."
            )
        by_id, size = self._sizes.get(function, (False, ()))
        for (
            id_,
            built_in,
        ) in self._composites.items():  # overrides the execution mode, which may then be a dummy
            if self._marks.get((id_, Mark.BUILT_IN)) == WORKGROUP_SIZE:
                by_id, size = True, built_in
        if len(size) < 3:
            return EntryPoint(STAGES[model], name)
        x, y, z = (int(self._values.get(item, 0)) if by_id else item for item in size[:3])
        return EntryPoint(STAGES[model], name, (x, y, z))

    def module(self) -> Module:
        """Return the declarations, combined from the tables."""
        if not self._entries:
            raise SpirvError("The SPIR-V has no entry point: it is a library, and no shader.")
        resources = []
        push: Block | None = None
        inputs = []
        for variable, pointer, storage in self._variables:
            if storage in (Storage.UNIFORM_CONSTANT, Storage.UNIFORM, Storage.STORAGE_BUFFER):
                resource = self._resource(variable, pointer, storage)
                if resource is not None:
                    resources.append(resource)
            elif storage == Storage.PUSH_CONSTANT:
                push = self._block(self._pointee(pointer))
            elif storage == Storage.INPUT and (variable, Mark.LOCATION) in self._marks:
                inputs.append((self._marks[variable, Mark.LOCATION], self._names.get(variable, "")))
        return Module(
            self._version,
            self._bound,
            tuple(self._entry(*entry) for entry in self._entries),
            tuple(sorted(resources, key=lambda item: (item.set, item.binding))),
            push,
            tuple(item for _, item in sorted(self._specials.items())),
            tuple(sorted(inputs)),
        )


def _decoded(type_: str, size: int, words: Sequence[int]) -> Number:
    """Return the value of a constant of `size` bytes; with 8 bytes, the low word is first."""
    raw = struct.pack("<2I", words[0], words[1] if size == 8 else 0)
    value: Number = struct.unpack_from("<" + number_format(type_, size), raw)[0]
    return value
