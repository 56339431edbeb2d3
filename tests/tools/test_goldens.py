"""Goldens: compared with what their own driver made, shown when they differ, made anew when somebody says so."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from backends.contract import Capabilities
from common.images import read_image
from tests.support.goldens import Goldens, Maker, figures

HERE = Capabilities(
    "vulkan", "llvmpipe (LLVM 15.0.6, 256 bits)", "Mesa 25.0.7", (1, 4, 305), "software", frozenset()
)
CPU = "processor : 0\nflags\t\t: fpu sse4_1 avx avx2 fma lahf_lm\nbugs : none\n"
MAKER = Maker.of(HERE, CPU)
PICTURE = np.random.default_rng(0).integers(0, 200, (6, 8, 3), dtype=np.uint8)


@pytest.fixture
def goldens(tmp_path):
    """A folder with the golden ch01/noise."""
    made = Goldens(tmp_path / "goldens", tmp_path / "look", bless=True)
    made.check("ch01/noise", PICTURE, MAKER, {"coverage": 0.5})
    assert made.finish(lambda text: None, lambda question: True) == 1
    return Goldens(tmp_path / "goldens", tmp_path / "look")


def test_a_golden_knows_its_driver_llvm_and_cpu(goldens):
    assert (MAKER.llvm, MAKER.cpu) == ("15.0.6", ("sse4_1", "avx", "avx2", "fma"))
    record = json.loads((goldens.folder / "ch01" / "noise.json").read_text())
    assert record["maker"]["device"] == HERE.device
    assert record["maker"]["cpu"] == list(MAKER.cpu)
    assert record["facts"] == {"coverage": 0.5}
    assert Maker.of(replace(HERE, kind="discrete", device="a GPU"), CPU).cpu == ()


def test_the_same_picture_on_the_same_driver_passes(goldens):
    assert goldens.check("ch01/noise", PICTURE, MAKER, {"coverage": 0.5}) == ""
    assert goldens.check("ch01/noise", PICTURE + 1, MAKER, {"coverage": 0.51}) == ""


def test_a_changed_picture_fails_and_shows_itself(goldens):
    changed = PICTURE.copy()
    changed[2, 3, 1] += 9
    with pytest.raises(
        AssertionError, match=r"2\.08% of the pixels differ, by up to 9/255.*noise-error\.png"
    ):
        goldens.check("ch01/noise", changed, MAKER, {"coverage": 0.5})
    assert np.array_equal(read_image(goldens.look / "ch01-noise-old.png")[..., :3], PICTURE)
    assert np.array_equal(read_image(goldens.look / "ch01-noise-new.png")[..., :3], changed)
    error = read_image(goldens.look / "ch01-noise-error.png")[..., :3]
    assert error[2, 3].sum() > 600
    assert (error.sum(axis=-1) > 10).sum() == 1


@pytest.mark.parametrize(
    "other",
    [
        Maker.of(replace(HERE, driver="Mesa 26.0.0"), CPU),
        Maker.of(replace(HERE, device="llvmpipe (LLVM 19.1.0, 256 bits)"), CPU),
        Maker.of(HERE, CPU.replace("fma", "")),
        Maker.of(replace(HERE, backend="gl"), CPU),
    ],
    ids=["driver", "llvm", "cpu", "backend"],
)
def test_on_another_driver_only_facts_are_compared_and_it_says_so(goldens, other):
    why = goldens.check("ch01/noise", 255 - PICTURE, other, {"coverage": 0.51})
    assert why.startswith("the golden was made elsewhere (")
    with pytest.raises(AssertionError, match=r"has coverage 0\.5, this picture 0\.6"):
        goldens.check("ch01/noise", PICTURE, other, {"coverage": 0.6})
    with pytest.raises(AssertionError, match="this picture nan"):
        goldens.check("ch01/noise", PICTURE, other, {"coverage": float("nan")})


def test_a_missing_golden_and_another_size_fail(goldens):
    with pytest.raises(AssertionError, match=r"no golden 'ch01/absent'.*--bless"):
        goldens.check("ch01/absent", PICTURE, MAKER, {})
    with pytest.raises(AssertionError, match=r"is \(6, 8, 3\), this picture \(6, 7, 3\)"):
        goldens.check("ch01/noise", PICTURE[:, :7], MAKER, {})


def test_blessing_asks_for_each_and_takes_no_for_an_answer(goldens):
    changed = PICTURE // 2
    said, asked = [], []

    def bless(answer):
        run = Goldens(goldens.folder, goldens.look, bless=True)
        run.check("ch01/noise", changed, MAKER, {"coverage": 0.5})
        run.check("ch01/other", PICTURE, MAKER, {"coverage": 0.1})
        return run.finish(said.append, lambda question: bool(asked.append(question)) or answer)

    assert bless(False) == 0
    assert np.array_equal(read_image(goldens.folder / "ch01" / "noise.png")[..., :3], PICTURE)
    assert not (goldens.folder / "ch01" / "other.png").exists()
    assert len(asked) == 2
    assert any(line.strip().endswith("ch01-noise-error.png") for line in said)
    assert "ch01/other: new" in said
    assert bless(True) == 2
    assert np.array_equal(read_image(goldens.folder / "ch01" / "noise.png")[..., :3], changed)
    assert bless(True) == 0, "what is unchanged is not asked for"
    assert said[-2:] == ["ch01/noise: unchanged", "ch01/other: unchanged"]
    assert len(asked) == 4


def test_two_variants_that_differ_make_no_golden(goldens):
    run = Goldens(goldens.folder, goldens.look, bless=True)
    run.check("ch01/noise", PICTURE, MAKER, {})
    with pytest.raises(AssertionError, match="different pictures for the golden 'ch01/noise'"):
        run.check("ch01/noise", PICTURE + 5, MAKER, {})


def test_figures_of_another_size_say_the_sizes():
    assert figures(PICTURE, PICTURE[:3]) == "8x3 in place of 8x6"


def test_a_later_chapter_has_the_golden_of_the_nearest_before_it(goldens):
    areas = ["ch01", "ch02", "ch03"]
    assert goldens.place(areas, "noise", PICTURE) == "ch01/noise"
    (goldens.folder / "ch02").mkdir()
    (goldens.folder / "ch02" / "noise.png").write_bytes((goldens.folder / "ch01" / "noise.png").read_bytes())
    assert goldens.place(areas, "noise", 255 - PICTURE) == "ch02/noise"
    assert goldens.place(["ch01"], "noise", PICTURE) == "ch01/noise"
    assert goldens.place(areas, "absent", PICTURE) == "ch01/absent"


def test_a_later_chapter_gets_its_own_golden_when_its_picture_is_another(goldens):
    areas = ["ch01", "ch02"]
    again = Goldens(goldens.folder, goldens.look, bless=True)
    assert again.place(areas, "noise", PICTURE) == "ch01/noise"
    assert again.place(areas, "noise", 255 - PICTURE) == "ch02/noise"
    again.check("ch01/noise", 255 - PICTURE, MAKER, {})
    assert again.place(areas, "noise", 255 - PICTURE) == "ch01/noise", "chapter 1 is about to look so too"
