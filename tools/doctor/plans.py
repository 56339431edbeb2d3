"""By which path each chapter would run on a device, for `strata doctor`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import chapters
from backends.contract import Capabilities, resolve
from chapters import folders
from common.errors import UnsupportedError

Report = dict[str, Any]


def capabilities_of(device: Report, backend: str = "vulkan") -> Capabilities:
    """Return what `probe` said of a device as the record that plans are made from."""
    major, minor, patch = map(int, device["api"].split("."))
    return Capabilities(
        backend=backend,
        device=device["name"],
        driver=device["driver"],
        api_version=(major, minor, patch),
        kind=device["kind"],
        features=frozenset(device["features"]),
        why_not=device["why_not"],
        limits=device["limits"],
        broken=device["broken"],
    )


def plans(
    device: Capabilities | None, tried: Callable[[int], tuple[str, bool]] = lambda number: ("", False)
) -> Report:
    """Return by chapter ("ch01") which path each feature takes on `device` and why, or why it cannot run.

    `tried(number)` is what a chapter's trial found wrong, "" for nothing, and whether the other backend draws it.
    """
    made: Report = {}
    for number in chapters.available():
        name = chapters.folder_name(number)
        try:
            lesson = chapters.lesson(number)
            entry: Report = {"title": lesson.title, "runs": False, "problem": None, "choices": []}
            made[name] = entry
            if device is None:
                entry["problem"] = "no device works"
                continue
            if device.backend == "gl" and not folders.renderer_name(chapters.FOLDER / name, "gl"):
                entry["problem"] = "it has no OpenGL version"
                continue
            plan = resolve(lesson.needs.required, lesson.needs.optional, device)
            problem, elsewhere = tried(number)
            entry["problem"] = problem or None
            entry["runs"] = elsewhere or not problem
            entry["choices"] = [
                {"feature": c.feature, "native": c.native, "path": c.path, "reason": c.reason}
                for c in plan.choices
            ]
        except UnsupportedError as error:
            entry["problem"] = str(error).rstrip(".")
        except Exception as error:  # a chapter that is being changed may not import
            problem = f"it cannot be imported: {type(error).__name__}: {error}"
            made[name] = {"title": "", "runs": False, "problem": problem, "choices": []}
    return made
