"""Specialization constants: which constant of a shader each value belongs to, and whether the constant can have it.

    layout(constant_id = 3) const int TAPS = 8;

A shader is compiled with such a declaration, and the value is chosen later, when a pipeline is built. So one module
serves many pipelines, and in each of them the value is a constant: the driver unrolls loops over it, folds expressions
of it, and drops branches. `vulkan_reflection.chosen` reads the declarations from SPIR-V, `gl_specialization` from text.
Without a value, a constant keeps the default of its declaration.
"""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import ShaderError
from common.names import suggest

from .spirv.declared import Number, SpecConstant

Values = Sequence[tuple[str | int, Number]]
"""Values by name or id, as a description has them."""

SUBGROUP_SIZE = "SUBGROUP_SIZE"
"""The constant that every shader which declares it gets from the device: the invocations that run together."""


def assigned(
    stages: Sequence[Sequence[SpecConstant]], values: Values, offered: Values = ()
) -> list[tuple[tuple[int, Number], ...]]:
    """Return (id, value) of the constants that get a value, for each stage; `stages` are the declared constants.

    Some stage must declare each constant of `values`. `offered` are for the shaders that declare constants of these
    names; what is in `values` comes first. Raises ShaderError for a name or an id that no stage declares, for
    two values of one constant, and for a value that does not fit the type.
    """
    names = {constant.name for constants in stages for constant in constants} - {""}
    known = {constant.id for constants in stages for constant in constants} | names
    for key, _ in values:
        if key not in known:
            near = suggest(str(key), names)
            near = near if near.endswith("?") else f"{near}."
            raise ShaderError(f"No stage has a specialization constant {key!r}{near}")
    return [
        tuple(
            (constant.id, value)
            for constant in constants
            for value in _value_of(constant, values) or _value_of(constant, offered)
        )
        for constants in stages
    ]


def _value_of(constant: SpecConstant, values: Values) -> list[Number]:
    """Return the value of a constant in a list, or an empty list if it has none."""
    own = [value for key, value in values if key in (constant.id, constant.name)]
    for value in own:
        constant.encoded(value)
        if value != own[0]:
            raise ShaderError(
                f"The specialization constant '{constant.name or constant.id}' has two values, {own[0]} and {value}: "
                "leave one of them out."
            )
    return own[:1]
