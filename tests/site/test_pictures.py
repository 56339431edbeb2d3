"""The pictures of the repository: small, all known, and none older than what it is made from."""

from __future__ import annotations

import pytest

from common.images.small_pictures import MOST_BYTES, encode_small
from common.paths import ROOT
from tools.site import inputs, pairs, site

ALL_BYTES = 15_000_000
FILES = sorted(
    path for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".jpg", ".webp", ".gif", ".svg")
)


def test_each_picture_is_small_and_so_are_all_together() -> None:
    assert len(FILES) > 40
    assert {path.name: path.stat().st_size for path in FILES if path.stat().st_size > MOST_BYTES} == {}
    assert sum(path.stat().st_size for path in FILES) <= ALL_BYTES


@pytest.mark.feature("tools/site")
def test_every_picture_is_made_by_the_one_command() -> None:
    wanted = site.pictures_program().wanted()
    assert {path.relative_to(ROOT).as_posix() for path in FILES} - {*wanted} == set()


@pytest.mark.feature("tools/site")
def test_no_picture_is_out_of_date() -> None:
    assert site.stale_pictures() == {}, "`python docs/pictures.py --stale` makes them anew"


def test_records_of_pairs_are_those_of_the_chapters_pairs() -> None:
    import chapters

    wanted = {pair.name for number in chapters.available() for pair in pairs.pairs_of(number)}
    assert wanted <= {*pairs.read()}


# --- how a hash tells -------------------------------------------------------------------------------------------------

CODE = """QQQA module.QQQ

# Arrays.
import numpy as np


def twice(x: float) -> float:
    QQQReturn 2 x.QQQ
    text = QQQ
#define NO_COMMENT
QQQ
    # why
    return 2 * x
""".replace("QQQ", '"""')


def test_comments_and_docstrings_change_no_hash() -> None:
    other = (
        CODE.replace("Return 2 x.", "Return the double.\n\n    In two lines.")
        .replace("# why", "#")
        .replace("\n\n\n", "\n")
    )
    assert inputs.code_of(other) == inputs.code_of(CODE)
    assert "#define NO_COMMENT" in inputs.code_of(CODE) and "why" not in inputs.code_of(CODE)


@pytest.mark.parametrize(
    "change", [("2 * x", "3 * x"), ("#define NO", "#define A_NO"), ("text =", "words =")]
)
def test_code_changes_it(change: tuple[str, str]) -> None:
    assert inputs.code_of(CODE.replace(*change)) != inputs.code_of(CODE)


def test_each_way_of_being_out_of_date_is_told(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(inputs, "ROOT", tmp_path)
    picture = tmp_path / "a.png"
    assert inputs.stale({"a.png": "1"}, {}) == {"a.png": "is missing"}
    picture.write_bytes(b"one")
    assert inputs.stale({"a.png": "1"}, {}) == {"a.png": "is in no record"}
    known = {"a.png": inputs.entry(picture, "1", {})}
    assert inputs.stale({"a.png": "1"}, known) == {}
    assert inputs.stale({"a.png": "2"}, known) == {"a.png": "is older than what it is made from"}
    picture.write_bytes(b"two")
    assert inputs.stale({"a.png": "1"}, known) == {"a.png": "is not the file that was made"}


def test_a_shader_s_comment_changes_nothing_and_its_code_does(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(inputs, "ROOT", tmp_path)
    texts = {
        "a": "void main() { x = 1.0; } // one",
        "b": "/* two\n*/ void main()\n{ x = 1.0; }",
        "c": "void main() { x = 2.0; }",
    }
    found = {}
    for name, text in texts.items():
        path = tmp_path / name / "s.frag"
        path.parent.mkdir()
        path.write_text(text, "utf-8")
        found[name] = inputs._content(path)
    assert found["a"] == found["b"] != found["c"]


NOT_TWICE = {"ch05-fragment-order.png"}
"""Pictures of the order in which fragments ran: a driver with threads draws another one each time."""


@pytest.mark.long
def test_drawn_anew_every_picture_is_the_same(tmp_path) -> None:
    """On the driver of the records: pictures are equal to the byte, so common/ and backends/ have changed none."""
    from backends.vulkan.instance import Instance

    with Instance() as instance:
        name = next(device for device in instance.devices() if device.unfit() is None).name
    if not all(record["device"].startswith(name) for record in pairs.read().values()):
        pytest.skip("the pictures were drawn by another device")
    program = site.pictures_program()
    changed = []
    for made_name, made in program.everything().items():
        if made_name.startswith(("pairs/", "plots/")):
            continue
        made.make(tmp_path)
        compared = [path for path in made.inputs if path.name not in NOT_TWICE]
        changed += [p.name for p in compared if (tmp_path / p.name).read_bytes() != p.read_bytes()]
    for pair in pairs.pairs_of(1):
        pictures, _ = pairs.draw(pair)
        changed += [p.name for p, pixels in pictures.items() if encode_small(pixels) != p.read_bytes()]
    assert changed == []
