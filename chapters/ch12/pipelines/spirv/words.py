"""The words of SPIR-V: from the bytes of a module to its instructions, one after the other.

A module is a stream of 32-bit words. The first five are the header: magic number, version, generator, id bound, 0. The
instructions follow. The low half of an instruction's first word is the opcode, and the high half is the number of words
of the instruction, itself included. A module may be in either byte order, which the magic number shows. Source: SPIR-V
specification 1.6, section 2.3.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

import numpy as np

from common.errors import ShaderError

MAGIC = 0x07230203
HEADER_WORDS = 5


class SpirvError(ShaderError):
    """Bytes that are not usable SPIR-V; the text is one sentence with the fault and the word where it is."""


# --- words and instructions ---------------------------------------------------------------------------------


def words_of(code: bytes) -> list[int]:
    """Return the words of a module in either byte order, the header included; raise SpirvError for anything else."""
    if len(code) % 4:
        raise SpirvError(
            f"SPIR-V is made of words of 4 bytes, and {len(code)} bytes are no whole number of them."
        )
    if len(code) < 4 * HEADER_WORDS:
        raise SpirvError(f"SPIR-V begins with {HEADER_WORDS} words, and here are only {len(code) // 4}.")
    for order in ("<u4", ">u4"):
        words = np.frombuffer(code, order)
        if words[0] == MAGIC:
            word_list: list[int] = words.tolist()
            return word_list
    first = int.from_bytes(code[:4], "little")
    raise SpirvError(f"This is no SPIR-V: it begins with 0x{first:08x} in place of 0x{MAGIC:08x}.")


def instructions(words: Sequence[int]) -> Iterator[tuple[int, int, Sequence[int]]]:
    """Yield (index of its first word, opcode, operands) of each instruction; raise SpirvError if one is cut off."""
    at, end = HEADER_WORDS, len(words)
    while at < end:
        first = words[at]
        # The opcode has all 16 bits: those of mesh shaders and ray tracing are above 5,000.
        opcode, count = first & 0xFFFF, first >> 16
        if count == 0:
            raise SpirvError(f"The instruction at word {at} of the SPIR-V says that it has no words.")
        if at + count > end:
            raise SpirvError(
                f"The SPIR-V is cut off: the instruction at word {at} has {count} words, and {end - at} are left."
            )
        yield at, opcode, words[at + 1 : at + count]
        at += count


def text(words: Sequence[int]) -> str:
    """Return the text in these words: four bytes each, the first in the lowest bits, up to a zero byte."""
    raw = struct.pack(f"<{len(words)}I", *words)
    end = raw.find(b"\0")
    if end < 0:
        raise SpirvError("A name in the SPIR-V has no end.")
    return raw[:end].decode("utf-8", "replace")
