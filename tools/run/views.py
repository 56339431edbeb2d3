"""Views of every chapter: the quantities that `--view NAME` shows in place of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import chapters
from common.errors import UserError
from common.names import suggest
from common.settings import flat, knobs, replaced

if TYPE_CHECKING:
    from chapters import Which, Whole

S = TypeVar("S")


def views_of(which: Whole) -> dict[str, str]:
    """Return the quantities that a chapter or a fork can show: a sentence for each name."""
    views = import_module(f"{chapters.package_of(which)}.shading.views").VIEWS
    return {view.name: view.sentence for view in views}


def stored_as(settings: Any) -> str:
    """Return what the colour of a frame with a chapter's `settings` holds: "light", or a view's "value" or "count"."""
    package = type(settings).__module__.rpartition(".")[0]
    views = import_module(f"{package}.shading.views").VIEWS
    shown = flat(settings)["view"]
    return next((str(view.shown) for view in views if view.name == shown), "light")


def with_view(settings: S, which: Which, name: str | None) -> S:
    """Return a chapter's settings with view `name`, None for those given; raise UserError if there is none such."""
    if name is None:
        return settings
    if isinstance(which, str):
        raise UserError(f"The study {which} has no views: leave --view out.")
    known = views_of(which)
    if name not in known:
        other = f"; --set {knob}={name} shows it" if (knob := _knob_with(settings, name)) else ""
        near = other or suggest(name, known, shown=len(known))
        raise UserError(f"There is no view {name!r}{near}" + ("" if near.endswith("?") else "."))
    return replaced(settings, view=name)


def _knob_with(settings: Any, view: str) -> str:
    """Return the knob of another kind of views that has a choice of this name, or ""."""
    found = (
        name
        for name, knob in knobs(settings).items()
        if name.endswith("_view") and view in (knob.choices or ())
    )
    return next(found, "")


def shown_by(which: Which, overrides: Sequence[str]) -> tuple[str, ...]:
    """Return the settings of a run: those that the lesson shows, unless --set names them, and those of --set."""
    if isinstance(which, str):
        return tuple(overrides)
    given = {override.partition("=")[0].strip() for override in overrides}
    shows = chapters.lesson(which).shows
    return (*(it for it in shows if it.partition("=")[0] not in given), *overrides)
