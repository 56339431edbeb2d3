"""What is done with mutated files: they are loaded, drawn by chapters, and given to the command line."""

from __future__ import annotations

import os
import random
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from backends.gl.context import Context
from backends.vulkan.device import Device
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from common.environment import read_environment
from common.gltf import load_scene
from common.mesh.obj import load_obj
from common.paths import user_cache
from common.scene import Scene
from tests.support import mutation_sources
from tests.support.drawable import assert_drawable
from tests.support.mutate_values import FORGED
from tests.support.mutation_worker import PRINTED, RESULTS, SAID, is_hidden
from tests.support.mutations import Case, Mutant, write
from tools.run import opening

SIZE = (32, 32)
PANORAMAS = (".hdr", ".exr")


def _forget_caches() -> None:
    """Remove what the case has left in the cache of scenes: there would be thousands."""
    shutil.rmtree(user_cache() / "scene-cache", ignore_errors=True)


def _whole(name: str, folder: Path) -> Path:
    """Write a source as it is; what is imported and opened by and by is there before anything is watched."""
    source, place = mutation_sources.load(name), folder / "whole"
    shutil.rmtree(place, ignore_errors=True)
    return write(Mutant(Case(name, 0), source.main, source.files), place / "scene")


class Load:
    """Loads a file in one of the ways in which programs do, and holds that what comes out can be drawn."""

    device = ""

    def __init__(self, options: Any, folder: Path) -> None:
        self._newest = chapters.available()[-1]
        path = _whole("pictures", folder)
        load_scene(path, use_library=True)
        with opening.open_scene(self._newest, str(path)) as opened:
            opened.finish()

    def __call__(self, path: Path, case: Case) -> None:
        """Load it; raises what is wrong with the file, or with the loader."""
        how = random.Random(f"load {case}").random()
        if path.suffix in PANORAMAS:
            environment = read_environment(path)
            assert np.isfinite(environment.radiance).all()
        elif path.suffix == ".obj":
            assert_drawable(load_obj(path))
        elif how < 0.25:
            for _ in range(2):  # the second time from the cache
                with opening.open_scene(self._newest, str(path)) as opened:
                    opened.start()
                    opened.finish()
                    _hold(opened.scene)
        else:
            _hold(load_scene(path, use_library=how > 0.95, decode=how > 0.5))

    def tidy(self) -> None:
        """Remove what the case has left."""
        _forget_caches()


def _hold(scene: Scene) -> None:
    assert_drawable(scene)
    for image in scene.images:
        assert image.pixels.shape == (image.height, image.width, 4)


class Draw:
    """Draws each file by one of the chapters `options["chapters"]` on the backend `options["backend"]`."""

    def __init__(self, options: Any, folder: Path) -> None:
        self._numbers: Sequence[int] = options["chapters"]
        self._backend: str = options["backend"]
        self._device: Any = self._context() if self._backend == "gl" else self._vulkan()
        told = self._device.capabilities
        self.device = f"{told.device}, {told.driver}, {self._layers}"
        path = _whole("everything.glb", folder)
        for number in self._numbers:
            self._draw(path, number, 0.0)

    def _context(self) -> Context:
        context = Context(validate=True)
        self._sink: Any = context.sink
        self._layers = "checked"
        return context

    def _vulkan(self) -> Device:
        with Instance() as plain:
            validate = VALIDATION_LAYER in plain.layers
        instance = Instance(validate)
        self._sink = instance.sink
        self._layers = "validated" if validate else "without validation layers"
        return Device(instance)

    def __call__(self, path: Path, case: Case) -> None:
        """Draw it; raises what is wrong with the file, or with the renderer."""
        rng = random.Random(f"draw {case}")
        self._draw(path, rng.choice(self._numbers), rng.choice((0.0, 0.37)))

    def _draw(self, path: Path, number: int, time: float) -> None:
        self._sink.messages.clear()
        lit = path.suffix in PANORAMAS
        with opening.open_scene(
            number, "cornell" if lit else str(path), around=str(path) if lit else "none"
        ) as opened:
            opened.start()
            with chapters.open(
                number,
                self._backend,
                scene=opened.scene,
                size=SIZE,
                outputs={"color", "color_linear"},
                device=self._device,
            ) as renderer:
                view = chapters.view_of(renderer, time=time)
                frame = renderer.render(view, time)
                linear, color = frame.image("color_linear"), frame.image("color")
            opened.finish()
        messages = self._sink.report()
        if self._backend == "gl" and (error := self._device.fn.glGetError()):
            messages.append(f"OpenGL's error {error:#x}")
        faults = faults_of_picture(linear, color, messages)
        assert not faults, f"chapter {number}: " + "\n".join(faults)

    def tidy(self) -> None:
        """Remove what the case has left."""
        _forget_caches()


def faults_of_picture(linear: np.ndarray, color: np.ndarray, messages: Sequence[str]) -> list[str]:
    """Return what is wrong with a picture of `SIZE` and with what the driver and its layers said, in words."""
    shapes = linear.shape[:2], color.shape[:2]
    faults = [] if shapes == (SIZE[::-1], SIZE[::-1]) else [f"shapes {shapes}"]
    odd = int(np.sum(~np.isfinite(linear)))
    return faults + ([f"{odd} numbers are not finite"] if odd else []) + list(messages)


class Command:
    """Gives each file to a command of `strata`, and holds how that ends and what it prints."""

    device = ""

    def __init__(self, options: Any, folder: Path) -> None:
        from chapters.__main__ import run

        self._run = run
        self._files, self._results = (folder / PRINTED, folder / SAID), folder / RESULTS
        self._numbers: Sequence[int] = options["chapters"]
        self._backend: str = options["backend"]
        path = _whole("everything.glb", folder)
        for words in self._commands(path, self._numbers[0]):
            assert run(words) == 0, words

    def _commands(self, path: Path, number: int) -> list[list[str]]:
        """Return the commands that a file may be given to."""
        drawing = ["run", str(number), "--backend", self._backend, "--size", "16x16", "--headless", "-v"]
        if path.suffix in PANORAMAS:
            return [[*drawing, "--environment", str(path), "--scene", "cornell"]]
        return [
            [*drawing, "--scene", str(path)],
            [*drawing, "--scene", str(path), "--json", "-", "--out", str(self._results / "made.png")],
            ["assets", "add", str(path), "--name", "mutated"],
            ["convert", str(path), str(self._results / "converted")],
        ]

    def __call__(self, path: Path, case: Case) -> None:
        """Run a command; raises AssertionError for an ending or a line that no input may cause."""
        rng = random.Random(f"command {case}")
        words = rng.choice(self._commands(path, rng.choice(self._numbers)))
        begins = [os.path.getsize(file) for file in self._files]
        code = self._run(words)
        sys.stdout.flush()
        sys.stderr.flush()
        printed, said = (file.read_bytes()[begin:] for file, begin in zip(self._files, begins, strict=True))
        if path.suffix == ".exr":  # the library that reads it speaks for itself
            said = b"".join(line for line in said.splitlines(True) if b"(EXR_ERR_" not in line)
        faults = faults_of(code, printed, said)
        assert not faults, f"{' '.join(words[:2])}: {', '.join(faults)}\n{said!r}\n{printed[:600]!r}"

    def tidy(self) -> None:
        """Remove what the case has left."""
        _forget_caches()
        shutil.rmtree(self._results / "converted", ignore_errors=True)


def faults_of(code: int, printed: bytes, said: bytes) -> list[str]:
    """Return what is wrong with how a command ended and with what went to stdout and stderr, in words."""
    faults = [] if code in (0, 2) else [f"exit code {code}"]
    try:
        text, lines = (printed + said).decode(), said.decode().splitlines()
    except UnicodeDecodeError:
        return [*faults, "bytes that are no UTF-8"]
    if any(is_hidden(letter) and letter != "\n" for letter in text):
        faults.append("letters that move a terminal")
    if any(line.startswith(FORGED) for line in text.split("\n")):
        faults.append("a forged line")
    if "Traceback" in text or "outlived" in text:
        faults.append("a traceback")
    if code == 2 and (not lines or any(not line.startswith("strata: ") for line in lines)):
        faults.append("no sentence, or one that does not say where it comes from")
    return faults
