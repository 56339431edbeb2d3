"""A compiled graph as text, JSON and drawing: what they say is what was compiled."""

from __future__ import annotations

import colorsys
import json
import random
import re
import sys
from itertools import combinations, pairwise
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from backends.contract import Access
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.types import External, Node, Touch
from tools.frames.report import record, rows, sharing, text
from tools.frames.svg import net, schemes, svg

SIZE = (64, 32)  # 2 KiB of depth or of rgba8, 4 KiB of rgba16f
SVG = "{http://www.w3.org/2000/svg}"


def nodes() -> list[Node]:
    """A small deferred frame: three transients that overlap in part, one that goes on, one pass that is left out."""
    return [
        Node("depths", (), (Access("depth", "depth", "d32f", clear=(0.0,)),)),
        Node("surface", (Access("depth", "depth"),), (Access("albedo", "color", "rgba16f"),)),
        Node("light", (Access("albedo", "sampled"),), (Access("lit", "color", "rgba16f", clear=(0, 0, 0, 1)),)),
        Node("glass", (Access("depth", "depth"),), (Access("hdr", "color", of="lit"),)),
        Node("bloom", (Access("hdr", "sampled"),), (Access("glow", "color", "rgba16f", instead="hdr"),), "no light"),
        Node("shrink", (Access("glow", "sampled"),), (Access("small", "storage", "rgba8"),)),
        Node("tonemap", (Access("small", "sampled"),), (Access("color", "color", "rgba8"),)),
    ]  # fmt: skip


def chain(count: int, name: str = "pass") -> list[Node]:
    """Passes of which each reads what one to three of the six before it wrote, in sizes of three kinds."""
    chance = random.Random(count)
    made = []
    for i in range(count):
        before = (
            sorted({chance.randrange(max(0, i - 6), i) for _ in range(chance.randint(1, 3))}) if i else []
        )
        reads = tuple(Access(f"r{j}", "sampled") for j in before)
        scale = chance.choice([1.0, 0.5, 0.25])
        made.append(Node(f"{name}_{i}", reads, (Access(f"r{i}", "color", "rgba16f", scale=scale),)))
    return made


@pytest.fixture
def graph():
    return compile_graph(nodes(), SIZE, ("color",))


def part(lines: list[str], begin: str) -> list[str]:
    """Return the lines from the one that begins so to the next empty one."""
    start = next(i for i, line in enumerate(lines) if line.startswith(begin))
    end = next((i for i in range(start, len(lines)) if not lines[i]), len(lines))
    return lines[start:end]


def test_the_text_goes_through_the_frame_from_top_to_bottom(graph):
    lines = text(graph).splitlines()
    assert lines[0].startswith("6 passes at 64x32, 5 resources, ")
    assert lines[1] == "output color: color"
    heads = [line for line in lines if re.match(r" *\d+ \w+ \(", line)]
    assert heads == [
        " 1 depths (graphics, 64x32)",
        " 2 surface (graphics, 64x32)",
        " 3 light (graphics, 64x32)",
        " 4 glass (graphics, 64x32)",
        " 5 shrink (compute, 64x32)",
        " 6 tonemap (graphics, 64x32)",
    ]
    whole = "\n".join(lines)
    for line in (
        "waits    albedo: fragment shaders read what colour targets wrote, layout color -> read",
        "waits    lit: colour targets write on what colour targets wrote",
        "waits    lit: compute shaders read what colour targets wrote, layout color -> read",
        "small: compute shaders write where albedo lay, when fragment shaders are done, layout anything -> general",
        "draws to lit (rgba16f): cleared to 0 0 0 1, stored",
        "draws to lit (rgba16f): goes on, stored",
        "depth (d32f): goes on, tested only",
        "writes   small",
    ):
        assert line in whole, line


def test_the_text_says_who_is_left_out_and_what_his_readers_get(graph):
    assert part(text(graph).splitlines(), "left out") == [
        "left out",
        "   bloom  no light",
        "   who reads glow gets lit instead",
    ]
    asked = compile_graph(nodes()[:2], SIZE, ("albedo",))
    assert "left out" not in text(asked)
    nobody = compile_graph(
        [*nodes()[:2], Node("x", (), (Access("y", "color", "rgba8"),), "off")], SIZE, ("albedo", "y")
    )
    assert "output y: nobody writes it in this frame" in text(nobody)


def test_bars_show_who_writes_and_reads_when(graph):
    assert part(text(graph).splitlines(), "lifetimes") == [
        "lifetimes: W writes, R reads, X goes on, - alive",
        "           123456",
        "   depth   WR-R..  transient d32f, 64x32, 8.0 KiB",
        "   albedo  .WR...  transient rgba16f, 64x32, 16.0 KiB",
        "   lit     ..WXR.  transient rgba16f, 64x32, 16.0 KiB, then hdr",
        "   small   ....WR  transient rgba8, 64x32, 8.0 KiB",
        "   color   .....W  kept rgba8, 64x32, 8.0 KiB",
    ]


def test_numbers_of_two_digits_stand_above_their_steps():
    passes = [
        Node(
            f"p{n}",
            (Access(f"i{n - 1}", "sampled"),) if n else (),
            (Access(f"i{n}", "color", "rgba8", clear=(0, 0, 0, 1)),),
        )
        for n in range(12)
    ]
    lines = part(text(compile_graph(passes, SIZE, ("i11",))).splitlines(), "lifetimes")
    assert [line.strip() for line in lines[1:3]] == ["111", "123456789012"]
    assert lines[1].rindex("111") + 3 == lines[2].rindex("123456789012") + 12


def test_the_text_says_whose_memory_is_whose(graph):
    # 8 + 16 + 16 KiB are alive in step 3; what comes last finds room in what was let go.
    assert part(text(graph).splitlines(), "memory") == [
        "memory of transients: 40.0 KiB in 1 heap; each on its own 48.0 KiB, 17 % less; "
        "no arrangement is below 40.0 KiB",
        "   heap 1, 40.0 KiB",
        "          0  albedo   16.0 KiB, steps 2 to 3, shared with small",
        "          0  small     8.0 KiB, steps 5 to 6, shared with albedo",
        "     16,384  lit      16.0 KiB, steps 3 to 5",
        "     32,768  depth     8.0 KiB, steps 1 to 4",
    ]
    figures = graph.counts()
    assert (figures["transient_bytes"], figures["transient_bytes_alone"]) == (40 * 1024, 48 * 1024)
    assert (figures["passes"], figures["passes_skipped"]) == (6, 1)
    # One for each of the five resources' first writing; reading depth, albedo, lit and small; and going on with lit.
    assert (figures["barriers"], figures["transitions"]) == (10, 9)


def test_sharing_is_told_as_the_places_overlap():
    sums = [
        Node(f"sum_{i}", (Access(f"r{i}", "sampled"),), (Access(f"s{i}", "storage", bytes=4096),))
        for i in (3, 9)
    ]
    last = Node(
        "all", (Access("s3", "storage"), Access("s9", "storage")), (Access("all", "storage", bytes=4),)
    )
    graph = compile_graph([*chain(40), *sums, last], SIZE, ("r39", "all"))
    memory = graph.memory
    assert len(memory.heaps) == 2  # images and buffers
    bytes_of = {
        name: {(place.heap, byte) for byte in range(place.offset, place.offset + place.size, 256)}
        for name, place in memory.places.items()
    }
    for a, b in combinations(memory.places, 2):
        assert (b in sharing(graph, a)) == (a in sharing(graph, b)) == bool(bytes_of[a] & bytes_of[b])
    longest = max(len(line) for line in text(graph).splitlines() if "shared with" in line)
    assert longest < 100  # however many share


def test_what_lasts_is_alive_all_the_time():
    outside = Touch("copy_source", frozenset({"copy"}), frozenset({"copy_read"}))
    graph = compile_graph(
        [
            Node("first", (), (Access("a", "color", "rgba8"),)),
            Node(
                "blend",
                (Access("a", "sampled"), Access("h", "sampled", previous=True)),
                (Access("h", "color", "rgba8"),),
            ),
            Node("show", (Access("h", "sampled"), Access("map", "sampled")), (Access("color", "color", "rgba8"),)),
            Node("sum", (Access("h", "sampled"),), (Access("sums", "storage", bytes=4096),)),
        ],
        SIZE,
        ("color", "sums"),
        {"map": External("rgba8", (4, 4), outside, outside)},
    )  # fmt: skip
    found = {row.name: ("".join(row.signs.values()), row.first, row.last) for row in rows(graph)}
    last = len(graph.steps) - 1
    assert found["h"][1:] == found["h@previous"][1:] == found["map"][1:] == (0, last)
    assert found["h@previous"][0] == "R" and found["map"][0] == "R"
    lines = text(graph).splitlines()
    assert part(lines, "once, before the first frame")[1].startswith("     starts   h@previous: ")
    assert any(line.startswith("     leaves   map: copies read what fragment shaders read") for line in lines)
    assert any(line.startswith("   sums ") and line.endswith("kept buffer, 4.0 KiB") for line in lines)


def test_json_has_everything_and_is_always_the_same(graph):
    made = record(graph)
    again = json.dumps(record(compile_graph(nodes()[::-1], SIZE, ("color",))))
    assert json.dumps(made) == again
    read = json.loads(again)
    assert read.keys() >= {  # a later chapter has more
        *("version", "counts", "steps", "resources", "names", "edges", "left_out", "memory"),
        *("prologue", "epilogue", "missing", "size", "outputs"),
    }
    assert read["version"] == 1 and read["counts"]["barriers"] == graph.counts()["barriers"]
    assert [step["name"] for step in read["steps"]] == [step.name for step in graph.steps]
    light = read["steps"][2]
    assert light["colors"] == [{"resource": "lit", "load": "clear", "store": "store", "clear": [0, 0, 0, 1]}]
    waits = {one["resource"]: one for one in light["barriers"]}
    assert waits["albedo"]["before"] == {
        "layout": "color",
        "stages": ["color"],
        "access": ["color_write"],
        "writes": True,
    }
    assert read["memory"]["lives"]["lit"] == [2, 4] and read["left_out"] == {"bloom": "no light"}
    assert read["resources"]["lit"]["uses"] == sorted(graph.resources["lit"].uses)


# --- the drawing ------------------------------------------------------------------------------------------------------


def drawn(graph, title: str = "") -> ElementTree.Element:
    return ElementTree.fromstring(svg(graph, title))


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(element.get(name, "nan")) for name in names]


def titled(root: ElementTree.Element, tag: str) -> dict[str, ElementTree.Element]:
    """Return the elements of a kind by the title that is in them or beside them."""
    found = {}
    for parent in root.iter():
        for one in parent.findall(f"{SVG}{tag}"):
            title = (
                one.find(f"{SVG}title") if one.find(f"{SVG}title") is not None else parent.find(f"{SVG}title")
            )
            if title is not None:
                found[title.text or ""] = one
    return found


@pytest.mark.parametrize("count", [1, 2, 6, 50])
def test_bars_and_boxes_stand_where_the_passes_are(count):
    graph = compile_graph(chain(count), SIZE, (f"r{count - 1}",))
    root = drawn(graph)
    circles = [numbers(one, "cx", "r") for one in root.iter(f"{SVG}circle")]
    assert len(circles) == len(graph.steps)
    middle = [x for x, _ in circles]
    assert all(b - a >= 2 * r for (a, r), (b, _) in pairwise(circles))  # side by side

    boxes = titled(root, "rect")
    for row in rows(graph):
        x, width = numbers(
            next(box for about, box in boxes.items() if about.startswith(f"{row.name}: {row.resource.life}")),
            "x",
            "width",
        )
        covered = [number for number, place in enumerate(middle) if x < place < x + width]
        assert covered == list(range(row.first, row.last + 1)), row.name
    heap = {
        name: numbers(
            next(box for about, box in boxes.items() if about.startswith(f"{name}: ") and " at " in about),
            "x",
            "y",
            "width",
            "height",
        )
        for name in graph.memory.places
    }
    for (x, y, width, height), (u, v, wide, high) in combinations(heap.values(), 2):
        across = min(x + width, u + wide) - max(x, u)
        down = min(y + height, v + high) - max(y, v)
        assert across <= 1e-6 or down <= 0.2, "two boxes of one heap overlap"  # numbers have one decimal
    pairs = {(edge.before, edge.after) for edge in graph.edges}
    assert sum(one.tag == f"{SVG}path" for one in root.iter()) == len(pairs)


def check_inside(root: ElementTree.Element) -> None:
    """Assert that no text leaves the drawing, if a character is 0.6 of its height wide."""
    width, height = numbers(root, "width", "height")
    for one in root.iter(f"{SVG}text"):
        x, y, size = numbers(one, "x", "y", "font-size")
        length = len(one.text or "") * 0.6 * size
        x -= {"end": length, "middle": length / 2}.get(one.get("text-anchor", ""), 0)
        if one.get("transform"):
            length, high = length * 0.71, length * 0.71
            assert y - high >= 0
        assert x >= 0 and x + length <= width and 0 < y < height, one.text


def test_long_names_of_passes_are_inside_the_drawing_where_nothing_else_is_as_wide():
    outside = Touch("read", frozenset({"fragment"}), frozenset({"sampled"}))
    readers = [Node(f"{'long_' * 12}{i}", (Access("map", "sampled"),)) for i in range(24)]
    check_inside(drawn(compile_graph(readers, SIZE, (), {"map": External("rgba8", (4, 4), outside)})))


@pytest.mark.parametrize(
    "name", ["pass", "a_pass_whose_name_is_as_long_as_a_name_of_a_file_may_be_and_more", "<&\"'\x00\u001b>"]
)
def test_everything_is_inside_the_drawing_whatever_the_names(name):
    graph = compile_graph([*chain(7, name), Node(f"{name}!", why_not="<off>")], SIZE, ("r6",))
    root = drawn(graph, f"{name} & more")
    check_inside(root)
    shown = {one.text for one in root.iter(f"{SVG}text")}
    clean = name.replace("\x00", "\ufffd").replace("\x1b", "\ufffd") + "_0"
    assert (clean if len(clean) <= 40 else clean[:39] + "…") in shown
    assert any(
        clean in (one.text or "") for one in root.iter(f"{SVG}title")
    )  # the whole name, under the pointer


def fake_graphviz(monkeypatch, drawing) -> SimpleNamespace:
    calls = SimpleNamespace(nodes=[], edges=[])

    class Missing(RuntimeError):
        pass

    class Digraph:
        def __init__(self, **attributes):
            pass

        def node(self, name, label):
            calls.nodes.append((name, label))

        def edge(self, before, after, label, style):
            calls.edges.append((before, after, label, style))

        def pipe(self, kind, encoding):
            if drawing is None:
                raise Missing
            return drawing

    module = SimpleNamespace(
        Digraph=Digraph,
        escape=str,
        ExecutableNotFound=Missing,
        CalledProcessError=type("Failed", (Exception,), {}),
    )
    monkeypatch.setitem(sys.modules, "graphviz", module)
    return calls


def test_graphviz_draws_the_net_where_it_is_installed(graph, monkeypatch):
    head = '<?xml version="1.0"?>\n<!DOCTYPE svg PUBLIC "x" "y">\n'
    theirs = f'{head}<svg width="300pt" height="60pt" xmlns="{SVG[1:-1]}"><g id="net"/></svg>\n'
    calls = fake_graphviz(monkeypatch, theirs)
    root = drawn(graph)
    assert root.find(f".//{SVG}g[@id='net']") is not None
    assert [name for name, _ in calls.nodes] == [step.name for step in graph.steps]
    assert ("glass", "shrink", "hdr", "solid") in calls.edges and len(calls.edges) == len(graph.edges)


@pytest.mark.parametrize("there", ["package", "nothing"])
def test_without_graphviz_the_drawing_has_its_arcs_alone(graph, monkeypatch, there):
    if there == "package":
        fake_graphviz(monkeypatch, None)
    else:
        monkeypatch.setitem(sys.modules, "graphviz", None)
    assert net(graph) is None
    assert drawn(graph).find(f".//{SVG}path") is not None


def luminance(color: str) -> float:
    """Return the relative luminance (WCAG 2.2) of "#rrggbb", "hsl(h s% l%)", "black" or "white"."""
    found = re.fullmatch(r"hsl\((\d+) (\d+)% (\d+)%\)", color)
    if found:
        hue, saturation, light = (int(part) for part in found.groups())
        codes = list(colorsys.hls_to_rgb(hue / 360, light / 100, saturation / 100))
    else:
        text = {"black": "#000000", "white": "#ffffff"}.get(color, color)
        codes = [int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in codes]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_every_colour_of_a_drawing_has_one_for_dark_pages(graph):
    """And letters have the contrast of WCAG 2.2, 4.5, on all that they stand on, whatever hue a resource has."""
    root = drawn(graph)
    used = {one.get(part) for one in root.iter() for part in ("fill", "stroke")} - {None, "none"}
    style = root.findtext(f"{SVG}style") or ""
    for light in used:
        assert f'.strata-graph [fill="{light}"]' in style and f'.strata-graph [stroke="{light}"]' in style, (
            light
        )
    hues = [f"hsl({hue} 65% 78%)" for hue in range(0, 360, 5)]
    rules = schemes(hues)
    (values,) = re.findall(r"data-md-color-scheme=slate\] \.strata-graph\{(.*?)\}", rules)
    dark = dict(re.findall(r"--g(\d+):([^;]+);", values))
    of = {
        light: dark[number]
        for light, number in re.findall(r'\[fill="([^"]+)"\]\{fill:var\(--g(\d+)\)\}', rules)
    }
    ink, paper, pale = "#18181b", "white", "#71717a"
    for light in (*hues, paper, "#f4f4f5", "#e4e4e7", "#fde68a", "#bae6fd"):
        assert contrast(ink, light) >= 4.5 and contrast(of[ink], of[light]) >= 4.5, light
    assert contrast(pale, paper) >= 4.5 and contrast(of[pale], of[paper]) >= 4.5


def test_without_styles_a_drawing_has_the_colours_of_a_light_page(graph):
    """Programs that know no variables of CSS read the attributes."""
    root = drawn(graph)
    assert all("var(" not in (one.get(part) or "") for one in root.iter() for part in ("fill", "stroke"))
    assert next(root.iter(f"{SVG}rect")).get("fill") == "white"
    assert all(one.get("fill") for one in root.iter(f"{SVG}text"))
