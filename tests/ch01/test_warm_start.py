"""The second start of the program compiles no shader and shows the same picture, bit for bit.

Each start is a process of its own, with a cache folder that only this test knows. What the driver compiles is another
matter: its cache is its own, and chapter 2's lesson.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import chapters
from chapters.ch01 import renderer as tested
from common.paths import ROOT

pytestmark = pytest.mark.newest

START = """
import hashlib, json, sys
from assets import locate
from backends.vulkan.shaders import compiler as shaders, glslang
import chapters
from common.view.camera import view_of_scene
from common.gltf import load_scene
from common.scene.pose import evaluate_pose

scene = load_scene(locate("cornell"))
which, outputs = sys.argv[1], {"color", "instance_id"}
with chapters.open(which, "vulkan", scene=scene, size=(64, 36), outputs=outputs) as renderer:
    frame = renderer.render(view_of_scene(scene, evaluate_pose(scene, 0.0), None, 64 / 36))
    pictures = [frame.image(name).tobytes() for name in ("color", "instance_id")]
counters = shaders.shared().counters
print(json.dumps({
    "compiled": counters.compiled,
    "cached": counters.cached,
    "compiler loaded": glslang.is_loaded(),
    "picture": hashlib.sha256(b"".join(pictures)).hexdigest(),
    "black": not any(pictures[0]),
}))
"""


def start(cache: Path) -> dict[str, object]:
    """Render one frame in a new process and return what it says."""
    environment = {**os.environ, "STRATA_CACHE": str(cache), "PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        [sys.executable, "-c", START, str(Path(tested.__file__).parent)],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    if "UnsupportedError" in run.stderr:
        pytest.skip(f"no Vulkan: {run.stderr.splitlines()[-1]}")
    assert run.returncode == 0, run.stderr
    said: dict[str, object] = json.loads(run.stdout)
    return said


@pytest.fixture(scope="module")
def starts(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], dict[str, object]]:
    """What the first start with an empty cache says, and the second."""
    # A trial of the chapter, where it had none yet, would fill the cache of the first start.
    chapters.choose_backend("vulkan", chapters.parse(Path(tested.__file__).parent))
    cache = tmp_path_factory.mktemp("cache")
    return start(cache), start(cache)


def test_the_second_start_compiles_no_glsl_and_shows_the_same_bits(starts: Any) -> None:
    first, second = starts
    assert first["compiled"] > 0
    assert first["cached"] == 0
    assert second["compiled"] == 0
    assert second["cached"] == first["compiled"]
    assert not second["compiler loaded"]
    assert second["picture"] == first["picture"]
    assert not first["black"]


def test_a_start_that_may_write_nowhere_shows_the_same_bits(starts: Any, tmp_path: Path) -> None:
    """A cache that cannot be made costs compilation, and nothing of the picture."""
    blocked = tmp_path / "a file, no folder"
    blocked.write_bytes(b"")
    without = start(blocked / "cache")
    assert without["compiled"] == starts[0]["compiled"]
    assert without["picture"] == starts[0]["picture"]
