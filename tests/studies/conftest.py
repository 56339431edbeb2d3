"""What tests of studies get: a device of each backend in turn, and a study opened on it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import chapters
from backends.contract import Renderer
from chapters import studies
from common.view.camera import View
from tests.support import gl_functions, gpu_functions
from tests.support.gl_functions import assert_silent


@dataclass(frozen=True)
class Opener:
    """Opens studies on one device, which the tests of a module share: "phong" of chapter 1, "2/flipbook" of another."""

    backend: str
    device: Any

    def open(self, name: str, size: tuple[int, int], scene: Any = None, **more: Any) -> Renderer:
        """Return the renderer of a study; what it draws by itself unless a scene is given."""
        which = name if "/" in name else f"1/{name}"
        drawn = studies.load(which, None, None, "none") if scene is None else scene
        return chapters.open(which, self.backend, scene=drawn, size=size, device=self.device, **more)

    def draw(
        self, name: str, size: tuple[int, int], time: float = 0.0, view: View | None = None, **more: Any
    ) -> dict[str, np.ndarray]:
        """Return the outputs of one frame, by name."""
        outputs = more.pop("outputs", ("color",))
        with self.open(name, size, outputs=outputs, **more) as renderer:
            frame = renderer.render(view if view is not None else chapters.view_of(renderer), time)
            return {output: frame.image(output) for output in outputs}

    def evaluate(
        self, file: str, body: str, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, str]
    ) -> dict[str, np.ndarray]:
        """Return what a few lines of GLSL wrote that call functions of a study's file, "phong/phong.glsl"."""
        where = gpu_functions if self.backend == "vulkan" else gl_functions
        return where.evaluate(self.device, [f"../chapters/ch01/studies/{file}"], body, inputs, outputs)


@pytest.fixture(scope="module", params=("vulkan", "gl"))
def stage(request: pytest.FixtureRequest) -> Opener:
    """Each backend in turn."""
    fixture = "vulkan_device" if request.param == "vulkan" else "gl_context"
    return Opener(request.param, request.getfixturevalue(fixture))


@pytest.fixture(autouse=True)
def _nothing_is_said(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test on any message of the layers or of a driver."""
    if "stage" not in request.fixturenames:
        yield
        return
    opener: Opener = request.getfixturevalue("stage")
    if opener.backend == "gl":
        opener.device.make_current()
        opener.device.sink.messages.clear()
        yield
        assert_silent(opener.device)
    else:
        sink = opener.device.sink
        sink.messages.clear()
        yield
        messages = sink.report()
        sink.messages.clear()
        assert not messages, "\n".join(messages)
