"""`strata carry` as it is typed: what goes together, and what is said where something is missing."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.feature("tools/carry")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "Which chapter has the fix?"),
        (("99", "x"), "There is no chapter 99"),
        (("1/phong", "x"), "this is about whole chapters: write 1"),
        (("1", "no-such-file"), "There is no file no-such-file in ch01"),
        (("1", "../ch02/renderer.py"), "is not in ch01"),
        (("1", "studies/stage.py"), "studies are not copied"),
        (("1", "renderer.py", "--base", "no-such-commit"), "git rev-parse failed"),
        (("--check", "1"), "`strata carry --check` stands alone"),
        (("--continue", "--abort"), "`strata carry --continue` stands alone"),
        (("--check", "--dry-run"), "has no --dry-run"),
    ],
)
def test_what_is_wrong_is_one_sentence(strata, words, said):
    code, out, err = strata("carry", *words, *(["--dry-run"] if words and words[0][0] == "1" else []))
    assert (code, out) == (2, "")
    assert said in " ".join(err.split()) and err.startswith("strata: ")


def test_the_chapters_here_have_all_repairs(strata):
    code, out, err = strata("carry", "--check")
    assert (code, out) == (0, "") and "Every line repaired" in err
