"""The figures and the loop of chapter 9 are true: codes, the mask, turns, blocks, combiners and cells."""

from __future__ import annotations

import re

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters.ch09.rates.model import EDGE_TILE
from tests.twins import rates as twin
from tools.site.figures.canvas import Canvas
from tools.site.figures.ch09 import blocks, cells, codes, combiners, constants, feedback, lists, mask

CODES = {(1, 1): 0, (1, 2): 1, (1, 4): 2, (2, 1): 4, (2, 2): 5, (2, 4): 6, (4, 1): 8, (4, 2): 9, (4, 4): 10}


def words_of(canvas: Canvas) -> list[str]:
    return [text for text, _ in canvas.texts]


def test_each_rate_has_its_code_and_the_pixel_of_its_centre():
    words = words_of(codes.codes_of_rates())
    assert sorted(int(word[5:]) for word in words if word.startswith("code ")) == sorted(CODES.values())
    for width, height in CODES:
        assert codes.lit(width, height) == (int(width / 2), int(height / 2))


def test_the_masks_of_the_figure_are_those_of_its_picture():
    squared = twin.squared_gradient(mask.picture())
    np.testing.assert_allclose(mask.squared(), squared, atol=1e-12)
    column, row = mask.CHOSEN
    words = words_of(mask.tile_of_the_mask())
    shares = []
    for texel in mask.TEXELS:
        count = EDGE_TILE // texel
        most = twin.most_of_texels(squared, texel)[
            row * count : (row + 1) * count, column * count : (column + 1) * count
        ]
        wanted = np.where(most > mask.THRESHOLD, 0, mask.COARSE)
        assert np.array_equal(mask.codes(texel), wanted)
        shares.append((wanted == mask.COARSE).mean())
        assert f"{texel}x{texel}: {100 * shares[-1]:.0f} % coarse" in words
    assert 0 < shares[0] < shares[1] < 1, "the finest rate of a large texel wins more often"
    band = mask.of_tile(squared)[23:26]
    assert 0 < band.max() < mask.THRESHOLD and any(f"{band.max():.2f}" in word for word in words), (
        "a band that is no edge"
    )


def test_the_list_has_each_pixel_once_and_rounds_are_full_but_the_last():
    entries = lists.listed()
    lit = np.zeros((lists.AREA, lists.AREA), int)
    for x, y, side in entries:
        lit[y : y + side, x : x + side] += 1
    assert (lit == 1).all()
    fine = len(lists.FINE)
    assert len(entries) == len(lists.blocks()) + (lists.BLOCK**2 - 1) * fine
    assert 0 <= lists.rounds() * lists.INVOCATIONS - len(entries) < lists.INVOCATIONS


def test_turns_are_those_of_the_shader_and_find_each_texel():
    text = (chapters.folder_of(9) / "rates" / "sobel.glsl").read_text("utf-8")
    (found,) = re.findall(
        r"uint\(texel\.x\) \* (\d)u \+ uint\(texel\.y\) \* (\d)u \+ frame\.frame_index\) & (\d)u", text
    )
    assert tuple(map(int, found)) == (feedback.ALONG, feedback.DOWN, feedback.PERIOD - 1)
    for x in range(feedback.TEXELS):
        alone = feedback.states(x, 0, feedback.FRAMES, feedback.APPEARS, turns=False)
        assert {*alone} == {feedback.COARSE}
        states = feedback.states(x, 0, feedback.FRAMES, feedback.APPEARS)
        first = feedback.APPEARS + feedback.PERIOD
        assert {*states[first:]} == {feedback.FINE}
        assert states[: feedback.APPEARS].count(feedback.FINE) == 0
    frames = np.array(feedback.wall())  # rows, columns, frames
    turns = (frames[:, :, 1] == feedback.TURN).mean()
    assert turns == 1 / feedback.PERIOD, "before the stripes appear"
    assert (frames[:, feedback.WALL[0] // 2 :, -1] == feedback.FINE).all()
    assert not (frames[:, : feedback.WALL[0] // 2] == feedback.FINE).any()


@pytest.mark.parametrize("side", [1, 2, 4])
def test_lit_pixels_are_in_the_picture_and_in_their_block(side):
    width, height = blocks.SIZE
    for origin, (x, y) in blocks.lit(side).items():
        assert origin[0] <= x < min(origin[0] + side, width)
        assert origin[1] <= y < min(origin[1] + side, height)
        if origin[0] + side // 2 < width:
            assert x == origin[0] + side // 2
    assert len(blocks.lit(side)) == -(-width // side) * -(-height // side)


def test_operations_have_the_order_of_the_extension():
    named = [
        getattr(vk, f"VK_FRAGMENT_SHADING_RATE_COMBINER_OP_{name.upper()}_KHR")
        for name in combiners.OPERATIONS
    ]
    assert named == [*range(5)]
    assert combiners.combined((1, 1), (1, 1), (2, 2), combiners.CHAPTER) == (2, 2)
    assert combiners.combined((1, 1), (4, 4), (2, 2), ("keep", "keep")) == (1, 1), "the default"
    from chapters.ch09.rates.vulkan import rates_of_attachment

    state = rates_of_attachment()
    assert [int(number) for number in state.combinerOps] == [
        [*combiners.OPERATIONS].index(name) for name in combiners.CHAPTER
    ]


def test_a_cell_runs_a_fragment_for_each_block_and_triangle():
    """By pixels: each centre lies in one triangle, or on the line between them and in either."""
    count, n = 0, 2 * cells.BLOCKS
    y, x = np.indices((n, n)) + 0.5
    for triangle in (x + y <= n, x + y >= n):
        inside = triangle.reshape(cells.BLOCKS, 2, cells.BLOCKS, 2).any(axis=(1, 3))
        count += int(inside.sum())
    assert cells.fragments() == count == (n // 2) ** 2 + n // 2
    assert f"triangles: {count} fragments" in words_of(cells.cells_of_the_study())


def test_three_values_take_three_pipelines_everywhere():
    counts = [counts for _, counts in constants.ROWS]
    assert {one[-1] for one in counts} == {len(constants.VALUES)}
    assert counts[1][:2] == (1, 1), "one text and one module"
