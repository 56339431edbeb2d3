"""What a program fills for a shader before it draws: bindings, blocks, vertex inputs; and whether a new text fits it.

A shader may be edited while the program runs, the program itself may not. So the interfaces of the old and the new
shader are compared. For Vulkan they are read from the SPIR-V (`backends.vulkan.shaders.spirv_interface`); for OpenGL
the driver returns them (`backends.gl.program_interface`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

from common.errors import ShaderError
from common.files.shader_files import shown_path


@dataclass(frozen=True)
class Field:
    """A member of a block: its name, its byte, and its type with strides ("vec4[10] every 16 bytes")."""

    name: str = field(compare=False)  # the host knows places alone
    offset: int
    kind: str


@dataclass(frozen=True)
class Slot:
    """One thing that the host fills. `size` are the bytes of a block, without an array whose end is open."""

    name: str = field(compare=False)
    kind: str
    size: int = 0
    fields: tuple[Field, ...] = ()


Interface = Mapping[str, Slot]
"""What is at each place: "set 0, binding 3", "texture unit 2", "vertex input 1", "output 0", "push constants"."""


def misfit(known: Interface, now: Interface, elsewhere: Collection[tuple[str, Slot]] = ()) -> str:
    """Return what `now` expects of the host that `known` did not, as the middle of a sentence; "" if nothing.

    What is no longer used is no harm. `elsewhere` are further places that the host fills.
    """
    for place, slot in now.items():
        before = known.get(place)
        if before is None and (place, slot) not in elsewhere:
            return f"{place} '{slot.name}': this {slot.kind} is new"
        if before is not None and before != slot:
            return f"{place} '{slot.name}': {_difference(before, slot)}"
    return ""


def _difference(before: Slot, now: Slot) -> str:
    if before.kind != now.kind:
        return f"it was a {before.kind} and is a {now.kind}"
    if before.size != now.size:
        return f"the block's size went from {before.size} to {now.size} bytes"
    for old, new in zip_longest(before.fields, now.fields):
        if old == new:
            continue
        if old is None or new is None:
            return f"the field '{(new or old).name}' {'is gone' if new is None else 'is new'}"
        if old.offset != new.offset:
            return f"the field at byte {old.offset}, '{old.name}', is now at byte {new.offset}, '{new.name}'"
        return f"the field '{new.name}' was a {old.kind} and is a {new.kind}"
    return "it has changed"


def refusal(difference: str, changed: Collection[Path], files: Collection[Path] = ()) -> ShaderError:
    """Return the error for a text whose interface is another one; `changed` were edited, `files` may repair it."""
    names = ", ".join(sorted(shown_path(path) for path in changed))
    return ShaderError(
        f"{names}: {difference}. The program fills it as before: take the edit back, or change the Python side too "
        "and start again.",
        files,
    )
