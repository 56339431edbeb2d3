"""A technique of one's own in a fork: a folder, and one line of TECHNIQUES; no other file changes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import chapters
from backends.contract import Technique
from tests.support.scenes import facing, quad_scene

pytestmark = pytest.mark.feature("tools/fork")

SIZE = (24, 16)
PASSES = '''"""The pass of the tint: it takes one colour out of the light."""

from __future__ import annotations

from backends.contract import Access

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass


class TintPass(FullscreenPass):
    """One triangle over the picture."""

    name = "tint"
    reads = (Access("color_focused", "sampled"),)
    writes = (Access("color_tinted", "color", format="rgba16f"),)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        shaders = ("post/fullscreen.vert", "tint/tint.frag")
        return PipelineDescription(shaders, color="rgba16f", depth=None, name="tint")
'''
TECHNIQUE = '''"""The tint outside its pass: it counts its frames, and is at rest."""

from __future__ import annotations

from typing import Any

from backends.contract import Technique

from .passes import TintPass


class TintTechnique(Technique):
    """Takes red out of the picture."""

    name = "tint"

    def create(self, parts: Any, backend: Any, passes: Any) -> None:
        """Make the pass, which the tone curve reads from now on."""
        self.passes = {"tint": TintPass(parts)}
        self.readers = {"tonemap": {"color_focused": "color_tinted"}}

    def prepare(self, frame: Any) -> int:
        """Count the frame."""
        self.work = {"tinted_frames": self.work.get("tinted_frames", 0) + 1}
        return 0
'''
SHADER = """layout(BIND(1, 0, 3)) uniform sampler2D color_focused;
layout(location = 0) out vec4 out_color;
void main() {
    out_color = vec4(texelFetch(color_focused, ivec2(gl_FragCoord.xy), 0).rgb * vec3(0, 1, 1), 1);
}
"""


@pytest.fixture
def fork(tmp_path) -> Path:
    """A fork of the newest chapter whose only change is a folder, and one line of the renderer."""
    newest = chapters.FOLDER / chapters.folder_name(chapters.available()[-1])
    made = tmp_path / "mine"
    left_out = shutil.ignore_patterns("__pycache__", "studies", "benches", "README.md")
    shutil.copytree(newest, made, ignore=left_out)
    folder = made / "tint"
    folder.mkdir()
    for name, text in (
        ("__init__.py", '"""A tint."""\n'),
        ("passes.py", PASSES),
        ("technique.py", TECHNIQUE),
        ("tint.frag", SHADER),
    ):
        (folder / name).write_text(text, "utf-8")
    path = made / "renderer.py"
    lines = path.read_text("utf-8").splitlines(keepends=True)
    (number,) = (n for n, line in enumerate(lines) if line.strip().startswith("TECHNIQUES = ("))
    number += next(n for n, line in enumerate(lines[number:]) if line.rstrip().endswith(")"))
    if lines[number].strip() == ")":  # a technique a line
        lines.insert(number, "        TintTechnique,\n")
    else:
        lines[number] = lines[number].rstrip()[:-1].rstrip(",") + ", TintTechnique)\n"
    first = next(n for n, line in enumerate(lines) if line.startswith("from .shading"))
    lines.insert(first, "from .tint.technique import TintTechnique\n")
    path.write_text("".join(lines), "utf-8")
    return made


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_technique_is_a_folder_and_one_line(fork, backend, request):
    device = request.getfixturevalue("vulkan_device" if backend == "vulkan" else "gl_context")
    scene = quad_scene()
    pictures = []
    for which in (chapters.available()[-1], fork):
        settings = chapters.settings_class(chapters.parse(which))(ambient=1.0, tone_curve="none")
        with chapters.open(which, backend, scene=scene, size=SIZE, settings=settings, device=device) as made:
            frames = [made.render(facing()) for _ in range(3)]
            pictures.append(frames[-1].image("color"))
            techniques, work, names = made.techniques, frames[-1].work, [one.name for one in made.passes]
    before, after = pictures
    assert before[..., 0].max() > 100 and after[..., 0].max() == 0
    assert np.array_equal(before[..., 1:], after[..., 1:])
    assert isinstance(techniques["tint"], Technique) and work["tinted_frames"] == 3
    assert names.index("tint") == names.index("tonemap") - 1 and work["recorded"] == 0
