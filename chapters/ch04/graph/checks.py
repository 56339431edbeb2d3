"""What is asked of passes and outputs before they become a graph, each mistake in a sentence."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, get_args

from backends.contract import Access, Pass, Use
from common.names import suggest

from .types import GraphError

USES = get_args(Use)

STORED = {
    "color": ("rgba8", "rgba8_srgb"),
    "color_linear": ("rgba16f", "rgba32f"),
    "depth": ("d32f",),
    "instance_id": ("r32ui",),
}
"""The formats in which a frame's outputs can be read."""


def check_name(name: Any, known: Collection[str]) -> None:
    """Raise GraphError unless a pass is called `name`."""
    if not isinstance(name, str):
        raise GraphError(f"{name!r} is no name of a pass: there are {', '.join(sorted(known))}.")
    if name not in known:
        raise GraphError(_ended(f"There is no pass '{name}'{suggest(name, known)}"))


def check_readers(readers: Any, known: Collection[str]) -> None:
    """Raise GraphError unless `readers` says by pass which name it reads in place of which."""
    good = isinstance(readers, Mapping) and all(
        isinstance(names, Mapping) and all(isinstance(one, str) for pair in names.items() for one in pair)
        for names in readers.values()
    )
    if not good:
        raise GraphError(
            f'{readers!r} does not say who reads what: write {{"tonemap": {{"color_focused": "color_sharp"}}}}.'
        )
    for reader in readers:
        check_name(reader, known)


def check_pass(made: Any, formats: Collection[str]) -> None:
    """Raise GraphError unless `made` is a pass, and declares what can be."""
    if not isinstance(made, Pass):
        raise GraphError(
            f"{made!r} is no pass: derive its class from backends.contract.Pass, and make one of it."
        )
    name = getattr(made, "name", None)
    if not isinstance(name, str) or not name:
        raise GraphError(f"A pass of {type(made).__name__} has no name.")
    for what, declared in (("reads", made.reads), ("writes", made.writes)):
        if not isinstance(declared, tuple) or not all(isinstance(one, Access) for one in declared):
            raise GraphError(f"The pass '{name}' does not say what it {what}: give a tuple of Access.")
        for access in declared:
            check_access(access, name, formats)


def check_access(access: Access, name: str, formats: Collection[str]) -> None:
    """Raise GraphError for a declared access that nothing can have."""
    said = f"The pass '{name}' declares '{access.resource}'"
    if access.use not in USES:
        raise GraphError(_ended(f"{said} as '{access.use}', which is no use{suggest(str(access.use), USES)}"))
    if access.format is not None and access.format not in formats:
        raise GraphError(
            _ended(f"{said} in the format '{access.format}'{suggest(str(access.format), formats)}")
        )
    if not (math.isfinite(access.scale) and 0 < access.scale <= 8):
        raise GraphError(f"{said} at {access.scale} times the picture's size: above 0 and at most 8 can be.")
    if access.size is not None and not all(1 <= side <= 32768 for side in access.size):
        raise GraphError(
            f"{said} with {access.size[0]}x{access.size[1]} pixels: each side must be 1 to 32768."
        )


def check_output(output: str, name: str, made: Access, size: tuple[int, int]) -> None:
    """Raise GraphError where what is behind an output of a frame cannot be read as that; `made` is its first access."""
    known = STORED.get(output)
    if known is not None and made.format not in known:
        raise GraphError(
            f"The output '{output}' cannot be '{name}' in {made.format}: it is read as {' or '.join(known)}."
        )
    if made.scale != 1.0 or made.size not in (None, size) or made.samples > 1:
        raise GraphError(
            f"The output '{output}' cannot be '{name}': that is not as large as the picture, or has samples."
        )


def _ended(sentence: str) -> str:
    return sentence if sentence.endswith("?") else sentence + "."
