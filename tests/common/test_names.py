"""Name hashes are stable and free of collisions in practice; suggestions find the near word."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from common.names import stable_hash, suggest
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
