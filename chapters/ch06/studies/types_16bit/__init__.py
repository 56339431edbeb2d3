"""Study: integers and floats of 16 bits, in memory and in arithmetic, and the same results from 32-bit words.

Two things are separate. Storage of 16 bits halves the bytes that a kernel moves. Arithmetic of 16 bits can be faster
and takes fewer registers. A device may have one without the other: with storage alone, numbers are converted when they
are loaded and stored. Without both, two numbers are packed into one word of 32 bits and computed in 32 bits.

Then the results must be cut to 16 bits. An integer keeps its lower 16 bits and gets its sign from the highest of them;
this is the wraparound of 16-bit arithmetic. A float is rounded to half precision after each operation. Single precision
rounds first, and half precision then rounds again, but a sum or a product of two halves is the same as with one
rounding: single precision has 24 bits, and 2 * 11 + 2 are enough (Figueroa 1995).

Vulkan lets 16-bit floats round up or down, unless a shader asks for the nearest one, which a device may offer.
"""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass

import numpy as np

from backends.contract import Capabilities, Plan, resolve
from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="types 16bit",
    idea="16-bit numbers halve the bytes; 32-bit words give the same bits if each result is cut to 16.",
    order=3,
    features=("precision/16-bit-types",),
)

WAYS = ("types", "packed", "words")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study. Integers give (a x + b) >> shift, halves c h + d."""

    count: int = knob(1000, "numbers of each kind", minimum=1, maximum=1 << 24)
    way: str = knob(
        "types", "16-bit types, two numbers in a word of 32 bits, or a word for each number", choices=WAYS
    )
    a: int = knob(3, "factor of the integers", minimum=-32768, maximum=32767)
    b: int = knob(500, "what is added to them; it grows with time", minimum=-32768, maximum=32767)
    shift: int = knob(1, "bits by which they are shifted to the right", minimum=0, maximum=15)
    c: float = knob(1.1, "factor of the halves", minimum=-65504.0, maximum=65504.0)
    d: float = knob(1000.0, "what is added to them", minimum=-65504.0, maximum=65504.0)


@dataclass
class NumberWork(Work):
    """What a frame did: `bytes` that all four buffers have."""

    dispatches: int = 0
    bytes: int = 0


KERNEL = "studies/types_16bit/affine.comp"
SHADERS = ("post/fullscreen.vert", "studies/types_16bit/show.frag")


def plan_of(capabilities: Capabilities, without: Set[str]) -> Plan:
    """Return the plan of the one feature that 16-bit types need."""
    return resolve((), ("types-16bit",), capabilities, without)


def way_of(settings: Settings, plan: Plan) -> str:
    """Return the way that the device can go: packed words where it has no 16-bit types."""
    return "packed" if settings.way == "types" and not plan.native("types-16bit") else settings.way


def pairs_of(settings: Settings) -> int:
    """Return how many pairs of numbers there are. Each invocation computes one pair; an odd number gets a partner."""
    return (settings.count + 1) // 2


def bytes_of(settings: Settings, way: str) -> int:
    """Return the size of one of the four buffers."""
    return pairs_of(settings) * (8 if way == "words" else 4)


def defines(settings: Settings, way: str, exact: bool = False) -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders; `exact` if the device rounds 16-bit floats to the nearest when asked to."""
    return (("WAY", WAYS.index(way)), ("COUNT", settings.count), ("NEAREST", int(exact)))


def integers(settings: Settings) -> np.ndarray:
    """Return x, (count,) int16: two periods of a wave."""
    phase = np.arange(settings.count) * (2.0 / settings.count)
    return np.rint(12_000 * np.sin(math.tau * phase)).astype(np.int16)


def halves(settings: Settings) -> np.ndarray:
    """Return h, (count,) float16: half a period of a wave."""
    phase = np.arange(settings.count) * (0.5 / settings.count)
    return (100.0 * np.cos(math.tau * phase)).astype(np.float16)


def encoded(numbers: np.ndarray, way: str) -> np.ndarray:
    """Return the content of a buffer, (N,) uint32, for numbers of 16 bits: two in a word, or one."""
    even = np.append(numbers, np.zeros(len(numbers) % 2, numbers.dtype))
    if way != "words":
        return even.view(np.uint32)
    wide: np.ndarray = (
        even.astype(np.int32).view(np.uint32) if even.dtype == np.int16 else even.view(np.uint16)
    )
    return wide.astype(np.uint32)


def decoded(content: np.ndarray, kind: type, settings: Settings, way: str) -> np.ndarray:
    """Return the numbers, (count,) of `kind`, in the bytes of a buffer."""
    words = content.view(np.uint32)
    numbers = (words & 0xFFFF).astype(np.uint16) if way == "words" else words.view(np.uint16)
    return numbers.view(kind)[: settings.count]


def push(settings: Settings, time: float) -> np.ndarray:
    """Return the push constants, (8,) uint32: a, b, shift and pairs; the bits of c and d."""
    b = settings.b + math.floor(4000.0 * time)
    numbers = np.array([settings.a, b, settings.shift, pairs_of(settings)], np.int64)
    constants = np.array([settings.c, settings.d, 0.0, 0.0], np.float16).view(np.uint16)
    return np.concatenate([numbers.astype(np.uint32), constants.astype(np.uint32)])
