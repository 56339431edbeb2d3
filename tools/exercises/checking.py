"""What the `check.py` of an exercise is given, and how it is run on a reader's folder."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

import chapters
from backends.contract import Renderer
from common.errors import UnsupportedError, UserError
from common.scene import Scene
from common.settings import knobs as knobs_of
from common.view.camera import View
from tools.exercises import Answer, Exercise

NAMES = {"vulkan": "Vulkan", "gl": "OpenGL", "": ""}

Opener = Callable[[str], AbstractContextManager[Any]]
"""Gives a device of "vulkan" or "gl"; of "" None."""


class NotYet(Exception):
    """Something is not right yet; the text is a sentence that says what."""


class Given:
    """What is checked: a copy of a chapter, on one backend ("": no device is needed)."""

    def __init__(self, which: chapters.Whole, backend: str, device: Any) -> None:
        self.which, self.backend, self.device = which, backend, device

    def need(self, right: Any, sentence: str) -> None:
        """Raise NotYet with `sentence` unless something is right."""
        if not right:
            raise NotYet(sentence)

    def module(self, name: str) -> ModuleType:
        """Return a module of the copy, as "scene.packing"; raise NotYet if it is not there."""
        whole = f"{chapters.package_of(self.which)}.{name}"
        try:
            return import_module(whole)
        except ModuleNotFoundError as error:
            if error.name is None or not whole.startswith(error.name):
                raise
            raise NotYet(f"There is no module {name.replace('.', '/')}.py yet.") from None

    def settings(self, **knobs: Any) -> Any:
        """Return the copy's settings; raise NotYet where a knob, or a choice of it, is not there."""
        kind = chapters.settings_class(self.which)
        known = knobs_of(kind)
        for name, value in knobs.items():
            self.need(name in known, f"There is no setting {name} yet.")
            choices = known[name].choices
            self.need(not choices or value in choices, f"The setting {name} cannot be {value} yet.")
        return kind(**knobs)

    def open(
        self, scene: Scene, size: tuple[int, int], outputs: Sequence[str] = ("color",), **knobs: Any
    ) -> Renderer:
        """Return the copy's renderer of a scene, with settings that are exact unless knobs say otherwise."""
        exact = {"background": 0.0, "default_light": False, "tone_curve": "none", "color_format": "rgba32f"}
        module = chapters.renderer_module(self.which, self.backend)
        settings = self.settings(**{**exact, **knobs})
        opened: Renderer = module.Renderer(scene, size, settings, outputs=set(outputs), device=self.device)
        return opened

    def draw(
        self,
        scene: Scene,
        camera: View,
        output: str = "color_linear",
        size: tuple[int, int] = (32, 32),
        **knobs: Any,
    ) -> np.ndarray:
        """Return one output of one frame; raise NotYet if the API complains."""
        with self.open(scene, size, (output,), **knobs) as made:
            picture: np.ndarray = made.render(camera).image(output)
        self.silent()
        return picture

    def silent(self) -> None:
        """Raise NotYet with the first message of the validation layers, or of the OpenGL driver."""
        messages = self.complaints()
        self.need(not messages, messages[0] if messages else "")

    def complaints(self) -> list[str]:
        """Return what the API said since it was asked last."""
        return complaints(self.device)


def complaints(device: Any) -> list[str]:
    """Return what was said about the calls so far, and forget it."""
    if device is None:
        return []
    sink = device.sink if hasattr(device, "sink") else device.instance.sink
    said: list[str] = sink.report()
    sink.messages.clear()
    return said


def entry(exercise: Exercise) -> Any:
    """Return the function `check` or `measure` of an exercise's check.py."""
    path = exercise.folder / "check.py"
    name = f"strata_exercise_{chapters.folder_name(exercise.chapter)}_{exercise.name.replace('-', '_')}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, "measure" if exercise.kind == "predict" else "check")


@contextmanager
def device(backend: str) -> Iterator[Any]:
    """Open a device whose calls are checked, where that is possible."""
    if not backend:
        yield None
        return
    if backend == "gl":
        from backends.gl.context import Context

        with Context(validate=True) as context:
            yield context
        return
    from backends.vulkan.device import Device
    from backends.vulkan.instance import VALIDATION_LAYER, Instance

    with Instance() as plain:
        layered = VALIDATION_LAYER in plain.layers
    with Instance(layered) as instance, Device(instance) as opened:
        yield opened


def check(exercise: Exercise, which: chapters.Whole, opener: Opener = device) -> str | None:
    """Run an exercise's check on a copy of its chapter; return what is not right yet, None if all is.

    It runs on each backend of the exercise that this machine has. Raises UnsupportedError if there is none of them, and
    UserError where the exercise is about validation and the layers are not installed; faults of the copy's own code
    come through as they are.
    """
    run = entry(exercise)
    missing: list[UnsupportedError] = []
    for backend in exercise.backends or ("",):
        with ExitStack() as stack:
            try:
                held = stack.enter_context(opener(backend))
            except UnsupportedError as error:
                missing.append(error)
                continue
            if exercise.validated and backend == "vulkan" and not held.instance.validates:
                raise UserError(
                    "This exercise is about what the validation layers say, and they are not installed: "
                    "./strata doctor says how."
                )
            complaints(held)
            try:
                run(Given(which, backend, held))
            except NotYet as wrong:
                where = f"{NAMES[backend]}: " if len(exercise.backends) > 1 else ""
                return f"{where}{wrong}"
    if missing and len(missing) == len(exercise.backends):
        raise missing[0]
    return None


def measure(exercise: Exercise, opener: Opener = device) -> tuple[dict[str, Answer], str]:
    """Run what a prediction is about, on the chapter itself; return the answers, and the device."""
    backend = exercise.backends[0] if exercise.backends else ""
    with opener(backend) as held:
        answers: dict[str, Answer] = entry(exercise)(Given(exercise.chapter, backend, held))
        return answers, held.capabilities.device if held is not None else "no device"
