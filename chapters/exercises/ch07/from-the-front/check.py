"""Lists of random layers, of which many are hidden by those before, against the same steps in float64."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import chapters
from tests.support.kernels import kernels_on
from tests.support.panes import BEHIND, DISTANCE, panes, tilted, view
from tests.twins.layers import Layers, U
from tools.exercises.checking import Given

KERNEL = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) buffer Keys_ { uvec4 keys[]; };
layout(BIND(0, 1, 1), std430) readonly buffer Colors_ { vec4 colors[]; };
layout(BIND(0, 2, 2), std430) readonly buffer Begins_ { uint begins[]; };
layout(BIND(0, 3, 3), std430) buffer Shown_ { vec4 shown[]; };
#include "transparency/sort.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number < COUNT) {
        shown[number].rgb = composited(begins[number], begins[number + 1u], shown[number].rgb);
    }
}
"""
FAINT = 1.0 / 1024.0
BRIGHT = 1000.0
"""The largest value of colours: what is left out is seen in the result."""
LENGTHS = (1, 2, 3, 5, 9, 15, 16, 17, 18, 30, 60, 400) * 6
SIZE = (48, 32)


def check(given: Given) -> None:
    """Lists of all lengths and opacities; equal depths; layers of one half, whose light falls to 1/1024; a picture."""
    rng = np.random.default_rng(77)
    lists = [_layers(rng, count, number) for number, count in enumerate(LENGTHS)]
    lists += [_layers(rng, count, 0, 0.5) for count in (10, 11, 12, 10_000)]
    under = np.column_stack([rng.uniform(0.0, BRIGHT, (len(lists), 3)), np.zeros(len(lists))]).astype(
        np.float32
    )
    under[len(LENGTHS) :, :3] = BRIGHT
    shown = _composited(given, lists, under)
    for layers, behind, found in zip(lists, under[:, :3].astype(np.float64), shown, strict=True):
        _judge(given, layers, behind, found)
    matrices, colors = tilted(5, 24)
    picture = given.draw(
        panes(matrices, colors),
        view(),
        size=SIZE,
        transparency="lists",
        transparency_nodes=24.0,
        background=BEHIND,
    )
    truth = Layers(matrices, colors, SIZE, DISTANCE)
    wrong = np.abs(picture - truth.sorted_over(BEHIND)).max(axis=-1)
    wrong[truth.near_edge | truth.close] = 0.0
    y, x = np.unravel_index(wrong.argmax(), wrong.shape)
    given.need(
        wrong.max() <= FAINT + 200 * U,
        f"In a picture of 24 panes, pixel ({x}, {y}) is off by {wrong.max():.3g}: 1/1024 is what may be left out.",
    )


def _layers(rng: np.random.Generator, count: int, number: int, alpha: float | None = None) -> tuple[Any, Any]:
    """Return keys (N, 3) in any order and colours (N, 4); every third list has layers at few depths."""
    places = rng.permutation(max(count * 4, 64))[:count].astype(np.uint32)
    depth = rng.uniform(0.01, 1.0, count).astype(np.float32)
    if number % 3 == 2:
        depth = np.float32(1.0) / rng.integers(1, 4, count).astype(np.float32)
    keys = np.column_stack([depth.view(np.uint32), places // 8, places % 8])
    opacity = (
        rng.uniform(0.0, (0.9, 0.5, 0.1)[number // 12 % 3], count) if alpha is None else np.full(count, alpha)
    )
    return keys, np.column_stack([rng.uniform(0.0, BRIGHT, (count, 3)), opacity]).astype(np.float32)


def _composited(given: Given, lists: list[tuple[Any, Any]], under: np.ndarray) -> np.ndarray:
    """Return (L, 3) what the shader makes of lists over colours (L, 4)."""
    begins = np.cumsum([0, *(len(keys) for keys, _ in lists)]).astype(np.uint32)
    keys = np.zeros((begins[-1], 4), np.uint32)
    keys[:, :3] = np.concatenate([keys for keys, _ in lists])
    keys[:, 3] = np.arange(len(keys))
    short: Any = given.module("transparency.model")
    defines = (("COUNT", f"{len(lists)}u"), ("SHORT", f"{short.SHORT}u"))
    with (
        TemporaryDirectory() as folder,
        kernels_on(given.device, chapters.package_of(given.which)) as kernels,
    ):
        file = Path(folder) / "lists.comp"
        file.write_text(KERNEL, "utf-8")
        arrays = [keys, np.concatenate([colors for _, colors in lists]), begins, under]
        shown: np.ndarray = kernels.run(kernels.pipeline(file, defines=defines), arrays, (len(lists),))[3]
    given.silent()
    return shown[:, :3].astype(np.float64)


def _judge(given: Given, layers: tuple[Any, Any], behind: np.ndarray, found: np.ndarray) -> None:
    keys, colors = layers
    ranks = np.lexsort(keys.T[::-1])[
        ::-1
    ]  # the nearest first, of equal depths the last instance and triangle
    ordered = colors[ranks].astype(np.float64)
    wanted, used, sure = _seen(ordered, behind)
    bound = (6 * used + 8) * U * BRIGHT

    def like(other: np.ndarray) -> bool:
        return bool(np.abs(found - other).max() <= bound)

    if not sure or like(wanted):
        return
    what = f"A list of {len(ordered)} layers"
    given.need(
        not like(_seen(ordered, behind, 0.0)[0]),
        f"{what} is composited to its end: behind the nearest {used} less than 1/1024 is seen, and the others are not "
        "left out.",
    )
    given.need(
        not like(_seen(ordered, 0.0 * behind)[0]),
        f"{what} is right but for the light behind it, which is seen through its layers, too.",
    )
    given.need(
        not like(_seen(ordered[::-1], behind)[0]),
        f"{what} is composited as if its farthest layer were the nearest one.",
    )
    given.need(
        not like(_seen(ordered, behind, FAINT * (1 + 1e-6))[0]),
        f"{what} ends where exactly 1/1024 is seen: it ends below that.",
    )
    upward = np.lexsort((keys[:, 2], keys[:, 1], ~keys[:, 0]))
    given.need(
        not like(_seen(colors[upward].astype(np.float64), behind)[0]),
        f"{what} has its depths in order; of equal depths, that of the later instance or triangle is the nearer one.",
    )
    given.need(
        False,
        f"{what} becomes {_text(found)}, and from the nearest one to the farthest it is {_text(wanted)}.",
    )


def _seen(ordered: np.ndarray, behind: np.ndarray, faint: float = FAINT) -> tuple[np.ndarray, int, bool]:
    """Return the colour of layers, nearest first; how many are used; whether rounding cannot change their number."""
    color, through, used, sure = np.zeros(3), 1.0, 0, True
    for red, green, blue, alpha in ordered.tolist():
        if through < faint:
            break
        color = color + through * alpha * np.array((red, green, blue))
        through *= 1.0 - alpha
        used += 1
        sure &= through == FAINT or abs(through / FAINT - 1.0) > 1e-4
    return color + through * behind, used, sure


def _text(color: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in color) + ")"
