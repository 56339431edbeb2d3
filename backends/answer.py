"""Says what this machine draws with, for the set-up: `python -P -m backends.answer` prints one line of JSON.

    {"vulkan": DEVICE, "gl": DEVICE, "auto": DEVICE, "layers": [names of Vulkan layers]}

A DEVICE is {"kind", "name"}, kind as in `backends.contract.Capabilities`, or {"problem": sentence, "libraries": [...]}
with the libraries that the dynamic loader does not find. "auto" is what `--backend auto` takes: it also has "backend"
("vulkan" or "gl") and "reason". Devices and choice are those of `backends.choice`, so the set-up and every command
have one opinion. Drivers crash and hang: each backend is asked in a child process with a time limit.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes.util import find_library
from typing import Any

from backends import choice
from backends.vulkan.instance import NO_DEVICE
from common.errors import UnsupportedError
from common.paths import ROOT

TIMEOUT_S = 120.0
"""For Vulkan: the first question to a driver may include self-tests, which have time limits of their own."""

CHILD = (sys.executable, "-P", "-m", "backends.answer", "vulkan")

GL_LIBRARIES = {"libEGL.so.1": "GLCONTEXT_LINUX_LIBEGL", "libGL.so.1": "GLCONTEXT_LINUX_LIBGL"}
"""What glcontext's EGL backend opens on Linux, and the variable that names another file. It needs both: it makes the
context with EGL, and takes the calls of OpenGL out of libGL."""

Answer = dict[str, Any]


def answer() -> Answer:
    """Return the whole answer, whatever became of the drivers."""
    with ThreadPoolExecutor(2) as pool:
        by_vulkan, by_gl = pool.submit(ask_vulkan), pool.submit(probed, "gl")
        answers = {"vulkan": by_vulkan.result(), "gl": by_gl.result()}
    layers = answers["vulkan"].pop("layers", [])
    for backend, device in answers.items():
        if "problem" in device:
            device["libraries"] = missing_libraries(backend)
    return {**answers, "auto": automatic(answers), "layers": layers}


def ask_vulkan(child: Sequence[str] = CHILD, timeout_s: float = TIMEOUT_S) -> Answer:
    """Return the device of Vulkan and "layers", as a child process finds them; a crash or a hang is a "problem"."""
    output, problem = b"", ""
    try:
        done = subprocess.run(
            child,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
            },
            check=False,
        )
        output = done.stdout
        if done.returncode:
            problem = f"its driver crashed, exit code {done.returncode}"
    except subprocess.TimeoutExpired as error:
        output, problem = error.stdout or b"", f"its driver hung for {timeout_s:g} s"
    except OSError as error:
        problem = f"no process could be started to ask: {error}"
    device: Answer = {}
    for line in output.decode("utf-8", "replace").splitlines():
        try:
            part = json.loads(line)
        except ValueError:
            continue  # a driver that prints to stdout
        device |= part if isinstance(part, dict) else {}
    if not problem and not {"kind", "problem"} & device.keys():
        problem = "it gave no answer"
    if problem:
        return {"problem": NO_DEVICE.format(problem), "layers": device.get("layers", [])}
    return device


def probed(backend: str) -> Answer:
    """Return the device of a backend as `choice.probe` finds it in this process."""
    try:
        kind, name = choice.probe(backend)
    except Exception as error:  # a fault of the code costs this one backend, and is told
        return {"problem": str(error) or type(error).__name__}
    return {"kind": kind, "name": name}


def automatic(answers: dict[str, Answer]) -> Answer:
    """Return what `--backend auto` takes, by the rules of `backends.choice` from the answers already there."""

    def asked(backend: str) -> tuple[str, str]:
        device = answers[backend]
        if "problem" in device:
            raise UnsupportedError(device["problem"])
        return device["kind"], device["name"]

    try:
        chosen = choice.decide("auto", asked)
    except UnsupportedError as error:
        return {"problem": str(error)}
    return {"backend": chosen.backend, "reason": chosen.reason, **answers[chosen.backend]}


def missing_libraries(backend: str) -> list[str]:
    """Return the libraries that `backend` opens and the dynamic loader does not find; [] off Linux."""
    if not sys.platform.startswith("linux"):
        return []
    if backend == "vulkan":
        from backends.vulkan.api import open_loader

        try:
            open_loader()
        except UnsupportedError:
            return ["libvulkan.so.1"]
        return []
    return [
        library
        for library, variable in GL_LIBRARIES.items()
        if not os.environ.get(variable) and not _opens(library.removesuffix(".1"))
    ]


def _opens(library: str) -> bool:
    """Whether glcontext finds `library` ("libGL.so"): by its full name, or as it is written here."""
    if find_library(library.removeprefix("lib").removesuffix(".so")):
        return True
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def layers() -> list[str]:
    """Return the names of the Vulkan layers that the loader lists, [] without a loader."""
    from backends.vulkan import api as vk

    try:
        functions, _ = vk.global_functions()
    except UnsupportedError:
        return []
    listed = vk.listed(
        functions.vkEnumerateInstanceLayerProperties,
        "vkEnumerateInstanceLayerProperties",
        "VkLayerProperties",
    )
    return [vk.text(layer.layerName) for layer in listed]


def main(words: Sequence[str]) -> None:
    """Print the whole answer; for "vulkan", in the child, the layers and then the device, each as soon as known."""
    parts = ((lambda: {"layers": layers()}), (lambda: probed("vulkan"))) if words else (answer,)
    for part in parts:
        sys.stdout.write(json.dumps(part()) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(0)  # past the clean-up of libraries at exit, which may crash after the answer is out
