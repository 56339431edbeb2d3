"""Damaged files: whatever bytes change, a scene that a renderer can draw comes out, or one sentence. Quickly."""

from __future__ import annotations

import random
import re
import struct
import threading
import time
import warnings
from pathlib import Path

import pytest

from common.errors import SceneError
from common.gltf import load_scene
from common.paths import asset_dir
from common.scene import Scene
from tests.common.gltf.builder import everything
from tests.support.drawable import assert_drawable
from tests.support.timing import PATIENCE_S

ASSETS = asset_dir()
LIMIT_S = 5.0
"""No mutation of a file of some kilobytes may take longer, of its thread's own time; most take a few milliseconds."""

SMALL = [
    "AnimatedCube", "Box", "BoxInterleaved", "BoxVertexColors", "Cameras", "Cube", "MeshPrimitiveModes",
    "SimpleInstancing", "SimpleMeshes", "SimpleMorph", "SimpleSkin", "SimpleSparseAccessor", "Triangle",
    "TriangleWithoutIndices",
]  # fmt: skip
NUMBERS = [
    b"-1",
    b"0",
    b"1",
    b"255",
    b"65535",
    b"4294967295",
    b"9007199254740993",
    b"1e308",
    b"0.5",
    b"null",
    b'"x"',
]
WORDS = [
    0,
    1,
    0xFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    0x7FC00000,
    0x7F800000,
    0x00000001,
    0xFF7FFFFF,
]


def mutate(data: bytes, rng: random.Random) -> bytes:
    """Return `data` with one to four changes, each of a kind that finds other faults."""
    damaged = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        place = rng.randrange(len(damaged))
        match rng.randrange(8):
            case 0:
                damaged[place] ^= 1 << rng.randrange(8)
            case 1:
                damaged[place] = rng.randrange(256)
            case 2:
                word = struct.pack("<I", rng.choice(WORDS))
                start = place & ~3
                damaged[start : start + 4] = word[: len(damaged) - start]
            case 3:
                del damaged[place : place + rng.choice((1, 4, 64))]
            case 4:
                damaged[place:place] = bytes(rng.randrange(256) for _ in range(rng.choice((1, 4))))
            case 5:
                damaged = damaged[: max(1, place)] if rng.random() < 0.3 else damaged
            case _:  # a number of the JSON becomes another: what most of the loader has to withstand
                numbers = list(re.finditer(rb"(?<=[:\[,\s])-?[0-9][0-9.e+-]*(?=[,\]\}\s])", damaged))
                if numbers:
                    found = rng.choice(numbers)
                    damaged[found.start() : found.end()] = rng.choice(NUMBERS)
        if not damaged:
            break
    return bytes(damaged) or b"\0"


def repair_header(data: bytes) -> bytes:
    """Make the lengths in a .glb fit again, so that the damage inside is reached."""
    if data[:4] != b"glTF" or len(data) < 20:
        return data
    end = data.find(b"BIN\0")
    size = (end - 4 if end > 24 else len(data)) - 20
    return data[:8] + struct.pack("<II", len(data), size) + data[16:]


def in_time(path: Path, what: str) -> bool:
    """Load in a thread that may be given up; True for a scene, False for a sentence, anything else fails."""
    outcome: list[object] = []
    took: list[float] = []

    def work() -> None:
        began = time.thread_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                outcome.append(load_scene(path))
        except BaseException as error:
            outcome.append(error)
        took.append(time.thread_time() - began)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    assert took, f"{what} still loads after {PATIENCE_S:g} s"
    assert took[0] < LIMIT_S, f"{what} took {took[0]:.1f} s"
    result = outcome[0]
    if isinstance(result, Scene):
        assert_drawable(result)
        return True
    assert isinstance(result, SceneError), f"{what}: {result!r}"
    assert "\n" not in str(result) and str(result).startswith(f"{path}: ")
    return False


def run(folder: Path, seed: int) -> bool:
    """Damage one file of one small model, as `seed` says."""
    rng = random.Random(seed)
    sources = [everything] * 6 + ([] if ASSETS is None else [ASSETS / "models" / name for name in SMALL])
    source = rng.choice(sources)
    if isinstance(source, Path):
        files = {
            path.name: path.read_bytes()
            for path in source.iterdir()
            if path.suffix in (".gltf", ".glb", ".bin")
        }
    else:
        form = rng.choice(("glb", "gltf"))
        gltf = source()
        files = {"scene.glb": gltf.glb()} if form == "glb" else {}
        if form == "gltf":
            gltf.json["buffers"] = [{"byteLength": len(gltf.data), "uri": "scene.bin"}]
            files = {"scene.gltf": gltf.text().encode(), "scene.bin": bytes(gltf.data)}
    name = rng.choice(sorted(files))
    files[name] = mutate(files[name], rng)
    if name.endswith(".glb") and rng.random() < 0.8:
        files[name] = repair_header(files[name])
    for file, data in files.items():
        (folder / file).write_bytes(data)
    main = next(folder / file for file in sorted(files) if not file.endswith(".bin"))
    return in_time(main, f"seed {seed}, {main.name} of {getattr(source, 'name', 'everything')}")


def test_the_file_with_everything_loads(tmp_path):
    scene = load_scene(everything().write(tmp_path))
    assert scene.warnings == []
    assert_drawable(scene)
    assert (len(scene.images), len(scene.lights), len(scene.cameras)) == (2, 1, 1)
    assert len(scene.deformations) == 1 and len(scene.animations[0].channels) == 3


@pytest.mark.parametrize("batch", range(4))
def test_two_hundred_mutations(tmp_path, batch):
    loaded = sum(run(tmp_path, seed) for seed in range(50 * batch, 50 * batch + 50))
    assert 5 <= loaded <= 45, "mutations that all load, or none, would prove nothing"


@pytest.mark.long
@pytest.mark.parametrize("batch", range(20))
def test_two_thousand_mutations(tmp_path, batch):
    for seed in range(1000 + 100 * batch, 1100 + 100 * batch):
        run(tmp_path, seed)
