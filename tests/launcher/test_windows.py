"""`strata.cmd`, read as a text: no machine of ours runs it, so what can be known without cmd.exe is held here."""

from __future__ import annotations

import re

from bootstrap import environment, packages, run
from common.paths import ROOT

TEXT = (ROOT / "strata.cmd").read_text(
    "ascii"
)  # cmd reads it in the console's encoding, so nothing else may stand there
SHELL = (ROOT / "strata").read_text("utf-8")


def test_every_jump_has_its_label_once() -> None:
    labels = re.findall(r"^:(\w+)$", TEXT, re.MULTILINE)
    assert len(labels) == len(set(labels))
    assert set(re.findall(r"goto (\w+)", TEXT)) == set(labels)


def test_the_users_words_stand_outside_of_blocks() -> None:
    # `%*` is put in before the line is read: a parenthesis in a file's name would end the block.
    depth = 0
    for line in TEXT.splitlines():
        bare = re.sub(r'"[^"]*"', "", line) if not line.startswith("rem") else ""
        assert "%*" not in line or depth == 0
        depth += bare.count("(") - bare.count(")")
    assert depth == 0


def test_both_launchers_know_the_same_options_and_files() -> None:
    options = {f"--{name.replace('_', '-')}" for name in vars(run.parse([])[0])}
    for text in (TEXT, SHELL):
        line = next(
            line
            for line in text.splitlines()
            if "--no-install" in line and ("for %%o" in line or "|" in line)
        )
        assert set(re.findall(r"--[a-z-]+", line)) == options
        for name in (environment.STAMP, packages.LOCK, "PYTHONHOME", "PYTHONPATH", " -P -m chapters "):
            assert name in text


def test_git_writes_the_line_ends_that_each_system_reads() -> None:
    rules = (ROOT / ".gitattributes").read_text("utf-8").splitlines()
    assert rules[0] == "* text=auto eol=lf"
    assert "*.cmd text eol=crlf" in rules
