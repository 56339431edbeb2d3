"""What workers of a sweep do with a part in tests, in place of tracing it: found by name in processes of their own."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tools.reference.sums import block_after
from tools.reference.sweep import pools
from tools.reference.sweep.merging import Reference
from tools.reference.sweep.work import Blocks, Part, trace_part
from tools.reference.tiles import Tile

Float64 = NDArray[np.float64]


def blocks_of(part: Part) -> Blocks:
    """Return blocks of numbers that follow from reference, pixel, and the number of the first path of each block."""
    width, height = part.request.size
    sums, first = [], part.first
    for count in part.counts:
        noise = np.random.default_rng((part.reference, first))
        light = noise.uniform(0.0, 100.0, (height, width, 4)).astype(np.float32)[part.tile.place]
        light[..., 3] = count
        squares = (light[..., :2] ** 2 * np.float32(1.5)).astype(np.float32)
        squares[..., 1] = 0.0
        sums.append((light, squares))
        first += count
    return Blocks(tuple(sums), "made up", 0.25)


def blocks_or_end(part: Part) -> Blocks:
    """Return the same, but end the process at the second part of a reference with seed 1, with others at it."""
    if part.request.seed == 1 and part.first == 16:
        time.sleep(0.1)
        os._exit(1)
    return blocks_of(part)


def on_outcomes(
    monkeypatch: pytest.MonkeyPatch, kind: Any, number: int, act: Callable[[Any], object]
) -> None:
    """Call `act` with the pool before the outcome of this number is waited for."""
    outcomes, left = kind.outcomes, [number]

    def watched(self: Any) -> list[pools.Outcome]:
        left[0] -= 1
        if left[0] == 0:
            act(self)
        found: list[pools.Outcome] = outcomes(self)
        return found

    monkeypatch.setattr(kind, "outcomes", watched)


def traced_or_end(part: Part) -> Blocks:
    """Trace a part and note it beside the picture, but end the process at the first try of one tile."""
    assert part.request.out is not None, "sweeps name it"
    notes, mine = part.request.out.with_suffix(".txt"), f"{part.first} {part.tile.number}\n"
    with notes.open("a") as file:
        file.write(mine)
    if part.tile.number == 3 and notes.read_text().splitlines().count("0 3") == 1:
        os._exit(1)
    return trace_part(part)


def merged_alone(reference: Reference) -> tuple[Float64, Float64, int]:
    """Return the sums of a reference block by block, with an error judged after each: (light, squares, paths)."""
    width, height = reference.request.size
    light, squares, paths = np.zeros((height, width, 4)), np.zeros((height, width, 2)), 0
    while paths + (count := block_after(paths, width * height)) <= reference.request.paths:
        part = Part(
            reference.request, (), reference.number, paths, (count,), Tile(0, (0, 0), (width, height))
        )
        ((one, two),) = blocks_of(part).sums
        light, squares, paths = light + one.astype(float), squares + two.astype(float), paths + count
        if paths < 32 or paths % max(2 ** (paths.bit_length() - 5), 1):
            continue
        mean = light[..., :3] @ (0.2126, 0.7152, 0.0722) / paths
        variance = np.maximum(squares[..., 0] / paths - mean**2, 0.0) / (paths - 1)
        dark = 0.01 / reference.scale
        if np.sqrt((variance / (mean**2 + dark**2)).mean()) <= reference.request.error:
            break
    return light, squares, paths


class AnyOrder(pools.Here):
    """Ends parts in an order by lot, several at a time."""

    workers = 5

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._lot = np.random.default_rng(seed)
        self.traced = 0

    def outcomes(self) -> list[pools.Outcome]:
        """Return some parts that are made up."""
        order = [*self._lot.permutation(len(self._parts))][: self._lot.integers(1, 4)]
        chosen = [self._parts[number] for number in order]
        self.drop({part.key for part in chosen})
        self.traced += len(chosen)
        return [(part, blocks_of(part)) for part in chosen]
