"""Specialization constants on OpenGL, which compiles text: a declaration becomes one of a constant with its value.

    layout(constant_id = 3) const int TAPS = 8;   becomes   const int TAPS = 5;
    layout(local_size_x_id = 0) in;               becomes   layout(local_size_x = 64) in;

The text is the key of a program, so equal values share a program, and other values get another one.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.shader_text import ShaderSource, literal
from common.errors import ShaderError

from .specialization import Values, assigned
from .spirv.declared import Number, SpecConstant

_SIZES = {"int": 4, "uint": 4, "float": 4, "bool": 4, "double": 8}
_CONSTANT = re.compile(
    r"^(?P<indent>[ \t]*)layout\s*\(\s*constant_id\s*=\s*(?P<id>\d+)\s*\)\s*"
    r"(?P<head>const\s+(?P<type>\w+)\s+(?P<name>\w+)\s*=)(?P<default>[^;]*);",
    re.M,
)
_GROUP = re.compile(
    r"^(?P<indent>[ \t]*)layout\s*\((?P<items>[^()]*\blocal_size_[xyz]_id\b[^()]*)\)\s*in\s*;", re.M
)
_SIDE = re.compile(r"local_size_([xyz])(_id)?\s*=\s*(\w+)")


def specialized(sources: Sequence[ShaderSource], values: Values, offered: Values = ()) -> list[ShaderSource]:
    """Return the stages of a program with values of their specialization constants; raises ShaderError as Vulkan does.

    `values` are of the program's description, `offered` are for shaders that declare their names.
    """
    declared = [_declared(source) for source in sources]
    chosen = assigned(declared, values, offered)
    return [
        _rewritten(source, constants, dict(own)) if constants else source
        for source, constants, own in zip(sources, declared, chosen, strict=True)
    ]


def _declared(source: ShaderSource) -> list[SpecConstant]:
    """Return the constants of a stage. Defaults stay in the text, so they count as 0 here."""
    constants: dict[int, SpecConstant] = {}
    for match in _CONSTANT.finditer(source.text):
        if match["type"] not in _SIZES:
            raise ShaderError(
                f"{source.name}: '{match['name']}' is {match['type']}, and specialization constants on OpenGL are "
                f"{', '.join(_SIZES)}.",
                source.paths,
            )
        constants[int(match["id"])] = SpecConstant(
            int(match["id"]), match["name"], match["type"], _SIZES[match["type"]], 0
        )
    for match in _GROUP.finditer(source.text):
        for _, by_id, number in _SIDE.findall(match["items"]):
            if by_id:
                constants.setdefault(int(number), SpecConstant(int(number), "", "uint", 4, 1))
    return list(constants.values())


def _rewritten(
    source: ShaderSource, constants: Sequence[SpecConstant], values: dict[int, Number]
) -> ShaderSource:
    """Return a stage with ordinary constants. Lines keep their numbers, for the messages of the compiler."""

    def constant(match: re.Match[str]) -> str:
        default, number = match["default"], int(match["id"])
        value = (
            " " + _glsl(match["type"], values[number]) + "\n" * default.count("\n")
            if number in values
            else default
        )
        return f"{match['indent']}{match['head']}{value};"

    def group(match: re.Match[str]) -> str:
        sides = {axis: number for axis, by_id, number in _SIDE.findall(match["items"]) if not by_id}
        for axis, by_id, number in _SIDE.findall(match["items"]):
            if by_id:  # without a value and a plain size, an axis has 1
                sides[axis] = str(values.get(int(number), sides.get(axis, 1)))
        items = ", ".join(f"local_size_{axis} = {number}" for axis, number in sides.items())
        return f"{match['indent']}layout({items}) in;"

    text = _GROUP.sub(group, _CONSTANT.sub(constant, source.text))
    key = hashlib.sha256(f"{source.key} {sorted(values.items())}".encode()).hexdigest()
    return replace(source, text=text, key=key)


def _glsl(type_: str, value: Number) -> str:
    """Return a value that fits its type as text that GLSL reads back as the same bits."""
    if type_ == "bool":
        return "true" if value else "false"
    if type_ in ("int", "uint"):
        return f"{value}u" if type_ == "uint" else literal(int(value))
    # Rounded here: a compiler that reads 0.1 as a double and rounds twice might find another float.
    return literal(float(np.float32(value))) if type_ == "float" else f"{literal(float(value))}lf"
