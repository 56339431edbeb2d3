"""SPIR-V for shader sources: compiled once, kept in memory and on disk.

An entry on disk is named by a hash of the stage, the whole text (so of every include and constant) and the
compiler's version, so it is never stale. It holds a checksum: an entry that a full disk or a crash left
damaged is compiled again. A start that finds all its entries does not even load the compiler.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import struct
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

from backends.shader_text import ShaderSource, describe_errors
from backends.vulkan.shaders import glslang
from common.errors import ShaderError
from common.files.disk_cache import mark_read, prune
from common.paths import cache_dir, write_whole

MAGIC = 0x07230203  # first word of every SPIR-V module (SPIR-V specification, 2.3)
_HEADER_WORDS = 5
MOST_BYTES = 64 << 20
"""What the cache may take on disk: a chapter's shaders take less than 1 MiB, every edit of one adds some."""


@dataclass
class Counters:
    """How shaders were obtained so far."""

    compiled: int = 0  # by the compiler
    cached: int = 0  # read from disk
    reused: int = 0  # asked for again in this process


def check_module(code: bytes, name: str) -> bytes:
    """Return `code` if it starts like a SPIR-V module in this machine's byte order, or raise ShaderError."""
    if len(code) < 4 * _HEADER_WORDS or len(code) % 4 or struct.unpack_from("=I", code)[0] != MAGIC:
        raise ShaderError(f"{name} is not a SPIR-V module: it does not begin with the word 0x{MAGIC:08x}.")
    return code


class Compiler:
    """Compiles with a cache in `folder`; None works without one. May be used from any thread."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.counters = Counters()
        self._memory: dict[str, bytes] = {}
        self._lock = threading.Lock()

    def compile(self, source: ShaderSource, keep: bool = True) -> bytes:
        """Return the SPIR-V of `source`; raise ShaderError with file, line, caret and chain of includes.

        Without `keep` no cache grows: for texts that live until the reader's next edit.
        """
        code = self._memory.get(source.key)
        if code is not None:
            self._count("reused")
            return code
        path = self._path(source)
        code = _read_entry(path) if path else None
        if code is not None:
            self._count("cached")
            assert path is not None  # it was read
            mark_read(path)
        else:
            code = _compile(source)
            self._count("compiled")
            path = self._path(source)  # anew: it names the compiler, which may turn out not to load
            if path and keep:
                if self.counters.compiled == 1:  # once per process is enough
                    prune(path.parent, MOST_BYTES)
                _write_entry(path, code)
        return self._memory.setdefault(source.key, code) if keep else code

    def compile_all(self, sources: Sequence[ShaderSource], keep: bool = True) -> list[bytes]:
        """Return the SPIR-V of each source in order, compiling different ones on several threads."""
        distinct = list({source.key: source for source in sources}.values())
        missing = [source for source in distinct if source.key not in self._memory]
        threads = min(len(missing), os.cpu_count() or 1)
        if threads > 1:
            with ThreadPoolExecutor(threads, thread_name_prefix="glsl") as pool:
                compiled = list(pool.map(self.compile, missing, repeat(keep)))
        else:
            compiled = [self.compile(source, keep) for source in missing]
        known = dict(zip((source.key for source in missing), compiled, strict=True))
        return [known[source.key] if source.key in known else self.compile(source) for source in sources]

    def _path(self, source: ShaderSource) -> Path | None:
        if self.folder is None:
            return None
        key = hashlib.sha256(f"{glslang.compiler_version()}\n{source.key}".encode()).hexdigest()
        return self.folder / f"{key[:40]}.spv"

    def _count(self, kind: str) -> None:
        with self._lock:
            setattr(self.counters, kind, getattr(self.counters, kind) + 1)


def _compile(source: ShaderSource) -> bytes:
    try:
        code = glslang.compile_text(source.text, source.stage)
    except glslang.CompilationFailed as error:
        raise ShaderError(describe_errors(str(error), source), source.paths) from None
    return check_module(code, source.name)


# An entry is the module followed by its SHA-256.


def _read_entry(path: Path) -> bytes | None:
    """Return the module in a cache entry, or None where there is none or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    code, checksum = data[:-32], data[-32:]
    if hashlib.sha256(code).digest() != checksum:
        return None
    try:
        return check_module(code, path.name)
    except ShaderError:
        return None


def _write_entry(path: Path, code: bytes) -> None:
    """Write a cache entry; a full or read-only disk costs the next start its time, nothing else."""
    with contextlib.suppress(OSError):
        write_whole(path, code + hashlib.sha256(code).digest())


@functools.cache
def shared() -> Compiler:
    """Return the compiler that all of this process uses, with the user's cache."""
    return Compiler(cache_dir("spirv"))


def compile_shader(source: ShaderSource) -> bytes:
    """Return the SPIR-V of `source`, from the caches where they have it; raise ShaderError if it is wrong."""
    return shared().compile(source)


def compile_all(sources: Sequence[ShaderSource], keep: bool = True) -> list[bytes]:
    """Return the SPIR-V of each source in order; the first wrong one raises ShaderError."""
    return shared().compile_all(sources, keep)
