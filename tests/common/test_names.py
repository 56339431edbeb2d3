"""Name hashes are stable and free of collisions in practice; suggestions find the near word."""

from __future__ import annotations

import os
import subprocess
import sys
import unicodedata

import pytest

from common.names import is_visible, stable_hash, suggest, visible
from common.paths import ROOT


@pytest.mark.feature("core/stable-name-hash")
def test_the_hash_is_the_same_in_every_process():
    """Pinned too, since files outlive a version: `printf albedo | b2sum -l 64`, read little endian."""
    assert stable_hash("albedo") == 0x847139DFD5DAABE4
    code = "from common.names import stable_hash; print(stable_hash('albedo'))"
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        result = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, check=True
        )
        assert int(result.stdout) == stable_hash("albedo")


@pytest.mark.feature("core/stable-name-hash")
def test_pythons_own_hash_is_another_in_every_process():
    """So that the test above is seen to notice one that differs."""
    found = [
        subprocess.run(
            [sys.executable, "-c", "print(hash('albedo'))"],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    ]
    assert found[0] != found[1]


@pytest.mark.feature("core/stable-name-hash")
def test_hashed_names_behave_as_plain_strings_in_a_dict():
    names = [f"node_{i // 7}/mesh.{i % 7}_é{i}" for i in range(100_000)]
    plain = {name: i for i, name in enumerate(names)}
    hashed = {stable_hash(name): i for i, name in enumerate(names)}
    assert len(hashed) == len(plain)
    for name in names[::3]:
        assert hashed.pop(stable_hash(name)) == plain.pop(name)
    assert all(hashed.get(stable_hash(name)) == plain.get(name) for name in names)
    assert all(0 <= key < 2**64 for key in hashed) and max(hashed) > 2**63


@pytest.mark.parametrize(
    ("word", "words", "expected"),
    [
        ("medum", ["low", "medium", "high"], "; did you mean 'medium'?"),
        ("KITCHEN", ["Kitchen", "Hall"], "; did you mean 'Kitchen'?"),
        ("zzz", ["b", "a"], "; known are 'a', 'b'"),
        ("Rays", ["ray-query", "array", "ray-tracing"], "; did you mean 'array'?"),
        ("rays", ["ray-query", "ray-tracing", "etc2"], "; did you mean 'ray-query' or 'ray-tracing'?"),
        ("ra", ["ray-query"], "; known are 'ray-query'"),
        (
            "zzz",
            [f"n{i}" for i in range(12)],
            "; known are 'n0', 'n1', 'n10', 'n11', 'n2', 'n3', 'n4', 'n5', ...",
        ),
        ("zzz", [], ""),
    ],
)
def test_suggest(word, words, expected):
    assert suggest(word, words) == expected


def is_hidden(character):
    """What Unicode says: a control, half a character, a separator of lines, or something that steers the direction."""
    steering = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    return (
        unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp")
        or unicodedata.bidirectional(character) in steering
        or character in "\u061c\u200e\u200f"  # marks of direction, whose class is that of letters
    )


def test_what_unicode_calls_hidden_is_written_out_and_letters_are_not():
    every = [chr(code) for code in range(0x110000)]
    changed = {character for character in every if visible(character) != character}
    hidden = {character for character in every if is_hidden(character)}
    assert len(hidden) == 65 + 2048 + 2 + 9 + 3
    assert hidden <= changed
    # The rest are marks without a picture of their own, by which two names would look alike.
    assert {unicodedata.category(character) for character in changed - hidden} <= {"Cf", "Cn"}
    assert len(changed - hidden) < 160
    for character in changed:
        text = visible(character)
        assert text.isascii() and text.isprintable() and text.startswith("\\") and is_visible(text)
        assert text.encode().decode("unicode_escape") == character or 0xDC80 <= ord(character) <= 0xDCFF
    for text in ("Grüße", "日本語", "العربية", "👩\u200d🚀", "a\\b", "50 %", "\xa0"):
        assert visible(text) == text and is_visible(text)


def test_hidden_characters_have_names_that_are_typed():
    assert visible("a\nb\t\x1b[2J\x9b\u202e\ud800") == r"a\nb\t\x1b[2J\x9b\u202e\ud800"
    assert visible(os.fsdecode(b"b\xff")) == r"b\xff"
    assert visible("a\n\tb\r", keep="\n\t") == "a\n\tb\\r"
    assert stable_hash("\ud800") != stable_hash("\ud801")
