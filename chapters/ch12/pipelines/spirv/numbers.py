"""The numbers of SPIR-V that the parser of `pipelines.spirv.parser` uses.

Source: SPIR-V specification 1.6, section 3, and its extensions for mesh shaders and ray tracing.
"""

from __future__ import annotations


class Op:
    """Opcodes: the low half of an instruction's first word."""

    NAME, MEMBER_NAME, ENTRY_POINT, EXECUTION_MODE, EXECUTION_MODE_ID = 5, 6, 15, 16, 331
    TYPES = range(19, 34)  # OpTypeVoid to OpTypeFunction
    VOID, BOOL, INT, FLOAT, VECTOR, MATRIX, IMAGE, SAMPLER, SAMPLED_IMAGE = 19, 20, 21, 22, 23, 24, 25, 26, 27
    ARRAY, RUNTIME_ARRAY, STRUCT, POINTER, FORWARD_POINTER = 28, 29, 30, 32, 39
    ACCELERATION_STRUCTURE = 5341
    TRUE, FALSE, CONSTANT, COMPOSITE = 41, 42, 43, 44
    SPEC_TRUE, SPEC_FALSE, SPEC_CONSTANT, SPEC_COMPOSITE, SPEC_OP = 48, 49, 50, 51, 52
    FUNCTION, VARIABLE, DECORATE, MEMBER_DECORATE = 54, 59, 71, 72


class Mark:
    """Decorations: properties of an id or of a member besides its type."""

    SPEC_ID, BUFFER_BLOCK, ROW_MAJOR, ARRAY_STRIDE, MATRIX_STRIDE, BUILT_IN = 1, 3, 4, 6, 7, 11
    LOCATION, BINDING, SET, OFFSET = 30, 33, 34, 35


class Storage:
    """Storage classes: the memory of a variable."""

    UNIFORM_CONSTANT, INPUT, UNIFORM, PUSH_CONSTANT, STORAGE_BUFFER = 0, 1, 2, 9, 12


STAGES = {
    0: "vert",
    1: "tesc",
    2: "tese",
    3: "geom",
    4: "frag",
    5: "comp",
    5267: "task",  # NV
    5268: "mesh",  # NV
    5313: "rgen",
    5314: "rint",
    5315: "rahit",
    5316: "rchit",
    5317: "rmiss",
    5318: "rcall",
    5364: "task",
    5365: "mesh",
}
"""The suffix of shader files for each execution model."""

LOCAL_SIZE, LOCAL_SIZE_ID, WORKGROUP_SIZE = 17, 38, 25  # two execution modes, and a built-in

DIMENSIONS = ("1D", "2D", "3D", "Cube", "2DRect", "Buffer", "")
"""The end of GLSL's type names for each image dimension; the last is that of an input attachment."""

BUFFER, SUBPASS = 5, 6

SCALARS = {
    (Op.INT, 32, 0): "uint",
    (Op.INT, 32, 1): "int",
    (Op.FLOAT, 32, 0): "float",
    (Op.FLOAT, 64, 0): "double",
}
"""GLSL's names of numbers, by (opcode, bits, signed)."""

PREFIXES = {"float": "", "int": "i", "uint": "u", "double": "d", "bool": "b"}
"""The start of GLSL's type names for vectors and images of each scalar type."""

PARTS = {
    Op.VECTOR: slice(0, 1),
    Op.MATRIX: slice(0, 1),
    Op.IMAGE: slice(0, 1),
    Op.SAMPLED_IMAGE: slice(0, 1),
    Op.ARRAY: slice(0, 1),
    Op.RUNTIME_ARRAY: slice(0, 1),
    Op.STRUCT: slice(0, None),
}
"""The operands of a type that are the types it contains."""
