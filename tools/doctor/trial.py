"""Tries a chapter on a driver before its first use: `python -m tools.doctor.trial BACKEND 0 chapter-1/frame ...`.

A chapter's own first frame uses what the chapter needs of a driver. A child process draws two squares at 16x16 by it,
and compares them with the light that was put in. A driver that crashes, hangs or draws something else costs a
sentence, and `auto` takes another backend. Verdicts are kept beside those of the self-tests; one that failed is void
once the chapter's files change.
"""

from __future__ import annotations

import functools
import hashlib
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import chapters
from backends import choice, selftest, verdicts
from backends.verdicts import OK, UNCHECKED, Identity
from common.errors import UnsupportedError
from common.reports import waiting

if TYPE_CHECKING:
    from backends.choice import Choice
    from common.scene import Scene

TIMEOUT_S = 60.0
"""A chapter's first frame takes two seconds in software, most of them for its shaders; ten on a slow, busy machine."""

CHILD = (sys.executable, "-P", "-m", "tools.doctor.trial")


def decide(wanted: str, number: int) -> Choice:
    """Choose a backend for a chapter as `backends.choice.decide` does, among those on which its trial frame is right.

    Raises UnsupportedError for a backend that was asked for and on which the chapter does not run.
    """

    problems: list[str] = []

    def ask(backend: str) -> tuple[str, str]:
        found = choice.probe(backend)
        problem = problem_of(number, backend)
        if problem:
            problems.append(problem)
            raise UnsupportedError(problem)
        return found

    try:
        found = choice.decide(wanted, ask)
    except UnsupportedError:
        if not problems:
            raise
        found = None
    # Vulkan is taken where it is asked for: what is missing would be said when it is opened.
    if found is None or (wanted == "vulkan" and problems):
        said = " and ".join(problems)
        raise UnsupportedError(f"{said[0].upper()}{said[1:]}.")
    return found


def decide_for(number: int) -> Choice:
    """Choose a backend for a study or a fork of a chapter: not one on which the chapter's own trial failed."""

    def ask(backend: str) -> tuple[str, str]:
        found = choice.probe(backend)
        problem = problem_kept(number, backend, choice.identities[backend])
        if problem:
            raise UnsupportedError(problem)
        return found

    try:
        return choice.decide("auto", ask)
    except UnsupportedError:
        return choice.decide("auto")  # its own code may run where the chapter's does not


@functools.cache
def problem_of(number: int, backend: str) -> str:
    """Return why a chapter does not run on the device of a backend that `choice.probe` found, or "": tried once."""
    device = choice.identities[backend]
    if _kept(number, device).startswith(UNCHECKED):
        judge(number, backend, device)
    return problem_kept(number, backend, device)


def judge(number: int, backend: str, device: Identity) -> None:
    """Try a chapter on the driver of a device, and keep the verdict."""
    place = _place(device)
    kept = verdicts.read(place) or {}
    kept[_name(number)] = {_use(number): _try_out(number, backend, device)}
    verdicts.write(place, kept)


def problem_kept(number: int, backend: str, device: Identity) -> str:
    """Return why a chapter does not run on a device, by its last trial, or ""; nothing is tried."""
    verdict = _kept(number, device)
    if verdict == OK or verdict.startswith(UNCHECKED):
        return ""
    told = f"chapter {number} does not run by {choice.NAMES[backend]} on {device.device}: its trial {verdict}"
    return f"{told} ({verdicts.AGAIN})"


def _kept(number: int, device: Identity) -> str:
    found = (verdicts.read(_place(device)) or {}).get(_name(number), {})
    return OK if OK in found.values() else found.get(_use(number), UNCHECKED)


def _place(device: Identity) -> Identity:
    return replace(device, build=f"{device.build} chapters")


def _use(number: int) -> str:
    """Return the "use" under which a verdict is kept: it names the files that were tried."""
    return f"frame of {_files(number)}"


def _try_out(number: int, backend: str, device: Identity) -> str:
    def sentence() -> str:
        return f"trying chapter {number} by {choice.NAMES[backend]} on {device.device}, once for this driver."

    name = _name(number)
    with waiting.told(sentence):
        found = selftest.judge_all(backend, 0, [f"{name}/frame"], timeout_s=TIMEOUT_S, child=CHILD)
    return found[name]["frame"]


def _name(number: int) -> str:
    return f"chapter-{number}"


def _files(number: int) -> str:
    """Return a hash of a chapter's code and shaders."""
    digest = hashlib.sha256()
    for path in sorted(chapters.folder_of(number).rglob("*")):
        if path.is_file() and not {"__pycache__", "studies", "benches"} & {*path.parts}:
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


# --- the child --------------------------------------------------------------------------------------------------------

CODES = (200, 100, 50)
"""The sRGB codes of the texture on the left square, which is unlit: they are what is seen."""


def scene() -> Scene:
    """Return two squares side by side: an unlit one with a texture in one colour, and a red one under a lamp."""
    from common.scene import MESH_DTYPE, Image, Instances, Light, Material, Nodes, Scene, TextureRef

    pixels = np.full((64, 64, 4), (*CODES, 255), np.uint8)
    materials = [
        Material(unlit=True, base_color_texture=TextureRef(0)),
        Material(base_color=(1.0, 0.0, 0.0, 1.0), metallic=0.0, roughness=1.0),
    ]
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    meshes = np.zeros(2, MESH_DTYPE)
    meshes["index_count"], meshes["vertex_count"] = 6, 4
    meshes["material"] = np.arange(2)
    meshes["bounds_min"], meshes["bounds_max"] = corners[0], corners[2]
    # Far from 0, where a wrong derivative is a long one.
    uv = 100.0 + 8.0 * np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    nodes = Nodes(
        parent=np.full(3, -1, np.int32),
        translation=np.array([(-1, 0, 0), (1, 0, 0), (1, 0, 1)], np.float64),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (3, 1)),
        scale=np.ones((3, 3)),
        matrix=np.tile(np.eye(4), (3, 1, 1)),
        has_matrix=np.zeros(3, bool),
        names=["left", "right", "lamp"],
    )
    return Scene(
        name="trial",
        path=None,
        positions=corners,
        normals=np.tile(np.array((0, 0, 1), np.float32), (4, 1)),
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (4, 1)),
        uv0=uv,
        uv1=None,
        colors=None,
        indices=np.array([0, 1, 2, 0, 2, 3], np.uint32),
        meshes=meshes,
        mesh_names=["left", "right"],
        materials=materials,
        images=[Image("one colour", pixels)],
        nodes=nodes,
        instances=Instances(node=np.arange(2, dtype=np.int32), mesh=np.arange(2, dtype=np.int32)),
        lights=[Light("point", 2, intensity=40.0)],
        cameras=[],
        animations=[],
        deformations=[],
    )


def run(number: int, backend: str) -> str:
    """Return what is wrong with a chapter's frame on a backend, or ""."""
    from common.images.color import decode_srgb
    from common.numerics.transforms import pose_looking_at
    from common.view.camera import Orthographic, View, exposure

    view = View(pose_looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), Orthographic(2.0, 0.1, 4.0), ev100=0.0)
    renderer = chapters.renderer_module(number, backend).Renderer
    with renderer(scene(), (16, 16), outputs=("color", "color_linear")) as opened:
        for _ in range(3):  # both slots, and one of them again
            frame = opened.render(view, 0.0)
            light, picture = frame.image("color_linear"), frame.image("color").astype(np.int64)
    textured, lit = light[5:11, 1:7, :3] * exposure(view.ev100), picture[5:11, 9:15]
    expected = np.asarray(decode_srgb(np.array(CODES) / 255.0))
    # A step of a half float is a thousandth, and a filter may lose as much.
    if not np.allclose(textured, expected, rtol=0.01):
        return f"a texture of light {_text(expected)} is drawn as {_text(textured[3, 3])}"
    if lit[..., 0].min() < 16 or lit[..., 1:].max() > lit[..., 0].min():
        return f"a red square under a lamp is drawn as {_text(lit[3, 3])}"
    return ""


def _text(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def main(arguments: Sequence[str]) -> None:
    """Print the verdict on each chapter that `arguments` name, behind the backend and a number."""
    backend, _, *uses = arguments
    selftest.begin_child()
    selftest.tell(selftest.OPENED, OK)
    for use in uses:
        number = int(use.partition("/")[0].removeprefix("chapter-"))
        selftest.tell(use, selftest.attempt(functools.partial(run, number, backend)))


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(0)  # past the clean-up of libraries at exit, which says nothing about the chapter
