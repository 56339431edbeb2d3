"""Continuous integration: the script, and what the public workflow takes from the README."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from typing import Any

import pytest

from common.paths import ROOT

WORKFLOW = ROOT / ".github" / "workflows" / "ci.yml"


@pytest.fixture
def jobs() -> dict[str, Any]:
    """The jobs of the workflow, by their names."""
    import yaml

    found: dict[str, Any] = yaml.safe_load(WORKFLOW.read_text("utf-8"))["jobs"]
    return found


def commands(job: dict[str, Any]) -> list[str]:
    return [step["run"].strip() for step in job["steps"] if "run" in step]


def readme() -> list[str]:
    """Return the commands of the README's first block: what a reader types on a fresh machine."""
    block = (ROOT / "README.md").read_text("utf-8").split("```")[1]
    found = [line.partition("#")[0].strip() for line in block.splitlines()]
    return [line for line in found if line.startswith("./strata") and "/first-triangle" not in line]


@pytest.mark.needs("yaml")
@pytest.mark.parametrize("system", ["linux", "windows", "macos"])
def test_the_workflow_types_the_commands_of_the_readme(jobs, system):
    first, second = readme()
    assert (first, second) == ("./strata run 1", "./strata test")
    ran = commands(jobs[system])
    if system == "linux":
        assert ran[-1] == "bash .ci/run", "which is held to the second command below"
        assert f"{first} --out a.png" in ran
        return
    if system == "windows":  # as the README says there
        first, second = (text.replace("./strata", "strata.cmd") for text in (first, second))
    assert ran[-2:] == [f"{first} --out a.png", second]
    assert f"{first.partition(' ')[0]} --yes doctor" in ran[0]
    assert not any("pytest" in command for command in ran)


@pytest.mark.needs("yaml")
@pytest.mark.parametrize("system", ["windows", "macos"])
def test_where_nothing_can_draw_one_sentence_says_so_and_only_the_drawing_is_left_out(jobs, system):
    steps = jobs[system]["steps"]
    (said,) = re.findall(r"::notice::([^\"\n]*)", commands(jobs[system])[0])
    assert said.endswith(".") and said.count(". ") == 0 and "chapter 1 is not run here" in said
    conditional = [step["run"] for step in steps if "if" in step]
    assert len(conditional) == 1 and " run 1 " in conditional[0]
    assert jobs[system]["env"]["CI"] == "", "a reader has no extras"


@pytest.mark.skipif(sys.platform == "win32", reason="the script is bash")
@pytest.mark.needs("yaml")
@pytest.mark.parametrize(
    ("code", "drawn", "said", "ended"), [(0, True, False, 0), (2, False, True, 0), (1, False, False, 1)]
)
def test_the_step_on_macos_tells_no_device_from_a_failure(jobs, tmp_path, code, drawn, said, ended):
    script = tmp_path / "strata"
    script.write_text(f"#!/bin/sh\nexit {code}\n")
    script.chmod(stat.S_IRWXU)
    done = subprocess.run(
        ["bash", "-e", "-c", commands(jobs["macos"])[0]],
        cwd=tmp_path,
        env={**os.environ, "GITHUB_OUTPUT": str(tmp_path / "output")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == ended
    assert ("::notice::" in done.stdout) == said
    output = tmp_path / "output"
    assert (output.exists() and output.read_text() == "draws=yes\n") == drawn


# --- the script -------------------------------------------------------------------------------------------------------

STRATA = """#!/bin/sh
echo "$PWD: CI=$CI $*" >>"$LOG"
case "$*" in *--uses=*)
    folder=${2#--uses=}
    mkdir -p "$folder"
    echo tests/a.py >"$folder/extras.txt"
    echo tests/b.py >"$folder/platforms.txt" ;;
esac
mkdir -p .venv/bin
printf '#!/bin/sh\\necho "$PWD: python $*" >>"$LOG"\\n' >.venv/bin/python
chmod +x .venv/bin/python
case "$*" in *"$FAILS"*) echo "1 failed"; exit 1 ;; esac
echo "3 passed"
"""


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Run .ci/run in a clone whose launcher writes down its words; return (exit code, last line, what was run)."""
    clone = tmp_path / "clone"
    (clone / ".ci").mkdir(parents=True)
    (clone / ".ci" / "run").write_bytes((ROOT / ".ci" / "run").read_bytes())
    (clone / "strata").write_text(STRATA)
    (clone / "strata").chmod(stat.S_IRWXU)
    (clone / ".gitignore").write_text("out/\n.venv/\n")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(clone)]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "a"]):
        subprocess.run([*git, *words], check=True)
    for name in ("STRATA_CACHE", "MESA_SHADER_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)

    def run(*words: str, fails: str = "nothing") -> tuple[int, str, list[str]]:
        log = tmp_path / "log"
        log.write_text("")
        done = subprocess.run(
            ["bash", str(clone / ".ci" / "run"), *words],
            env={**os.environ, "LOG": str(log), "FAILS": fails},
            capture_output=True,
            text=True,
            check=False,
        )
        return (
            done.returncode,
            done.stdout.splitlines()[-1],
            log.read_text().replace(str(clone), "clone").splitlines(),
        )

    return run


@pytest.mark.skipif(sys.platform == "win32", reason="the script is bash")
def test_all_tests_run_with_all_extras_and_then_those_that_packages_matter_to_without(script):
    code, last, ran = script()
    assert (code, last) == (0, "3 passed")
    inner = "clone/out/ci/without-extras"
    assert ran[:2] == [
        "clone: CI=true test --uses=clone/out/ci/uses",
        f"{inner}: CI= --no-install test -q tests/a.py",
    ]
    assert ran[2].startswith(f"{inner}: python -m pip ") and ran[2].endswith(
        " etcpak glcontext moderngl OpenEXR"
    )
    assert ran[3:] == [f"{inner}: CI= --no-install test -q tests/b.py"]
    assert script()[0] == 0, "a second time, over what the first one left"


@pytest.mark.skipif(sys.platform == "win32", reason="the script is bash")
@pytest.mark.parametrize(("fails", "runs"), [("--uses", 1), ("tests/a.py", 2), ("tests/b.py", 4)])
def test_whichever_run_fails_fails_the_script_and_ends_it(script, fails, runs):
    code, last, ran = script(fails=fails)
    assert (code, last, len(ran)) == (1, "1 failed", runs)


@pytest.mark.skipif(sys.platform == "win32", reason="the script is bash")
def test_with_words_the_script_runs_those_alone(script):
    assert script("ch01", "-k", "alpha")[2] == ["clone: CI=true test ch01 -k alpha"]
    assert script("ch01", fails="ch01")[:2] == (1, "1 failed")
