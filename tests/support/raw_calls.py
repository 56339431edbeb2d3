"""Calls of the graphics APIs as plain values, field by field: what two ways to make a resource really asked for.

Objects are numbered in the order in which they appear, so that two logs are equal when the calls are, although each
made objects of its own. Pointers to what a call returns show what it returned.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.driver.calls import CALLS
from backends.vulkan import api as vk
from tests.support.gl_functions import noted

Call = tuple[str, dict[str, Any]]


class Numbers(dict[Any, str]):
    """Gives each object a name in the order of their first appearance."""

    def __missing__(self, key: Any) -> str:
        self[key] = f"object {len(self)}"
        return self[key]


# --- Vulkan -----------------------------------------------------------------------------------------------------------

_CHAINED = {
    vk._struct_type(name).stype: name
    for name in ("VkImageViewUsageCreateInfo", "VkMemoryAllocateFlagsInfo", "VkMemoryDedicatedAllocateInfo")
}
"""The structs that a pNext of these calls may lead to, by their sType."""


class _Log(list[Any]):
    """Reads an object's new name at once: its text lives no longer than the call."""

    def append(self, call: tuple[str, tuple[Any, ...]]) -> None:
        name, arguments = call
        label = name == "vkSetDebugUtilsObjectNameEXT"
        super().append((name, arguments, vk.text(arguments[1].pObjectName) if label else None))


def vulkan_calls(device: Any, work: Callable[[], object]) -> list[Call]:
    """Return the calls that `work` makes to a device, with every member of every struct."""
    log = _Log()
    device.fn.trace(log)
    try:
        work()
    finally:
        device.fn.trace(None)
    numbers = Numbers()
    return [
        (name, {"label": label} | {str(place): _value(one, numbers) for place, one in enumerate(arguments)})
        for name, arguments, label in log
    ]


def _value(value: Any, numbers: Numbers) -> Any:
    if not isinstance(value, vk.ffi.CData):
        return value
    ctype = vk.ffi.typeof(value)
    if ctype.kind == "struct":
        return _members(value, ctype, numbers)
    if value == vk.NULL:
        return None
    if ctype.kind == "array":
        return [_value(one, numbers) for one in value]
    if ctype.item.kind == "struct" and not ctype.cname.endswith("_T *"):
        return _members(value[0], ctype.item, numbers)
    if ctype.item.kind in ("pointer", "primitive"):
        return _value(value[0], numbers)
    return numbers[int(vk.ffi.cast("uintptr_t", value))]


def _members(struct: Any, ctype: Any, numbers: Numbers) -> dict[str, Any]:
    counts = vk._struct_type(ctype.cname).counts
    found: dict[str, Any] = {}
    for name, _ in ctype.fields:
        member = getattr(struct, name)
        if name == "pNext" and member != vk.NULL:
            stype = vk.ffi.cast("VkBaseInStructure *", member).sType
            found[name] = _value(vk.ffi.cast(f"{_CHAINED[stype]} *", member), numbers)
        elif name in counts and member != vk.NULL:
            found[name] = [_value(member[place], numbers) for place in range(getattr(struct, counts[name]))]
        elif name == "pObjectName":
            continue
        elif name == "objectHandle":
            found[name] = numbers[member]
        else:
            found[name] = _value(member, numbers)
    return found


# --- OpenGL -----------------------------------------------------------------------------------------------------------

_DECLARED = {
    name: [part.split()[-1].lstrip("*") for part in parameters.split(",")]
    for name, parameters in re.findall(r"\b(gl\w+)\(([^)]*)\)", " ".join(CALLS.split()))
}
_OBJECTS = {"buffer", "texture", "sampler", "origtexture"}


def gl_calls(context: Context, work: Callable[[], object]) -> list[Call]:
    """Return the raw calls that `work` makes, with every argument by its name in the specification."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    with noted(context, lambda name, arguments: log.append((name, arguments))):
        work()
    numbers, calls = Numbers(), []
    for call, arguments in log:
        found: dict[str, Any] = {}
        for name, value in zip(_DECLARED[call], arguments, strict=True):
            if isinstance(value, gl.ffi.CData):
                found[name] = None if value == gl.NULL else [*value]
                if gl.ffi.typeof(value).item.cname == "unsigned int" and value != gl.NULL:
                    found[name] = [numbers[int(one)] for one in value]
            elif name in _OBJECTS or (call == "glObjectLabel" and name == "name"):
                found[name] = numbers[value]
            else:
                found[name] = value
        calls.append((call, found))
    return calls
