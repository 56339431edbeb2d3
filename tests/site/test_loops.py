"""The loops of the lessons: small, readable, true to what they show, and still for readers who prefer no motion."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

import chapters
from common.paths import ROOT
from tests.site.test_figures import contrast, faults
from tools.site.draft import Draft
from tools.site.figures import culling
from tools.site.figures.canvas import DARK, LIGHT
from tools.site.figures.ch01 import timeline
from tools.site.figures.film import LARGEST, SCHEMES, Loop, Picture, animated, markup, pictures_of
from tools.site.figures.loops import (
    HOLD,
    LOOPS,
    MOVE,
    RENDERED,
    RING_FRAMES,
    SLOTS,
    UNITS,
    _use,
    compiled,
    files,
    ring,
)

PICTURES = ROOT / "docs" / "pictures"
SHOWN = {name: (loop, True) for name, loop in LOOPS.items()} | {
    name: (loop, False) for name, loop in RENDERED.items()
}


@pytest.mark.parametrize("file", sorted(files()))
def test_a_loop_is_small_moves_and_never_ends(file):
    data = (PICTURES / file).read_bytes()
    assert len(data) < LARGEST
    frames = pictures_of(data)
    assert len(frames) > 15
    assert all((one != other).any() for one, other in pairwise(frames)), (
        "frames that are equal are one, for longer"
    )
    assert data[12:16] == b"VP8X"
    (at,) = [found.start() for found in re.finditer(b"ANIM", data)][:1]
    assert int.from_bytes(data[at + 12 : at + 14], "little") == 0, "it is played again and again"
    paper = DARK if "-dark" in file else LIGHT
    if file.partition(".")[0] not in RENDERED:
        corner = "#" + "".join(f"{int(code):02x}" for code in frames[0][-1, -1])
        assert contrast(corner, paper["ink"]) > 12, "its paper is that of its scheme"


@pytest.mark.parametrize("name", sorted(LOOPS))
def test_words_of_every_frame_are_inside_and_beside_the_others(name):
    loop = LOOPS[name]
    moving = range(3 * HOLD, 3 * HOLD + MOVE) if "graph" in name else ()
    for number in range(loop.frames):
        found = faults(loop.picture(number))
        assert not found or (number in moving and all(" / " in one for one in found)), (number, found)


@pytest.mark.parametrize("name", sorted(SHOWN))
def test_a_lesson_shows_it_with_its_still(name):
    loop, dark = SHOWN[name]
    readme = (chapters.FOLDER / name[:4] / "README.md").read_text("utf-8")
    assert readme.count(markup(name, loop, dark)) == 1
    assert (PICTURES / loop.still).is_file() and "prefers-reduced-motion: reduce" in markup(name, loop, dark)
    for end in SCHEMES if dark else ("",):
        assert f"{name}{end}.webp" in files() and (PICTURES / f"{name}{end}.webp").is_file()


def test_the_site_has_the_files_of_a_loop():
    draft = Draft((1,))
    loop = LOOPS["ch01-frames-in-flight-loop"]
    text = draft.localised(
        markup("ch01-frames-in-flight-loop", loop), "chapters/ch01/README.md", "chapters/ch01.md"
    )
    assert 'src="../pictures/ch01-frames-in-flight-loop.webp"' in text
    assert 'srcset="../pictures/ch01-frames-in-flight.svg"' in text
    assert {"pictures/ch01-frames-in-flight-loop.webp", "pictures/ch01-frames-in-flight-loop-dark.webp"} <= {
        *draft.files
    }
    assert (
        draft.localised('```\n<img src="a.png">\n```', "README.md", "index.md")
        == '```\n<img src="a.png">\n```'
    )


# --- what they show ---------------------------------------------------------------------------------------------------


def test_a_slot_is_never_the_cpus_and_the_gpus_at_once():
    frames = timeline(SLOTS)
    for now in np.linspace(0, frames[-1][4], 500):
        for slot in range(SLOTS):
            words, busy = _use(slot, now)
            own = [one for number, one in enumerate(frames) if number % SLOTS == slot]
            recording = [one for one in own if one[1] <= now < one[2]]
            waiting_or_drawn = [one for one in own if one[2] <= now < one[4]]
            assert len(recording) + len(waiting_or_drawn) == int(busy)
            assert words.startswith("the CPU") == bool(recording) and words.startswith("the GPU") == bool(
                waiting_or_drawn
            )


def test_ranges_of_the_ring_never_overlap_and_who_waits_has_no_room():
    waited = wrapped = 0
    for moment in ring():
        units = [unit for _, first, count, _ in moment.ranges for unit in range(first, first + count)]
        assert len({*units}) == len(units) and all(0 <= unit < UNITS for unit in units)
        ended = [done for *_, done in moment.ranges]
        assert ended == sorted(ended, reverse=True), "copies end in their order"
        waited += moment.waits is not None
        wrapped += any(later[1] < earlier[1] for earlier, later in pairwise(moment.ranges))
        if moment.ranges:
            assert moment.tail == moment.ranges[0][1]
            assert moment.head == moment.ranges[-1][1] + moment.ranges[-1][2]
    assert len(ring()) == RING_FRAMES and waited > 3 and wrapped > 3
    uploads = [upload for moment in ring() for upload, *_ in moment.ranges]
    assert sorted({*uploads}) == list(range(max(uploads) + 1)), "none is left out"


def test_the_graph_is_that_of_the_study():
    first, ordered, edges = compiled()
    assert {*first} - {*ordered} == {"outline"} and first[: len(ordered)] != ordered
    for edge in edges:
        if edge.after in ordered:
            assert ordered.index(edge.before) < ordered.index(edge.after)


def test_a_film_has_its_pictures_and_their_times():
    def dot(c: Picture, number: int) -> None:
        c.circle(10 + 4 * number, 10, 3, "mark", "mark")

    loop = Loop("a dot", "", (40, 20), 6, dot)
    frames = pictures_of(loop.file(LIGHT))
    assert frames.shape == (6, 20, 40, 3)
    for number, frame in enumerate(frames):
        red = (frame[..., 0] > 100) & (frame[..., 1] < 100)
        assert np.argwhere(red)[:, 1].mean() == pytest.approx(10 + 4 * number - 0.5, abs=0.6)
    still = animated([loop.picture(0).image(LIGHT)] * 4, 10)
    assert len(pictures_of(still)) == 1, "a picture that stays is stored once"


def test_the_scan_sums_and_the_survivors_find_their_places():
    values = culling.scan()
    assert values[-1] == tuple(np.cumsum(culling.FLAGS).tolist())
    assert len(values) == culling.STEPS + 1 == 5


def test_the_two_phases_draw_what_is_visible_and_nothing_twice():
    for number in range(culling.TURNS):
        inside, visible = culling.turn()[number]
        early, late, hidden = culling.phases(number)
        assert visible <= early | late <= inside and not early & late and not hidden & visible
    assert any(culling.phases(number)[1] for number in range(culling.TURNS))
