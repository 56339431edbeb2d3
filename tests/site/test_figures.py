"""The figures of the lessons: readable in both schemes, nothing cut off, each in its lesson, and true to the data."""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from itertools import combinations, pairwise

import numpy as np
import pytest

import chapters
from common.paths import ROOT
from tools.site.chapter import with_figures
from tools.site.draft import Draft
from tools.site.figures import ch01, ch02, ch03, ch04, ch05, ch06, ch07, culling, figures, inputs_of, measured
from tools.site.figures.canvas import DARK, KINDS, LIGHT, Canvas, variables
from tools.site.figures.charts import Axis, Curve, bars, curves, number

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
    for role in ("line", "s1", "s2", "s3", "s4"):
        assert contrast(scheme[role], scheme["paper"]) >= 3, role


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


def test_the_ball_is_cut_into_whole_meshlets_in_colours_that_differ_at_edges():
    triangles, of, colors, _ = ch06.cut_ball()
    counts = np.bincount(of)
    assert len(triangles) == 2 * ch06.AROUND * (ch06.RINGS - 1) and counts.max() <= 124
    owners: dict[tuple[tuple[float, ...], ...], set[int]] = {}
    for corners, meshlet in zip(triangles.tolist(), of.tolist(), strict=True):
        for first, second in combinations(sorted(map(tuple, corners)), 2):
            owners.setdefault((first, second), set()).add(meshlet)
    pairs = [two for two in owners.values() if len(two) == 2]
    assert len(pairs) > 100 and all(len({colors[meshlet] for meshlet in two}) == 2 for two in pairs)


def test_from_the_region_of_the_cone_no_normal_faces_the_eye_for_any_vertex_in_the_sphere():
    """At its edge, dot(c - e, a) = sin(alpha) |c - e| + r; y counts downwards and the axis points upwards."""
    bound = 50.0
    sine = math.sin(ch06.HALF_ANGLE)
    for x, y in ch06.back_region(bound)[1:-1]:
        assert y == pytest.approx(sine * math.hypot(x, y) + bound)
        for angle in np.linspace(-ch06.HALF_ANGLE, ch06.HALF_ANGLE, 9):
            normal = np.array((math.sin(angle), -math.cos(angle)))
            assert normal @ (-x, -y) >= bound - 1e-9, "as far behind the plane as a vertex can be before it"


def test_each_texel_of_the_figure_is_the_minimum_of_its_pixels():
    depth, *levels = ch06.levels()
    height, width = depth.shape
    for power, level in enumerate(levels, 1):
        side = 2**power
        assert level.shape == (-(-height // side), -(-width // side))
        for (row, column), value in np.ndenumerate(level):
            assert value == depth[row * side : (row + 1) * side, column * side : (column + 1) * side].min()
    assert levels[-1].shape == (1, 1) and ch06.level_of((4, 2), (8, 5)) == 2
    assert [ch06.level_of((first, 0), (first + 31, 0)) for first in (96, 100)] == [4, 5]


def test_blocks_of_the_street_hide_what_a_ray_says():
    """A block in front of another, one beside it, and one behind the eye."""
    eye = culling.Eye(0.0, 0.0, 0.0, 0.4)
    blocks = [
        culling.Block(2.0, -0.5, 0.5, 1.0),
        culling.Block(4.0, -0.3, 1.0, 0.6),
        culling.Block(4.0, 1.2, 1.0, 0.3),
        culling.Block(-4.0, -0.5, 1.0, 1.0),
    ]
    assert culling.seen_from(eye, blocks) == ({0, 1, 2}, {0, 2})


def test_a_chart_puts_points_where_their_numbers_are():
    """On a logarithmic axis equal ratios are equal lengths, on a linear one equal differences are."""
    shown = curves(
        "t",
        Axis("x", log=True),
        Axis("y"),
        [Curve("one", [(1, 0), (10, 5), (1000, 10)]), Curve("two", [(1, 2)])],
        "o",
    )
    places = [
        (float(x), float(y))
        for x, y in re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="3.5"', shown.svg())
    ]
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = places
    assert x2 - x1 == pytest.approx(2 * (x1 - x0), abs=0.2) and x3 == x0
    assert y0 - y1 == pytest.approx(y1 - y2, abs=0.2) and y0 - y3 == pytest.approx(0.2 * (y0 - y2), abs=0.2)
    words = [text for text, _ in shown.texts]
    assert {"1", "10", "100", "1,000", "0", "x", "y", "one", "two", "o"} <= {*words}
    assert faults(shown) == []


def test_bars_are_as_long_as_their_numbers():
    shown = bars("t", "ms", [("first", [("a", 2.0, ""), ("b", 1.0, "half")]), ("", [("c", 0.5, "")])], "o")
    lengths = [float(wide) for wide in re.findall(r'width="([\d.]+)" height="15"', shown.svg())]
    assert lengths == pytest.approx([lengths[0], lengths[0] / 2, lengths[0] / 4], abs=0.1)
    assert {"2 ms", "1 ms, half", "0.5 ms"} <= {text for text, _ in shown.texts}


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (1e5, "100,000"), (1234.5, "1,230"), (0.2641, "0.264"), (1e-4, "1e-4"), (8.0, "8")],
)
def test_numbers_of_charts_have_three_digits(value, text):
    assert number(value) == text


def test_measured_figures_are_of_records_and_say_so():
    assert measured.FIGURES.keys() == measured.RECORDS.keys()
    for name, draw in measured.FIGURES.items():
        record = measured.path_of(name)
        (origin,) = [text for text, _ in draw().texts if record.name in text]
        assert json.loads(record.read_text("utf-8"))["device"]["name"].startswith(
            origin.partition(",")[0].partition(";")[0]
        )


def test_what_the_titles_of_measured_figures_claim_is_so():
    """A record that is made again may contradict its title."""

    def record(name):
        return json.loads(measured.path_of(name).read_text("utf-8"))

    points = {one["name"]: one for one in record("ch01-presets")["points"]}
    assert 1.3 < points["msaa=4"]["gpu_ms"] / points["medium"]["gpu_ms"] < 1.75
    assert 0.6 < points["msaa=4"]["error"]["flip"] / points["medium"]["error"]["flip"] < 0.75
    (scale,) = [one for one in record("ch02-draws")["scales"] if one["name"] == "draws"]
    many = [one["python_ms"] for one in scale["points"] if one["side"] == "all features"]
    assert max(many) < 1.25 * min(many)
    assert record("ch02-pipelines")["pipelines"]["states"]["disk"]["times_faster"] > 2
    times = [
        one["record_ms"] for one in record("ch03-threads")["threads"]["points"] if one["draws"] == 10_000
    ]
    assert times == sorted(times)
    for one in record("ch03-loads")["loads"]:
        assert one["ways"]["cached"]["load_s"] < 0.6 * one["ways"]["plain"]["load_s"]
    for count in (5, 50):
        ways = {
            one["way"]: one["own_us"]
            for one in record("ch04-graph-costs")["graph"]["frames"]
            if one["passes"] == count
        }
        assert ways["sent again"] < ways["sent again, camera moves"] < ways["recorded anew"]
    forward = {
        (one["layers"], one["prepass"]): one["gpu_ms"]
        for one in record("ch04-prepass")["prepass"]["points"]
        if one["path"] == "forward"
    }
    assert forward[1, True] > forward[1, False] and forward[2, True] < 0.6 * forward[2, False]
    steps = {
        (one["kind"], one["substeps"], one["iterations"]): one
        for one in record("ch05-small-steps")["cloth"]["points"]
    }
    assert steps["XPBD, substeps", 8, 1]["rms_m"] < 0.5 * steps["XPBD, iterations", 1, 16]["rms_m"]
    ways = {
        (one["execution"], one["particles"]): one["gpu_ms"]
        for one in record("ch05-executions")["cloth"]["executions"]["points"]
    }
    assert ways["group", 256] < ways["dispatch", 256] and ways["dispatch", 65536] < ways["group", 65536]
    ends = {
        (one["name"], one["precision"], one["h_omega"]): one["energy_last"]
        for one in record("ch05-energy")["drift"]["points"]
    }
    assert (
        ends["XPBD", "float32", 0.2] < 0.5
        and ends["XPBD", "float32", 0.02] > 1.2
        and ends["XPBD", "float64", 0.02] < 1
    )
    for one in record("ch05-overlap")["async"]["scenes"]:
        assert one["on"]["frame_ms"] < one["off"]["frame_ms"]


def test_every_chapter_has_figures():
    for module in (ch01, ch02, ch03, ch04, ch05, ch06, ch07):
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
    assert (
        page.count('class="strata-figure"') == len([name for name in figures() if name.startswith("ch01")])
        and "glossary.md#" not in page
    )
