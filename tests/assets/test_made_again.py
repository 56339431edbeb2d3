"""The committed scenes are what their generators make now, on this processor and on a plainer one.

Structure, indices and the size of pictures must agree exactly; floats may be one step of the grid apart and pixels 1 of
255, since sines and powers differ in the last bit between processors. Files are read here with numpy and Pillow alone.
"""

from __future__ import annotations

import io
import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from assets import SCENES, write
from assets.gltf_writer import GRID, GltfBuilder
from assets.scenes import COMMITTED
from assets.shapes import quad
from common.paths import ROOT

DTYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read(path: Path) -> tuple[dict[str, Any], bytes, dict[str, np.ndarray]]:
    """Return JSON, buffer, and pixels by name of a .gltf or .glb file."""
    if path.suffix == ".glb":
        data = path.read_bytes()
        length = struct.unpack_from("<I", data, 12)[0]
        root, blob = json.loads(data[20 : 20 + length]), data[28 + length :]
    else:
        root = json.loads(path.read_text("utf-8"))
        blob = (path.parent / root["buffers"][0]["uri"]).read_bytes()
    pictures = {}
    for image in root.get("images", ()):
        if "uri" in image:
            stream = (path.parent / image["uri"]).read_bytes()
        else:
            view = root["bufferViews"][image["bufferView"]]
            stream = blob[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        pictures[image["name"]] = np.asarray(Image.open(io.BytesIO(stream)))
    return root, blob, pictures


def decode(root: dict[str, Any], blob: bytes, accessor: dict[str, Any]) -> np.ndarray:
    view = root["bufferViews"][accessor["bufferView"]]
    count = accessor["count"] * WIDTHS[accessor["type"]]
    return np.frombuffer(blob, DTYPES[accessor["componentType"]], count, view.get("byteOffset", 0))


def on_the_grid(path: Path) -> bool:
    """Return whether every float in the buffer of a file is a whole number of steps, and no zero is negative."""
    root, blob, _ = read(path)
    floats = [decode(root, blob, a) for a in root["accessors"] if a["componentType"] == 5126]
    values = np.concatenate(floats).astype(np.float64)
    return bool((values * 4096 % 1 == 0).all() and not (np.signbit(values) & (values == 0)).any())


def compare_json(one: Any, other: Any, at: str = "") -> None:
    """Fail unless two documents agree: whole numbers, texts and structure exactly, other numbers within a step."""
    if isinstance(one, dict) and isinstance(other, dict):
        assert list(one) == list(other), at
        for key in one:
            compare_json(one[key], other[key], f"{at}.{key}")
    elif isinstance(one, list) and isinstance(other, list):
        assert len(one) == len(other), at
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            compare_json(a, b, f"{at}[{k}]")
    elif isinstance(one, float) or isinstance(other, float):
        assert abs(one - other) <= GRID, at
    else:
        assert one == other and type(one) is type(other), at


def compare(path: Path, other_path: Path) -> None:
    """Fail unless two files hold the same scene."""
    (root, blob, pictures), (other, other_blob, other_pictures) = read(path), read(other_path)
    for document in (root, other):
        for image in document.get("images", ()):
            if "bufferView" in image:  # PNG: versions of zlib pack it differently
                document["bufferViews"][image["bufferView"]] = {}
                document["buffers"][0].pop("byteLength", None)
    compare_json(root, other)
    for number, accessor in enumerate(root["accessors"]):
        a, b = decode(root, blob, accessor), decode(other, other_blob, accessor)
        if accessor["componentType"] == 5126:
            assert np.abs(a - b).max() <= GRID, f"accessor {number}"
        else:
            within = 1 if accessor.get("normalized") else 0  # a colour is a pixel of its own
            assert np.abs(a.astype(int) - b).max() <= within, f"accessor {number}"
    assert list(pictures) == list(other_pictures)
    for name, pixels in pictures.items():
        assert pixels.shape == other_pictures[name].shape, name
        assert np.abs(pixels.astype(int) - other_pictures[name]).max() <= 1, name


@pytest.mark.parametrize("name", [name for name, info in SCENES.items() if info.in_clone])
def test_a_committed_scene_is_what_its_generator_makes(name, tmp_path):
    info = SCENES[name]
    made = write(name, tmp_path, binary=info.binary)
    committed = info.committed()
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in committed.parent.iterdir()}
    compare(committed, made)
    assert on_the_grid(committed) and on_the_grid(made)


def test_the_comparison_finds_what_differs(tmp_path):
    """A step of the grid and 1 of 255 pass; two steps, another index, two of 255, or another name do not."""

    def scene(
        folder: str, right: float = 1.0, grey: int = 100, name: str = "wall", flip: bool = False
    ) -> Path:
        builder = GltfBuilder("test")
        image = builder.add_image("picture", np.full((2, 2, 3), grey, np.uint8))
        material = builder.add_material(name)
        mesh = quad((0, 0, 0), (right, 0, 0), (0, -1, 0))
        if flip:
            mesh.triangles[:] = mesh.triangles[:, ::-1]
        builder.add_node("wall", mesh=builder.add_mesh("wall", (mesh, material)))
        assert image == 0
        return builder.save(tmp_path / folder, binary=False)

    plain = scene("plain")
    compare(plain, scene("near", right=1.0 + GRID, grey=101))
    for wrong in ({"right": 1.0 + 2 * GRID}, {"grey": 102}, {"name": "floor"}, {"flip": True}):
        with pytest.raises(AssertionError):
            compare(plain, scene(str(wrong), **wrong))


@pytest.mark.parametrize(("name", "size"), [("atrium", "small"), ("city", "10K"), ("market", "lights=33")])
def test_a_plainer_processor_makes_the_same_scene(name, size, tmp_path):
    """numpy takes other code for sines and powers without the wider instructions; the files stay the same."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    extra = [feature for feature in __cpu_dispatch__ if __cpu_features__.get(feature)]
    if not extra:
        pytest.skip("this processor has no instructions that numpy could do without")
    code = f"import sys; from assets import write; write('{name}:{size}', sys.argv[1])"
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(extra)}
    subprocess.run([sys.executable, "-c", code, tmp_path / "plain"], cwd=ROOT, env=environment, check=True)
    compare(write(f"{name}:{size}", tmp_path / "here"), tmp_path / "plain" / f"{name}.gltf")


def test_the_clone_stays_small():
    files = [path for path in COMMITTED.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 5_000_000
    assert {path.parent.name for path in files} == {name for name, info in SCENES.items() if info.in_clone}
