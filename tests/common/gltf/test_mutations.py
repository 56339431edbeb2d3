"""Damaged files: whatever bytes change, a scene that a renderer can draw comes out, or one sentence. Quickly."""

from __future__ import annotations

import random
import re
import struct
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from common.errors import SceneError
from common.gltf import load_scene
from common.paths import asset_dir
from common.pose import evaluate_pose
from common.scene import Scene
from tests.common.gltf.builder import QUAD, QUAD_INDICES, Gltf
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


def everything() -> Gltf:
    """A small file with one of everything that the loader reads."""
    gltf, rng = Gltf(), np.random.default_rng(0)
    image = gltf.image(rng.integers(0, 256, (4, 4, 3)).astype(np.uint8))
    photo = gltf.image(rng.integers(0, 256, (8, 8, 3)).astype(np.uint8), "JPEG")
    sampler = gltf.add("samplers", {"magFilter": 9728, "minFilter": 9986, "wrapS": 33071})
    textures = [gltf.add("textures", {"source": source, "sampler": sampler}) for source in (image, photo)]
    transform = {
        "extensions": {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 2]}}
    }
    material = gltf.add(
        "materials",
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": textures[1], **transform}},
            "normalTexture": {"index": textures[0], "scale": 0.5},
            "emissiveFactor": [1, 0.5, 0],
            "alphaMode": "MASK",
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5}},
        },
    )
    part = gltf.primitive(
        QUAD_INDICES,
        targets=[{"POSITION": QUAD * 0.5}],
        POSITION=QUAD,
        NORMAL=np.tile((0, 0, 1), (4, 1)).astype("f4"),
        TEXCOORD_0=QUAD[:, :2].copy(),
        COLOR_0=gltf.accessor(rng.integers(0, 256, (4, 4)), "u1", normalized=True),
        JOINTS_0=np.tile((0, 1, 0, 0), (4, 1)).astype("u1"),
        WEIGHTS_0=np.tile((0.5, 0.5, 0, 0), (4, 1)).astype("f4"),
        material=material,
    )
    lines = gltf.primitive(POSITION=QUAD, mode=2)
    gltf.add(
        "skins", {"joints": [0, 1], "inverseBindMatrices": gltf.accessor(np.tile(np.eye(4).ravel(), (2, 1)))}
    )
    gltf.node(translation=[0, 1, 0], children=[1])
    gltf.node(rotation=[0, 0.6, 0, 0.8])
    gltf.draw(part, skin=0, weights=[0.25])
    copies = {"attributes": {"TRANSLATION": gltf.accessor(QUAD), "SCALE": gltf.accessor(QUAD + 1)}}
    gltf.node(mesh=gltf.mesh(lines), extensions={"EXT_mesh_gpu_instancing": copies})
    gltf.json["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"outerConeAngle": 1}}]}
    }
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    gltf.node(
        camera=camera, extensions={"KHR_lights_punctual": {"light": 0}}, matrix=np.eye(4).ravel().tolist()
    )
    times = gltf.accessor([0, 0.5, 1], "f4")
    keys = [
        ("rotation", "CUBICSPLINE", gltf.accessor(rng.normal(size=(9, 4)), "f4"), 1),
        ("translation", "STEP", gltf.accessor(rng.normal(size=(3, 3)), "f4"), 0),
        ("weights", "LINEAR", gltf.accessor(rng.random(3), "f4"), 2),
    ]
    samplers = [{"input": times, "output": output, "interpolation": how} for _, how, output, _ in keys]
    channels = [
        {"sampler": number, "target": {"node": node, "path": path}}
        for number, (path, _, _, node) in enumerate(keys)
    ]
    gltf.add("animations", {"samplers": samplers, "channels": channels})
    sparse = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\1\0"), "componentType": 5123},
        "values": {"bufferView": gltf.view(QUAD[2].tobytes())},
    }
    spread = gltf.add("accessors", {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    gltf.draw(gltf.primitive(gltf.accessor([0, 1, 2, 3], "u1"), POSITION=spread, mode=5))
    return gltf


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


def assert_drawable(scene: Scene) -> None:
    """Everything that reaches a graphics card is finite and in range."""
    for name in ("positions", "normals", "tangents", "uv0", "uv1", "colors"):
        values = getattr(scene, name)
        assert values is None or (len(values) == len(scene.positions) and np.isfinite(values).all()), name
    for row in scene.meshes:
        indices = scene.indices[row["first_index"] : row["first_index"] + row["index_count"]]
        assert len(indices) == row["index_count"] and indices.max(initial=0) < row["vertex_count"]
        assert row["first_vertex"] + row["vertex_count"] <= len(scene.positions)
        assert row["material"] < len(scene.materials)
    assert scene.instances.mesh.max(initial=-1) < len(scene.meshes)
    assert scene.instances.node.max(initial=-1) < len(scene.nodes)
    for material in scene.materials:
        for texture in material.textures().values():
            assert texture.image < len(scene.images)
    assert np.isfinite(scene.bounds).all()
    with np.errstate(all="ignore"):
        pose = evaluate_pose(scene, 0.37)
    assert np.isfinite(pose.world_from_object).all()
    for vertices in pose.vertices.values():
        assert all(np.isfinite(values).all() for values in vertices)


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
