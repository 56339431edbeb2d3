"""What renderers of all chapters are given, and each mistake in it in a sentence; `backends.contract` hands it on."""

from __future__ import annotations

import numbers
import operator
from collections.abc import Iterable
from typing import Any

from common.errors import UserError
from common.names import suggest

MAX_TIME_S = 1e9
"""The furthest time from 0 in either direction, about 30 years: shaders hold it in 32 bits."""


def check_names(names: Any, what: str) -> tuple[str, ...]:
    """Return the names in `names`, where one alone needs no list; raise UserError for what holds none.

    `what` is the argument's name, for the text.
    """
    if isinstance(names, str):
        return (names,)
    try:
        found = tuple(names)
    except TypeError:
        found = (None,)
    for name in found:
        if not isinstance(name, str):
            raise UserError(f'{what}={_brief(names)} holds no names: write {what}={{"name", ...}}.')
    return found


def check_arguments(
    scene: Any, settings: Any, kind: type, outputs: Any, known: Iterable[str]
) -> tuple[Any, tuple[str, ...]]:
    """Check what a renderer of any chapter is opened with; return its settings and outputs.

    `kind` is the chapter's class of settings, whose defaults None stands for; `known` are its outputs. Raises
    UserError with one sentence for an argument of another kind.
    """
    from common.scene import Scene

    if not isinstance(scene, Scene):
        raise UserError(
            f"scene={_brief(scene)} is no scene: chapters.scenes.load(name or path) and "
            f"common.gltf.load_scene(path) load one."
        )
    if settings is not None and not isinstance(settings, kind):
        raise UserError(
            f"settings={_brief(settings)} are not this chapter's: give {kind.__module__}.{kind.__name__}(name=value)."
        )
    known, wanted = tuple(known), check_names(outputs, "outputs")
    for name in sorted(set(wanted) - set(known)):
        near = suggest(name, known)
        raise UserError(f"There is no output '{name}'{near}" + ("" if near.endswith("?") else "."))
    return kind() if settings is None else settings, wanted


def check_moment(view: Any, time: Any) -> None:
    """Raise UserError unless `view` is a View and `time` a number of seconds that a frame can show."""
    from common.view.camera import View

    if not isinstance(view, View):
        raise UserError(
            f"{_brief(view)} is no view: common.view.camera.View is one, and chapters.view_of gives one."
        )
    check_time(time)


def check_time(time: Any, name: str = "time") -> None:
    """Raise UserError, which begins with `name`, unless `time` is a number between -MAX_TIME_S and MAX_TIME_S."""
    real = isinstance(time, numbers.Real)
    if not (real and -MAX_TIME_S <= time <= MAX_TIME_S):  # NaN is in no range
        raise UserError(
            f"{name} {_brief(time)} is no time: give seconds between -{MAX_TIME_S:g} and {MAX_TIME_S:g}."
        )


def _brief(value: Any) -> str:
    """Return how an argument looks, on one line of bounded length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def check_size(size: tuple[int, int], largest: int = 16384) -> tuple[int, int]:
    """Return (width, height); raise UserError unless both are between 1 and `largest` pixels."""
    try:
        width, height = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        raise UserError(
            f"{size!r} is no size of a picture: give two whole numbers, (width, height)."
        ) from None
    if not (1 <= width <= largest and 1 <= height <= largest):
        raise UserError(
            f"A picture of {width}x{height} pixels cannot be made: each side must be 1 to {largest}."
        )
    return width, height
