"""Graphs as files: what they become, and one sentence with file, line and field for whatever is wrong."""

from __future__ import annotations

import json
import random
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from backends.contract import Access
from chapters.ch04.graph.file import GRAPHS, MAX_BYTES, graph_path, read_graph
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.json_places import JsonError, line_and_column, parse
from chapters.ch04.graph.types import GraphError, Node

FORMATS = ("rgba8", "rgba16f", "r32ui", "d32f")
OUTPUTS = ("color", "color_linear", "depth")


@dataclass
class Declared:
    name: str
    reads: tuple[Access, ...] = ()
    writes: tuple[Access, ...] = ()
    why_not: str = ""
    queue: str = "graphics"


def passes(**why_not: str) -> dict[str, Declared]:
    made = (
        Declared("gbuffer", (), (Access("base", "color", "rgba8"), Access("depth", "depth", "d32f"))),
        Declared(
            "lighting", (Access("base", "sampled"), Access("depth", "depth")), (Access("lit", "color"),)
        ),
        Declared("glass", (Access("depth", "depth"),), (Access("hdr", "color", of="lit"),)),
        Declared(
            "blur",
            (Access("hdr", "sampled"), Access("soft", "sampled", previous=True)),
            (Access("soft", "color", "rgba16f", scale=0.5, instead="hdr"),),
        ),
        Declared("count", (Access("hdr", "sampled"),), (Access("sums", "storage", bytes=64),)),
        Declared("tonemap", (Access("hdr", "sampled"),), (Access("color", "color", "rgba8"),)),
    )
    for one in made:
        one.why_not = why_not.get(one.name, "")
    return {one.name: one for one in made}


GOLDEN = """{
  "title": "Two pictures: one of blurred light, one of light",
  "passes": [
    {"pass": "gbuffer", "size": {"base": [320, 200], "depth": [320, 200]}},
    {"pass": "lighting", "format": {"lit": "rgba16f"}, "scale": {"lit": 0.25}},
    {"pass": "glass"},
    {"pass": "blur", "reads": {"hdr": "lit"}, "writes": {"soft": "mist"}},
    {"pass": "tonemap", "reads": {"hdr": "mist"}},
    {"pass": "tonemap", "name": "plain",
     "writes": {"color": "second"}, "enabled": false}
  ],
  "outputs": {"color_linear": "mist"}
}
"""


def written(folder: Path, text: str | bytes, name: str = "g.json") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def nodes(path: Path, **why_not: str) -> list[Node]:
    return read_graph(path).nodes(passes(**why_not), FORMATS, externals=("shadow",), outputs=OUTPUTS)


@pytest.mark.feature("frame-graph/json-parser")
def test_a_file_becomes_the_nodes_that_it_says(tmp_path):
    path = written(tmp_path, GOLDEN)
    size = (320, 200)
    assert nodes(path) == [
        Node(
            "gbuffer",
            (),
            (Access("base", "color", "rgba8", size=size), Access("depth", "depth", "d32f", size=size)),
        ),
        Node(
            "lighting",
            (Access("base", "sampled"), Access("depth", "depth")),
            (Access("lit", "color", "rgba16f", scale=0.25),),
        ),
        Node("glass", (Access("depth", "depth"),), (Access("hdr", "color", of="lit"),)),
        Node(
            "blur",  # its own past follows what it writes; what stands in for it follows what it reads
            (Access("lit", "sampled"), Access("mist", "sampled", previous=True)),
            (Access("mist", "color", "rgba16f", scale=0.5, instead="lit"),),
        ),
        Node("tonemap", (Access("mist", "sampled"),), (Access("color", "color", "rgba8"),)),
        Node(
            "plain",
            (Access("hdr", "sampled"),),
            (Access("second", "color", "rgba8"),),
            f"switched off in {path}:10",
        ),
    ]
    graph = read_graph(path)
    assert graph.title == "Two pictures: one of blurred light, one of light"
    assert graph.outputs == {"color_linear": "mist"}
    assert graph.passes["plain"] == "tonemap" and graph.passes["blur"] == "blur"
    assert graph.where("plain") == f"{path}:9"


@pytest.mark.feature("frame-graph/json-parser")
def test_the_resources_behind_a_file_have_its_sizes_and_formats(tmp_path):
    text = """{"passes": [{"pass": "gbuffer"}, {"pass": "glass"}, {"pass": "tonemap"},
        {"pass": "lighting", "format": {"lit": "rgba16f"}}]}"""
    graph = compile_graph(nodes(written(tmp_path, text)), (64, 48), ("color",))
    found = {one.name: (one.names, one.format, one.size) for one in graph.resources.values()}
    assert found == {
        "base": (("base",), "rgba8", (64, 48)),
        "depth": (("depth",), "d32f", (64, 48)),
        "lit": (("lit", "hdr"), "rgba16f", (64, 48)),
        "color": (("color",), "rgba8", (64, 48)),
    }


LIT = '{"pass": "gbuffer"}, {"pass": "lighting", "format": {"lit": "rgba16f"}}, {"pass": "glass"}'
"""The passes that others read from, on one line; what is wrong stands in line 2."""

WRONG = {
    # what is behind the good passes, or the whole text where it begins with "=": column, and what the sentence says
    '{"pass": "tonemp"}': (10, "passes[3].pass is 'tonemp', and there is no such pass; did you mean 'tonemap'?"),
    '{"pass": 3}': (10, "passes[3].pass must be a text, and is a number."),
    '{"pass": ""}': (10, "passes[3].pass is '': a name has"),
    '{"pass": "../up"}': (10, "passes[3].pass is '../up': a name has"),
    "3": (1, "passes[3] must be an object, {...}, and is a number."),
    "{}": (1, 'passes[3] has no "pass"'),
    '{"pass": "tonemap", "redas": {}}': (21, "passes[3].redas is no key of this; did you mean 'reads'?"),
    '{"pass": "tonemap", "enabled": 0}': (32, "passes[3].enabled must be true or false, and is a number."),
    '{"pass": "glass"}': (1, "passes[3] is a second 'glass', after that of line 1:"),
    '{"pass": "lighting", "name": "other"}': (1, "passes[3] ('other') leaves the format of 'lit' open:"),
    '{"pass": "gbuffer", "name": "other"}': (1, "passes[3] writes 'base', as 'gbuffer' in line 1 does:"),
    '{"pass": "tonemap", "writes": {"color": "lit"}}': (
        41,
        "passes[3].writes.color writes 'lit', as 'lighting' in line 1 does:",
    ),
    '{"pass": "tonemap", "reads": {"hdr": "hdx"}}': (
        38,
        "passes[3].reads.hdr is 'hdx', which no pass here writes; did you mean 'hdr'?",
    ),
    '{"pass": "tonemap", "reads": {"hd": "lit"}}': (31, "passes[3].reads.hd reads nothing that 'tonemap' declares"),
    '{"pass": "tonemap", "reads": ["hdr"]}': (30, "passes[3].reads must be an object, {...}, and is a list."),
    '{"pass": "tonemap", "format": {"hdr": "rgba8"}}': (32, "passes[3].format.hdr is nothing that 'tonemap' writes"),
    '{"pass": "tonemap", "format": {"color": "rgba8"}}': (
        41,
        "passes[3].format.color repeats what 'tonemap' declares, 'rgba8': leave it out.",
    ),
    '{"pass": "lighting", "name": "b", "format": {"lit": "rgb16f"}}': (
        53,
        "passes[3].format.lit is 'rgb16f', which is no format; did you mean 'rgba16f'?",
    ),
    '{"pass": "lighting", "name": "b", "format": {"lit": "d32f"}}': (
        53,
        "passes[3].format.lit is 'd32f', and 'lighting' writes colour there.",
    ),
    '{"pass": "glass", "name": "b", "format": {"hdr": "rgba8"}}': (
        50,
        "passes[3].format.hdr is that of 'lit', which it continues",
    ),
    '{"pass": "blur", "scale": {"soft": 0.25}}': (36, "passes[3].scale.soft repeats what 'blur' declares, 0.5"),
    '{"pass": "count", "scale": {"sums": 2}}': (37, "passes[3].scale.sums sets the scale of a buffer"),
    '{"pass": "tonemap", "scale": {"color": 0}}': (40, "passes[3].scale.color is 0: a scale is above 0 and at most 8."),
    '{"pass": "tonemap", "scale": {"color": -1}}': (40, "passes[3].scale.color is -1:"),
    '{"pass": "tonemap", "scale": {"color": 1e999}}': (40, "passes[3].scale.color is inf:"),
    '{"pass": "tonemap", "scale": {"color": true}}': (40, "passes[3].scale.color must be a number, and is true or f"),
    '{"pass": "tonemap", "size": {"color": [0, 8]}}': (
        40,
        "passes[3].size.color[0] is 0: a side is a whole number of pixels, 1 to 16384.",
    ),
    '{"pass": "tonemap", "size": {"color": [8, -8]}}': (43, "passes[3].size.color[1] is -8:"),
    '{"pass": "tonemap", "size": {"color": [8, 8.5]}}': (43, "passes[3].size.color[1] is 8.5:"),
    '{"pass": "tonemap", "size": {"color": [8, 16385]}}': (43, "passes[3].size.color[1] is 16385:"),
    '{"pass": "tonemap", "size": {"color": [8]}}': (39, "passes[3].size.color must be [width, height], and has 1"),
    '{"pass": "tonemap", "size": {"color": "8x8"}}': (39, "passes[3].size.color must be a list, [...], and is a text."),
    '{"pass": "tonemap", "size": {"color": [8, 8]}, "scale": {"color": 1}}': (
        39,
        "passes[3].size.color says again what scale.color says",
    ),
    '{"pass": "tonemap", "pass": "glass"}': (21, "this is no JSON: the key 'pass' is here twice, first in line 2."),
    '{"pass": "tonemap",}': (19, "this is no JSON: the comma has nothing behind it but '}'."),
    '{"pass": "tonemap"} // the last one': (21, "this is no JSON: it has no comments."),
    "{'pass': 1}": (2, "this is no JSON: a key in double quotes is missing before \"'pass':\"."),
    '{"pass": tonemap}': (10, "this is no JSON: a value is missing before 'tonemap}'."),
    '{"pass" "tonemap"}': (9, "this is no JSON: ':' is missing before '\"tonemap\"}'."),
    '{"pass": NaN}': (10, "this is no JSON: NaN is no number in JSON."),
    '{"pass": "a\tb"}': (12, "this is no JSON: invalid control character in a text."),
    '{"pass": "\\ud800"}': (10, "this is no JSON: a text holds half a character"),
    '{"pass": ' + "9" * 5000 + "}": (10, "this is no JSON: a number has too many digits."),
    "[" * 40: (31, "this is no JSON: more than 32 lists and objects are inside one another."),
    '=\n[]': (1, "the graph must be an object, {...}, and is a list."),
    '=\n{"pases": []}': (2, "pases is no key of this; did you mean 'passes'?"),
    '=\n{"title": "x"}': (1, 'the graph has no "passes"'),
    '=\n{"passes": []}': (12, "passes is empty: a frame has at least one pass."),
    '=\n{"passes": {}}': (12, "passes must be a list, [...], and is an object."),
    '=\n{"passes": [], "title": null}': (12, "passes is empty"),
    '=\n': (1, "this is no JSON: a value is missing before the end of the file."),
    '=\n{"passes": [{"pass": "gbuffer"}': (32, "this is no JSON: ',' or ']' is missing before the end of the file."),
    '=\n{"passes": [{"pass": "gbuffer"}]} 1': (35, "this is no JSON: more follows where the file should end."),
    '=\n{"passes": [{"pass": "tonemap"}]}': (13, "passes[0] ('tonemap') reads 'hdr', which no pass here writes"),
    '=\n{"passes": [{"pass": "gbuffer"}, {"pass": "glass"}]}': (
        34,
        "passes[1] ('glass') continues 'lit', which no pass here writes",
    ),
    '=\n{"passes": [{"pass": "gbuffer"}], "outputs": {"colr": "base"}}': (47, "outputs.colr is no output of a frame"),
    '=\n{"passes": [{"pass": "gbuffer"}], "outputs": {"color": "bas"}}': (56, "outputs.color is 'bas', which no pass"),
}  # fmt: skip


@pytest.mark.feature("frame-graph/json-parser")
@pytest.mark.parametrize("wrong", WRONG, ids=lambda text: text[:48])
def test_whatever_is_wrong_is_one_sentence_with_file_line_column_and_field(tmp_path, wrong):
    column, says = WRONG[wrong]
    text = wrong[1:] if wrong.startswith("=") else f'{{"passes": [{LIT},\n{wrong}\n]}}'
    path = written(tmp_path, text)
    with pytest.raises(GraphError) as raised:
        nodes(path)
    sentence = str(raised.value)
    assert sentence.startswith(f"{path}:2:{column}: {says}"), sentence
    assert sentence.endswith((".", "?")) and "\n" not in sentence and len(sentence) < len(str(path)) + 200


def test_a_pass_that_the_frame_does_not_want_may_write_and_read_what_others_do_not(tmp_path):
    text = """{"passes": [{"pass": "gbuffer"}, {"pass": "gbuffer", "name": "other", "enabled": false},
        {"pass": "tonemap"}, {"pass": "blur", "reads": {"hdr": "shadow"}}]}"""
    found = nodes(written(tmp_path, text), tonemap="nobody looks")
    assert [node.why_not != "" for node in found] == [False, True, True, False]
    assert found[3].reads[0].resource == "shadow"  # it comes from outside


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xef\xbb\xbf" + GOLDEN.encode(), ""),
        (GOLDEN.replace("\n", "\r\n").encode(), ""),
        (b'{\n"title": "\xff"}', ":2: this is no text in UTF-8: save the file in that encoding."),
        (GOLDEN.encode("utf-16"), ":1: this is no text in UTF-8: save the file in that encoding."),
        (b" " * (MAX_BYTES + 1), " is no graph: it has more than 1,048,576 bytes."),
    ],
)
def test_files_of_other_encodings_and_sizes(tmp_path, content, says):
    path = written(tmp_path, content)
    if not says:
        assert len(nodes(path)) == 6 and read_graph(path).where("plain") == f"{path}:9"
        return
    with pytest.raises(GraphError) as raised:
        read_graph(path)
    assert str(raised.value) == f"{path}{says}"


def test_a_path_that_is_no_file_is_named(tmp_path):
    for path, says in {
        tmp_path
        / "none.json": f"There is no graph {tmp_path / 'none.json'}: name one of the chapter, or a .json file.",
        tmp_path: f"{tmp_path} is a folder, and a graph is a file: name a .json in it.",
        Path("a\0b"): "The graph 'a\\x00b' cannot be read: embedded null byte.",
        Path("x" * 5000): "The graph ",
    }.items():
        with pytest.raises(GraphError) as raised:
            read_graph(path)
        assert str(raised.value).startswith(says)


def test_a_graph_of_the_chapter_is_named_without_its_folder(tmp_path, monkeypatch):
    assert graph_path("deferred") == GRAPHS / "deferred.json"
    assert graph_path("own/deferred.json") == Path("own/deferred.json")
    with pytest.raises(GraphError, match=r"There is no graph 'defered'; did you mean 'deferred'\?"):
        graph_path("defered")
    monkeypatch.chdir(tmp_path)
    Path("forward").write_text("{}")
    assert graph_path("forward") == Path("forward")


def test_the_places_of_values_are_those_of_editors():
    text = '{\n  "a": [1,\n\t\t"ü", {"b": null}]\n}'
    whole = parse(text)
    a = whole.content["a"]
    assert line_and_column(text, a.key_at) == (2, 3) and line_and_column(text, a.at) == (2, 8)
    assert [line_and_column(text, value.at) for value in a.content] == [(2, 9), (3, 3), (3, 8)]
    inner = a.content[2].content["b"]
    assert line_and_column(text, inner.key_at) == (3, 9) and inner.kind == "null"


def plain(value):
    content = value.content
    if isinstance(content, dict):
        return {key: plain(one) for key, one in content.items()}
    return [plain(one) for one in content] if isinstance(content, tuple) else content


SEEDS = (GOLDEN, '{"a": [1, -2.5e3, true, false, null, "\\u00e9\\n\\\\"], "b": {"c": [[], {}]}, "": ""}')
TOKENS = (
    '"',
    "{",
    "}",
    "[",
    "]",
    ",",
    ":",
    "null",
    "-0",
    "1e9",
    "0.5",
    "true",
    "\\",
    "\n",
    "\ud800",
    "ü",
    "/*",
    "\0",
)


def mutants(seed: int, count: int):
    """Give texts that are nearly right: pieces lost, doubled, exchanged, or put in from elsewhere."""
    chance = random.Random(seed)
    words = re.findall(r'"\w*"', GOLDEN)
    for _ in range(count):
        text = chance.choice(SEEDS)
        for _ in range(chance.randint(1, 4)):
            a = chance.randrange(len(text) + 1)
            b = min(len(text), a + chance.choice([0, 0, 1, 1, 3, 12]))
            new = chance.choice(["", text[a:b] * 2, chance.choice(TOKENS), chance.choice(words)])
            text = text[:a] + new + text[b:]
        yield text


def said(work, kind: type[Exception]) -> tuple[object, str]:
    """Return what `work` returns, or the text of its exception; any other exception goes through."""
    try:
        return work(), ""
    except kind as error:
        return None, str(error)


def check_mutants(folder: Path, texts) -> tuple[int, int]:
    """Return how many texts were JSON and how many were graphs; whatever is neither is one sentence."""
    known, good, graphs = passes(), 0, 0
    for text in texts:
        theirs, refused = said(lambda text=text: json.loads(text), ValueError)
        ours, wrong = said(lambda text=text: plain(parse(text)), JsonError)
        stricter = "twice" in wrong or "half a character" in wrong or "no number" in wrong
        assert stricter or (bool(wrong) == bool(refused) and ours == theirs), (text, wrong, refused)
        good += not wrong

        path = written(folder, text.encode("utf-8", "surrogatepass"))
        made, wrong = said(
            lambda path=path: read_graph(path).nodes(known, FORMATS, outputs=OUTPUTS), GraphError
        )
        assert (made is None) == bool(re.fullmatch(re.escape(str(path)) + r":\d+(:\d+)?: .+[.?]", wrong)), (
            wrong
        )
        graphs += made is not None
    return good, graphs


def test_a_file_that_is_nearly_right_is_a_graph_or_one_sentence(tmp_path):
    good, graphs = check_mutants(tmp_path, mutants(1, 300))
    assert good > 30 and graphs > 5  # else the sample says nothing about the right ones


@pytest.mark.long
def test_ten_thousand_files_that_are_nearly_right(tmp_path):
    good, graphs = check_mutants(tmp_path, mutants(2, 10_000))
    assert good > 1000 and graphs > 200


@pytest.mark.parametrize("name", ["deferred", "forward"])
def test_a_graph_of_the_chapter_ends_in_a_picture(name):
    graph = read_graph(graph_path(name))
    assert graph.title and graph.uses[-1].name in ("tonemap", "fxaa")  # codes are what FXAA smooths
    assert len(graph.passes) == len(graph.uses) > 3
