"""The figures of the lessons: readable in both schemes, nothing cut off, each in its lesson, and true to the data."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from itertools import combinations, pairwise

import pytest

import chapters
from common.paths import ROOT
from tools.site.chapter import with_figures
from tools.site.draft import Draft
from tools.site.figures import ch01, ch02, ch03, ch04, ch05, figures, inputs_of
from tools.site.figures.canvas import DARK, KINDS, LIGHT, Canvas, variables

FROM_DEVICES = {"ch04-barriers-of-a-frame", "ch04-lives-and-heap", "ch05-two-queues"}
"""Figures of compiled frames, for which a device is opened."""
ALONE = sorted({*figures()} - FROM_DEVICES)


def luminance(color: str) -> float:
    """Return the relative luminance of "#rrggbb" (WCAG 2.2)."""
    codes = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in codes]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first: str, second: str) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_words_have_contrast_on_every_paper(scheme):
    """At least 4.5, the bound of WCAG 2.2 for text of this size."""
    assert LIGHT.keys() == DARK.keys()
    for paper in ("paper", "card", *KINDS):
        assert contrast(scheme["ink"], scheme[paper]) >= 4.5, paper
    for role in ("soft", "mark"):
        assert contrast(scheme[role], scheme["paper"]) >= 4.5, role
    assert contrast(scheme["line"], scheme["paper"]) >= 3


def faults(canvas: Canvas) -> list[str]:
    """Return what cannot be read: a text outside of the drawing, or over another one."""
    found = [
        text
        for text, (left, top, right, bottom) in canvas.texts
        if left < 0 or top < 0 or right > canvas.width or bottom > canvas.height
    ]
    for (text, a), (other, b) in combinations(canvas.texts, 2):
        if min(a[2], b[2]) - max(a[0], b[0]) > 2 and min(a[3], b[3]) - max(a[1], b[1]) > 2:
            found.append(f"{text} / {other}")
    return found


@pytest.mark.parametrize("name", ALONE)
def test_every_word_is_inside_and_beside_the_others(name):
    assert faults(figures()[name]()) == []


@pytest.mark.parametrize("name", sorted(FROM_DEVICES))
def test_every_word_of_a_compiled_frame_is_readable(vulkan_instance, name):
    assert faults(figures()[name]()) == []


def test_a_word_that_is_cut_off_is_a_fault():
    canvas = Canvas(100, 40, "too narrow")
    canvas.text(90, 20, "a long word")
    assert faults(canvas) == ["a long word"]


@pytest.mark.parametrize("name", sorted(figures()))
def test_a_figure_is_a_file_that_its_lesson_shows_and_refers_to(name):
    path = ROOT / "docs" / "pictures" / f"{name}.svg"
    root = ElementTree.fromstring(path.read_text("utf-8"))
    assert (
        root.get("role") == "img"
        and root.get("aria-label")
        and "prefers-color-scheme:dark" in path.read_text("utf-8")
    )
    number = int(name[2:4])
    readme = (chapters.FOLDER / chapters.folder_name(number) / "README.md").read_text("utf-8")
    _, found, after = readme.partition(f"](../../docs/pictures/{name}.svg)")
    assert found and "figure" in after[:400] + readme[: readme.index(found)][-300:]
    assert all(path.is_file() for path in inputs_of(name))


# --- the data ---------------------------------------------------------------------------------------------------------


def test_two_slots_keep_the_gpu_busy_and_one_does_not():
    def idle(slots: int) -> float:
        frames = ch01.timeline(slots)
        return sum(after[3] - before[4] for before, after in pairwise(frames))

    assert idle(2) == 0 and idle(1) == pytest.approx((ch01.FRAMES - 1) * ch01.CPU_MS)


def test_the_table_of_the_split_sum_is_that_of_a_mirror_at_no_roughness():
    """There A is 1 - (1 - n·v)^5 and B is (1 - n·v)^5: Schlick's formula; on all of the table A + B is at most 1."""
    for cosine in (0.2, 0.5, 0.9):
        scale, bias = ch01.directional_albedo(cosine, 0.02)
        schlick = (1 - cosine) ** 5
        assert scale == pytest.approx(1 - schlick, abs=2e-3) and bias == pytest.approx(schlick, abs=2e-3)
        for roughness in (0.1, 0.5, 1.0):
            assert 0 < sum(ch01.directional_albedo(cosine, roughness)) <= 1 + 1e-6


def test_the_half_vector_halves_the_angle():
    view, light = math.radians(48), math.radians(-30)
    x, y = math.sin(view) + math.sin(light), math.cos(view) + math.cos(light)
    assert math.atan2(x, y) == pytest.approx((view + light) / 2)


def test_tasks_begin_after_what_they_wait_for_and_no_thread_does_two_things():
    planned = ch03.schedule()
    ends = {name: end for name, _, _, end in planned}
    for name, _, start, _ in planned:
        before = "read" if name.startswith(("decode", "geometry")) else None
        assert before is None or start >= ends[before]
    for one, other in combinations(planned, 2):
        assert one[1] != other[1] or one[3] <= other[2] + 1e-9 or other[3] <= one[2] + 1e-9


def test_the_edges_are_those_of_the_study():
    names = {text for text, _ in ch04.names_and_edges().texts}
    assert {"scene", "bright", "across", "down", "combine", "show", "outline", "halo", "glow"} <= names


def test_compute_of_a_frame_ends_before_its_graphics_begins():
    for begins, compute, graphics, ends in ch05.timelines():
        assert begins < compute < compute + ch05.COMPUTE_MS <= graphics < ends


def test_the_marked_particle_has_twelve_springs():
    words = [text for text, _ in ch05.springs().texts]
    assert [word for word in words if ": 4," in word] == [
        "stretch: 4, along the threads",
        "shear: 4, across the meshes",
        "bend: 4, two particles away",
    ]


def test_every_chapter_has_figures():
    for module in (ch01, ch02, ch03, ch04, ch05):
        assert len(module.FIGURES) >= 3


def test_a_page_has_the_figure_itself_and_other_drawings_as_pictures():
    """So a figure follows the switch of the page's scheme; no word of it becomes a link to the glossary."""
    draft = Draft((5,))
    path = "docs/pictures/ch05-two-queues.svg"
    link = draft.file(path, "chapters/ch05.md")
    draft.files["pictures/other.svg"] = b"<svg/>"
    text = f"![Queues]({link})\n\n![Other](../pictures/other.svg)\n"
    shown = with_figures(draft, text, "chapters/ch05.md")
    assert (ROOT / path).read_text("utf-8").strip() in shown and "![Other](../pictures/other.svg)" in shown


def test_the_site_s_schemes_win_over_those_of_the_system(built):
    style = (built.folder / "assets" / "site.css").read_text("utf-8")
    for scheme, colors in (("default", LIGHT), ("slate", DARK)):
        assert f"[data-md-color-scheme={scheme}] .strata-figure{{{variables(colors)}}}" in style
    pages = (built.folder / "chapters").glob("ch01*.html")
    page = "".join(path.read_text("utf-8") for path in pages)
    assert page.count('class="strata-figure"') == len(ch01.FIGURES) and "glossary.md#" not in page
