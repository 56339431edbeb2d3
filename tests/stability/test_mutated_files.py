"""Mutated scene files: each is loaded, or refused by one sentence; none hangs, fills the memory or leads outside.

The usual run takes a small sample, `--long` takes 20,000 files and draws 1,000 of them on each backend. A case that
fails is named in the message, with the command that writes its files into a folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import chapters
from common.errors import UnsupportedError
from tests.support import mutation_run, mutation_sources, mutations, packages
from tests.support.drawable import assert_drawable
from tests.support.mutation_run import LIMIT_BYTES, LIMIT_S, Summary
from tests.support.mutation_stubs import DOINGS
from tests.support.mutation_works import SIZE, faults_of, faults_of_picture
from tests.support.mutations import Case, cases
from tests.support.scenes import quad_scene

pytestmark = [
    pytest.mark.feature("scene/gltf-loader"),
    pytest.mark.skipif(
        sys.platform != "linux", reason="memory, pipes and devices are looked at as Linux has them"
    ),
]

WORKS = "tests.support.mutation_works"
NEWEST = chapters.available()[-1]
DRAWN_BY = (1, 3, NEWEST)
"""The first chapter, the first that keeps scenes in a cache, and the newest."""

SLOW = ("atrium", "sky.hdr", "sky.exr")
"""Sources that software draws for seconds although nothing is wrong: 33 textures with mips, and panoramas."""

BATCH = 2000


def run(work: str, chosen: list[Case], folder, **options) -> Summary:
    try:
        return mutation_run.run(f"{WORKS}:{work}", chosen, folder, options)
    except UnsupportedError as error:
        pytest.skip(f"no device: {error}")


@pytest.fixture
def draw(request, tmp_path):
    """Draw cases by chapters on a backend; the record of the run gets what they were drawn with."""

    def drawn(chosen: list[Case], numbers, backend: str) -> Summary:
        summary = run("Draw", chosen, tmp_path, chapters=numbers, backend=backend)
        devices = request.config.pluginmanager.getplugin("strata-report").devices
        devices.setdefault(backend, summary.device)
        return summary

    return drawn


def hold(summary: Summary, parsed: bool = True) -> None:
    """Fail on any fault, and where the files prove little because most are no glTF, or all go the same way."""
    print(summary.figures(), summary.device)  # with -s, and where something fails
    assert not summary.faults, summary.report()
    assert max(result.seconds for result in summary.results) <= LIMIT_S
    assert 0 < max(result.peak for result in summary.results) <= LIMIT_BYTES
    if parsed:
        assert summary.parsed >= 0.5
        assert summary.count("loaded") and summary.count("refused")


# --- a sample -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_sample_is_loaded_or_refused(tmp_path):
    hold(run("Load", cases(100), tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_a_sample_is_drawn_or_refused(backend, draw):
    sample = cases(12, without=(*SLOW, "cloth"))  # to drape a cloth takes seconds
    hold(draw(sample, [NEWEST], backend))


@pytest.mark.slow
@pytest.mark.needs("moderngl", "glcontext")
def test_a_sample_is_given_to_commands(tmp_path):
    sample = cases(8, without=(*SLOW, "cloth"))
    hold(run("Command", sample, tmp_path, chapters=[1], backend="gl"), parsed=False)


# --- all ----------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("batch", range(10))
def test_twenty_thousand_are_loaded_or_refused(batch, tmp_path):
    hold(run("Load", cases(BATCH, BATCH * batch), tmp_path))


@pytest.mark.long
@pytest.mark.parametrize("batch", range(4))
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_a_thousand_are_drawn_or_refused(backend, batch, draw):
    drawn = cases(250, 250 * batch, without=SLOW)
    hold(draw(drawn, DRAWN_BY, backend))


@pytest.mark.long
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_panoramas_are_drawn_or_refused(backend, draw):
    here = [name for name in SLOW[1:] if name in mutation_sources.names()]
    drawn = [Case(name, seed) for name in here for seed in range(4)]
    hold(draw(drawn, [NEWEST], backend), parsed=False)


@pytest.mark.long
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_hundreds_are_given_to_commands(backend, tmp_path):
    given = cases(250, without=SLOW)
    hold(run("Command", given, tmp_path, chapters=DRAWN_BY, backend=backend), parsed=False)


# --- the runner and the mutations themselves ----------------------------------------------------------------


@pytest.fixture(scope="module")
def noticed(tmp_path_factory):
    """What the runner says of a work that misbehaves in every way, with limits of 4 s and 256 MB."""
    chosen = [Case("everything.glb", seed) for seed in range(len(DOINGS))]
    folder = tmp_path_factory.mktemp("faulty")
    return mutation_run.run(
        "tests.support.mutation_stubs:Faulty", chosen, folder, limit_s=4.0, limit_bytes=2**28
    )


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(DOINGS)), ids=[doing.__name__ for doing, _ in DOINGS])
def test_what_a_work_does_wrong_is_noticed_and_the_next_file_is_taken(noticed, number):
    result = noticed.results[number]
    assert (result.case.seed, result.outcome) == (number, DOINGS[number][1]), result.text


def test_a_hang_is_shown_by_its_line_and_a_fault_by_its_traceback(noticed):
    by_name = {doing.__name__: result for (doing, _), result in zip(DOINGS, noticed.results, strict=True)}
    assert "in hangs" in by_name["hangs"].text
    assert "/dev/zero" in by_name["hangs"].text
    assert "KeyError: 'bufferView'" in by_name["raises"].text
    assert "secret.png" in by_name["opens_outside"].text
    assert by_name["eats_memory"].peak > 2**28
    assert by_name["hangs"].seconds < 30


def test_faults_fail_and_the_message_says_how_to_look_at_one(noticed):
    with pytest.raises(
        AssertionError, match=r"python -m tests[.]support[.]mutations everything[.]glb:2 FOLDER"
    ):
        hold(noticed)
    assert len(noticed.faults) == len(DOINGS) - 3


def test_a_missing_device_skips(monkeypatch, tmp_path):
    monkeypatch.setattr(mutation_run, "run", lambda *_: (_ for _ in ()).throw(UnsupportedError("none")))
    with pytest.raises(pytest.skip.Exception, match="no device: none"):
        run("Draw", cases(1), tmp_path)


def test_a_case_is_the_same_files_every_time_and_can_be_written(tmp_path, capsys):
    for case in cases(40):
        assert mutations.mutate(case).files == mutations.mutate(Case.named(str(case))).files
    different = {mutations.mutate(Case("cornell", seed)).files["cornell.gltf"] for seed in range(40)}
    assert len(different) > 20
    mutations.main(["cornell:12", str(tmp_path)])
    written = capsys.readouterr().out.split("\n")[0]
    assert Path(written).read_bytes() == mutations.mutate(Case("cornell", 12)).files["cornell.gltf"]


def test_what_a_picture_may_not_have():
    linear, color = np.ones((*SIZE, 3), np.float32), np.zeros((*SIZE, 3), np.uint8)
    assert faults_of_picture(linear, color, []) == []
    assert faults_of_picture(linear, color[1:], []) != []
    assert faults_of_picture(linear, color, ["VUID: a message"]) == ["VUID: a message"]
    for value in (np.nan, np.inf, -np.inf):
        broken = linear.copy()
        broken[3, 4, 1] = value
        assert faults_of_picture(broken, color, []) == ["1 numbers are not finite"]


@pytest.mark.parametrize("name", ["positions", "normals", "uv0"])
def test_what_a_loaded_scene_may_not_have(name):
    scene = quad_scene()
    assert_drawable(scene)
    getattr(scene, name)[1, 0] = np.nan
    with pytest.raises(AssertionError):
        assert_drawable(scene)


@pytest.mark.parametrize(
    ("code", "printed", "said", "fault"),
    [
        (0, "a table\n", "strata: drawing with OpenGL.\n", ""),
        (2, "", "strata: a.gltf: the file is empty; export it again.\n", ""),
        (1, "", "strata: KeyError: 1\n", "exit code 1"),
        (2, "", "", "no sentence"),
        (2, "", "a.gltf is empty\n", "no sentence"),
        (2, "", "strata: the name x\nforged\n", "no sentence"),
        (0, "\x1b[31mred\n", "", "letters that move a terminal"),
        (0, "", "a name \x07\n", "letters that move a terminal"),
        (0, "x\nstrata: forged\n", "", "a forged line"),
        (0, "", "objects outlived their device\n", "a traceback"),
        (0, "", "Traceback (most recent call last):\n", "a traceback"),
    ],
)
def test_what_a_command_may_not_print(code, printed, said, fault):
    assert ", ".join(faults_of(code, printed.encode(), said.encode())).startswith(fault)
    assert bool(faults_of(code, printed.encode(), said.encode())) == bool(fault)
