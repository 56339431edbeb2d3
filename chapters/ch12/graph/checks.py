"""Checks of passes and outputs before compilation; each error is one sentence."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, get_args

from backends.contract import Access, Pass, RateUse, RayUse, Use
from common.errors import UserError
from common.names import suggest

from ..post.settings import RAW
from ..shading.views import PICTURE
from .file import GraphFile
from .sync.queues import QUEUES
from .types import GraphError

USES = (*get_args(Use), *get_args(RateUse), *get_args(RayUse))

STORED = {
    "color": ("rgba8", "rgba8_srgb"),
    "color_linear": ("rgba16f", "rgba32f"),
    "depth": ("d32f",),
    "instance_id": ("r32ui",),
    "motion": ("rg16f",),
}
"""The formats in which a frame's outputs can be read."""


def check_finish(file: GraphFile, settings: Any) -> None:
    """Raise UserError for a graph without the passes of a history, or the image of a split view, that settings need."""
    if settings.shading.view != PICTURE:
        return
    taa, split, passes = settings.taa.taa, settings.post.split, {*file.passes.values()}
    for name in ("motion", "taa"):
        if taa != "off" and name not in passes:
            raise UserError(
                f"{file.shown} has no pass '{name}', which taa={taa} needs: add it where the chapter's own graphs have "
                "it, or set taa=off."
            )
    renamed = [field.word() for use in file.uses for field in use.writes.values()]
    own = any(use.of.word() == "bloom" and RAW not in use.writes for use in file.uses)
    if split != "off" and not own and RAW not in renamed:
        raise UserError(
            f"{file.shown} has no image '{RAW}', which split={split} shows as the raw picture: let its pass 'bloom' "
            "write that name, or set split=off."
        )


def check_name(name: Any, known: Collection[str]) -> None:
    """Raise GraphError unless `name` is the name of a pass."""
    if not isinstance(name, str):
        raise GraphError(f"{name!r} is no name of a pass: there are {', '.join(sorted(known))}.")
    if name not in known:
        raise GraphError(_ended(f"There is no pass '{name}'{suggest(name, known)}"))


def check_readers(readers: Any, known: Collection[str]) -> None:
    """Raise GraphError unless `readers` has, by pass, new names by old ones."""
    valid = isinstance(readers, Mapping) and all(
        isinstance(names, Mapping) and all(isinstance(name, str) for pair in names.items() for name in pair)
        for names in readers.values()
    )
    if not valid:
        raise GraphError(
            f'{readers!r} has no names by pass and old name: write {{"tonemap": {{"color_focused": "color_sharp"}}}}.'
        )
    for reader in readers:
        check_name(reader, known)


def check_pass(pass_: Any, formats: Collection[str]) -> None:
    """Raise GraphError unless `pass_` is a pass with valid declarations."""
    if not isinstance(pass_, Pass):
        raise GraphError(
            f"{pass_!r} is no pass: derive its class from backends.contract.Pass, and make one of it."
        )
    name = getattr(pass_, "name", None)
    if not isinstance(name, str) or not name:
        raise GraphError(f"A pass of {type(pass_).__name__} has no name.")
    if pass_.queue not in QUEUES:
        raise GraphError(f"The pass '{name}' asks for {pass_.queue!r}: its queue is {' or '.join(QUEUES)}.")
    for what, declared in (("reads", pass_.reads), ("writes", pass_.writes)):
        if not isinstance(declared, tuple) or not all(isinstance(access, Access) for access in declared):
            raise GraphError(f"The pass '{name}' does not say what it {what}: give a tuple of Access.")
        for access in declared:
            check_access(access, name, formats)


def check_access(access: Access, name: str, formats: Collection[str]) -> None:
    """Raise GraphError for an invalid access."""
    text = f"The pass '{name}' declares '{access.resource}'"
    if access.use not in USES:
        raise GraphError(_ended(f"{text} as '{access.use}', which is no use{suggest(str(access.use), USES)}"))
    if access.format is not None and access.format not in formats:
        raise GraphError(
            _ended(f"{text} in the format '{access.format}'{suggest(str(access.format), formats)}")
        )
    if not (math.isfinite(access.scale) and 0 < access.scale <= 8):
        raise GraphError(f"{text} at {access.scale} times the picture's size: above 0 and at most 8 can be.")
    if access.size is not None and not all(1 <= side <= 32768 for side in access.size):
        raise GraphError(
            f"{text} with {access.size[0]}x{access.size[1]} pixels: each side must be 1 to 32768."
        )


def check_output(output: str, name: str, written: Access, size: tuple[int, int]) -> None:
    """Raise GraphError if a resource cannot be read as `output`; `written` is its first access."""
    known = STORED.get(output)
    if known is not None and written.format not in known:
        raise GraphError(
            f"The output '{output}' cannot be '{name}' in {written.format}: it is read as {' or '.join(known)}."
        )
    if (
        (written.scale, *written.texel) != (1.0, 1, 1)
        or written.size not in (None, size)
        or written.samples > 1
    ):
        raise GraphError(
            f"The output '{output}' cannot be '{name}': that is not as large as the picture, or has samples."
        )


def _ended(sentence: str) -> str:
    return sentence if sentence.endswith("?") else sentence + "."
