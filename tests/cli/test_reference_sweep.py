"""`strata reference --sweep`: the bits of one process, whatever becomes of workers, and files that go on."""

from __future__ import annotations

import csv
import errno
import os
import signal
import socket
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from chapters import scenes
from common import packages
from common.paths import write_whole
from tests.support import sweep_parts
from tests.support.packages import BACKENDS
from tools.reference import command as single
from tools.reference import tiles, tracing
from tools.reference.sums import block_after, write_sums
from tools.reference.sweep import command, merging, pools, table, work

pytestmark = pytest.mark.feature("path-tracer/accumulation")

TWENTY_FOUR = """
chapter = 1
scene = "cornell"
camera = ["", "1,0.5,3:0,0.8,0", "0.5,0.6,2.5:0,0.5,0"]
size = "16x16"
seed = [0, 1, 2, 7]
settings = [{}, {path_bounces = 2}]
paths = 3
error = 0
format = "npy"
"""
FOUR = """
chapter = 1
scene = "cornell"
size = "16x16"
seed = [0, 1, 2, 3]
paths = 64
error = 0
format = "npy"
"""


@pytest.fixture
def kept(tmp_path_factory, monkeypatch):
    """Keep sums in a folder of the test: return it."""
    folder = tmp_path_factory.mktemp("references")
    monkeypatch.setattr(tracing, "cache_dir", lambda name: folder)
    return folder


@pytest.fixture
def made_up(monkeypatch):
    """Have this process make parts up in place of tracing them; return the list of their keys."""
    traced = []

    def trace(self, part):
        traced.append(part.key)
        return sweep_parts.blocks_of(part)

    monkeypatch.setattr(work.Tracer, "trace", trace)
    return traced


def sweep(strata, tmp_path, text, *words):
    """Run a sweep of a file with this text into the folder of the first of the words."""
    (tmp_path / "s.toml").write_text(text)
    return strata("reference", "--sweep", "s.toml", "--out", *words)


def pictures(folder):
    """Return the bytes of all pictures in a folder, by name."""
    return {path.name: path.read_bytes() for path in folder.glob("*.npy")}


def rows(folder):
    """Return the rows of the table in a folder."""
    with (folder / "sweep.csv").open(newline="") as stream:
        return [*csv.DictReader(stream)]


# --- the bits ---


@pytest.fixture(scope="module")
def one_process(vulkan_instance, tmp_path_factory):
    """The 24 references of one process, which keeps nothing: the folder."""
    folder = tmp_path_factory.mktemp("one")
    (folder / "s.toml").write_text(TWENTY_FOUR)
    asked = command.Request(folder / "s.toml", folder / "out", workers=0, cached=False)
    assert command.run(asked) == 0
    return folder / "out"


def test_each_reference_of_a_sweep_is_the_one_of_strata_reference(one_process, kept):
    """That opens a renderer of its own, and this one took over knobs, camera and seed of others."""
    assert not [*kept.iterdir()] and len({*pictures(one_process).values()}) == 24
    options = {"paths": 3, "seed": 7, "cached": False, "overrides": ["path_bounces=2"]}
    alone, _ = tracing.reference(1, scenes.load("cornell"), "1,0.5,3:0,0.8,0", (16, 16), 0.0, **options)
    name = "ch01-cornell-camera-1-0.5-3-0-0.8-0-seed-7-settings-path_bounces-2.npy"
    assert np.array_equal(np.load(one_process / name), alone)


@pytest.mark.needs("distributed")
def test_24_references_on_two_workers_are_those_of_one_process_though_a_worker_is_killed(
    one_process, strata, kept, tmp_path, monkeypatch
):
    monkeypatch.setattr(work, "MOST_BLOCKS", 2)  # two parts for each
    killed = []

    def kill(pool):
        nanny = next(iter(pool.cluster.workers.values()))
        killed.append(nanny.pid)
        os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    sweep_parts.on_outcomes(monkeypatch, pools.Workers, 24, kill)
    code, out, err = sweep(strata, tmp_path, TWENTY_FOUR, "two", "--workers", 2, "--no-cache")
    assert code == 0, err
    assert (
        killed and out == "" and "24 references of s.toml: 3 cameras, 4 seeds, 2 settings; traced by 2" in err
    )
    assert pictures(tmp_path / "two") == pictures(one_process) and not [*kept.iterdir()]
    tables = rows(one_process), rows(tmp_path / "two")
    for row in (row for each in tables for row in each):
        assert (row.pop("paths"), row.pop("note")) == ("3", "") and float(row.pop("seconds")) > 0.0
    assert tables[0] == tables[1] and len(tables[0]) == 24


@pytest.mark.parametrize(
    ("seed", "largest", "waiting"),
    [(0, 512, 1 << 20), (1, 512, 0), (2, 1, 1 << 20), (3, 2, 1 << 20), (4, 2, 200)],
)
def test_parts_in_any_order_give_the_sums_of_blocks_in_order(seed, largest, waiting, monkeypatch):
    """Some references stop at an error, in the middle of a part, and some at a number of paths.

    They have one tile, six, or two that overlap. Few bytes may wait for earlier ones, or many.
    """
    monkeypatch.setattr(tiles, "LARGEST", largest)
    monkeypatch.setattr(merging, "MOST_WAITING", waiting)
    goals = [(0.0, 77), (0.12, 4096), (0.2, 4096), (0.0, 1), (0.25, 300), (0.0, 0)]
    requests = [single.Request(1, size=(3, 2), error=error, paths=paths) for error, paths in goals]
    references = [
        merging.Reference(number, str(number), request, {"of": str(number)}, 0.01, cached=False)
        for number, request in enumerate(requests)
    ]
    found, told = {}, []
    pool = sweep_parts.AnyOrder(seed)
    merging.Merging(
        references,
        pool,
        lambda reference, finished: found.update({reference.number: finished}),
        lambda part, text: told.append((part, text)),
    ).run()
    for reference in references:
        light, squares, paths = sweep_parts.merged_alone(reference)
        sums = found[reference.number].sums
        assert sums.paths == paths and sums.devices == (("made up",) if paths else ())
        assert np.array_equal(sums.light, light) and np.array_equal(sums.squares, squares)
    assert found[1].sums.paths not in (0, 4096) and found[1].error <= 0.12
    assert told[-1][0] == 1.0 and told[-1][1].startswith("6 of 6 references")
    assert all(a <= b + 0.2 for (a, _), (b, _) in pairwise(told))


@pytest.mark.parametrize(
    ("size", "most"),
    [
        ((1, 1), 4096),
        ((16, 16), 1000),
        ((64, 36), 5000),
        ((512, 512), 600),
        ((1920, 1080), 300),
        ((4096, 2048), 3),
    ],
)
def test_parts_are_the_blocks_of_one_run(size, most):
    """In tiles there are as few bytes and paths in a part as in small pictures, and few of all tiles wait."""
    cut, pixels = tiles.tiles_of(size), size[0] * size[1]
    of_tile = cut[0].size[0] * cut[0].size[1]
    blocks, paths = [], 0
    while paths + (count := block_after(paths, pixels)) <= most:
        blocks.append(count)
        paths += count
    parts, first = [], 0
    while counts := work.counts_of(first, size, most):
        parts.append(counts)
        first += sum(counts)
    assert [count for part in parts for count in part] == blocks
    for part in parts:
        assert 24 * of_tile * len(part) <= 64 << 20 and sum(part) * of_tile <= 1 << 22
        assert len(part) == 1 or 24 * of_tile * len(cut) * len(part) <= 256 << 20


def test_no_part_is_handed_out_where_too_many_wait_for_an_earlier_one(monkeypatch):
    """A slow worker beside fast ones: what they trace ahead of it is in memory until it has come."""
    monkeypatch.setattr(merging, "MOST_WAITING", 100)
    request = single.Request(1, size=(3, 2), error=0.0, paths=4096)
    reference = merging.Reference(0, "it", request, {"of": "it"}, 0.01, cached=False)
    reference.begin()
    slow, *others = (reference.next_part() for _ in range(3))
    for part in others:
        reference.take(part, sweep_parts.blocks_of(part))
    assert reference.next_part() is None and reference.flying == {slow.key}
    reference.take(slow, sweep_parts.blocks_of(slow))
    assert reference.keeper.sums.paths == others[-1].end and reference.next_part().first == others[-1].end


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.usefixtures("kept")
def test_references_of_equal_contents_go_on_with_one_another(strata, tmp_path, made_up, backend):
    """Chapters 1 and 2 have the same light here: the second needs no path of its own."""
    text = FOUR.replace("chapter = 1", "chapter = [1, 2]").replace("[0, 1, 2, 3]", "0")
    code, _, err = sweep(strata, tmp_path, text, "a", "--workers", 0, "--backend", backend)
    assert code == 0, err
    first, second = rows(tmp_path / "a")
    assert (first["paths"], second["paths"], second["seconds"]) == ("64", "64", "0.000")
    assert len({*pictures(tmp_path / "a").values()}) == 1 and {key[0] for key in made_up} == {0}


@pytest.mark.needs("OpenEXR")
@pytest.mark.usefixtures("kept", "made_up")
def test_a_sweep_asks_nothing_of_the_current_folder(strata, tmp_path):
    (tmp_path / "reference.exr").mkdir()
    code, _, err = sweep(strata, tmp_path, FOUR.replace('"npy"', '"exr"'), "a", "--workers", 0)
    assert code == 0, err
    assert len([*(tmp_path / "a").glob("*.exr")]) == 4


# --- interruptions ---


def test_ctrl_c_keeps_what_is_merged_and_the_same_command_goes_on(
    strata, kept, tmp_path, monkeypatch, made_up
):
    assert sweep(strata, tmp_path, FOUR, "whole", "--workers", 0, "--no-cache")[0] == 0
    in_all = len(made_up)
    made_up.clear()

    def stop(pool):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        sweep_parts.on_outcomes(patched, pools.Here, 8, stop)
        code, out, err = sweep(strata, tmp_path, FOUR, "a", "--workers", 0)
    assert (code, out) == (130, "")
    assert len(made_up) == 7 and len(rows(tmp_path / "a")) == 2
    told = "strata: 2 of 4 references are written; the same command goes on with the rest."
    assert err.splitlines()[-2:] == [told, "strata: stopped."]
    code, _, err = sweep(strata, tmp_path, FOUR, "a", "--workers", 0)
    assert code == 0, err
    assert len(made_up) == in_all and len({*made_up}) == in_all  # nothing twice
    assert pictures(tmp_path / "a") == pictures(tmp_path / "whole") and len(rows(tmp_path / "a")) == 4


def test_ctrl_c_waits_for_workers_that_start():
    done = []

    def start():
        with pools._uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        start()
    assert done == [True] and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def full(monkeypatch, folder):
    """Have the disk of a folder full."""

    def write(path, sums, facts):
        if path.parent == folder:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_sums(path, sums, facts)

    monkeypatch.setattr(tracing, "write_sums", write)
    monkeypatch.setattr(merging, "KEEP_EVERY_S", 0.0)


@pytest.mark.usefixtures("made_up")
def test_a_full_cache_is_said_once_and_sums_of_an_interrupted_sweep_go_beside(
    strata, kept, tmp_path, monkeypatch
):
    full(monkeypatch, kept)
    code, _, err = sweep(strata, tmp_path, FOUR, "a", "--workers", 0)
    assert code == 0 and err.count("sums cannot be kept (No space left on device)") == 1
    assert len(pictures(tmp_path / "a")) == 4

    def stop(pool):
        raise KeyboardInterrupt

    sweep_parts.on_outcomes(monkeypatch, pools.Here, 2, stop)
    code, _, err = sweep(strata, tmp_path, FOUR, "b", "--workers", 0)
    assert code == 130 and "--sums b/ch01-cornell-seed-0.npy.npz of `strata reference` goes on" in err
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["ch01-cornell-seed-0.npy.npz"]


@pytest.mark.usefixtures("made_up")
def test_a_picture_that_cannot_be_written_costs_that_reference_alone(strata, kept, tmp_path, monkeypatch):
    def write(path, data):
        if "seed-2" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_whole(path, data)

    monkeypatch.setattr(single, "write_whole", write)
    code, _, err = sweep(strata, tmp_path, FOUR, "a", "--workers", 0)
    assert code == 2 and len(pictures(tmp_path / "a")) == len(rows(tmp_path / "a")) == 3
    assert err.splitlines()[-1] == (
        "strata: ch01-cornell-seed-2 could not be made: a/ch01-cornell-seed-2.npy cannot be written: No space left on "
        "device. Sums that are merged are kept."
    )
    assert len([*kept.iterdir()]) == 4


@pytest.mark.usefixtures("kept")
@pytest.mark.needs("distributed")
@pytest.mark.parametrize(("workers", "deaths"), [(1, 1), (2, 2)])
def test_a_part_that_ends_every_worker_is_given_up_and_the_rest_is_written(
    strata, kept, tmp_path, monkeypatch, workers, deaths
):
    # One worker has two parts at a time: Dask blames its end on both, that which only waits included.
    monkeypatch.setattr(pools, "DEATHS", deaths)  # three take longer
    monkeypatch.setattr(command, "Workers", partial(pools.Workers, run=sweep_parts.blocks_or_end))
    code, out, err = sweep(strata, tmp_path, FOUR.replace("0, 1, 2, 3", "1, 2"), "a", "--workers", workers)
    assert (code, out) == (2, "")
    assert "ch01-cornell-seed-1 could not be made: the part with its paths 16 to " in err.splitlines()[-1]
    assert f" ended {deaths} workers, one after the other. Sums" in err.splitlines()[-1]
    assert [row["seed"] for row in rows(tmp_path / "a")] == ["2"]
    assert len([*kept.iterdir()]) == 2  # of the other one, the part before


# --- devices ---


@pytest.mark.usefixtures("kept")
def test_several_devices_are_named_in_table_and_sentence(strata, tmp_path, monkeypatch):
    def trace(self, part):
        blocks = sweep_parts.blocks_of(part)
        return work.Blocks(blocks.sums, "new card" if part.first else "old card", blocks.seconds)

    monkeypatch.setattr(work.Tracer, "trace", trace)
    code, _, err = sweep(strata, tmp_path, FOUR, "a", "--workers", 0)
    assert code == 0 and "old card; new card" in err and table.MIXED in err
    assert {row["note"] for row in rows(tmp_path / "a")} == {table.MIXED}
    text = FOUR.replace("paths = 64", "paths = 1").replace("[0, 1, 2, 3]", "9")
    code, _, err = sweep(strata, tmp_path, text, "b", "--workers", 0)
    assert code == 0 and table.MIXED not in err and [row["note"] for row in rows(tmp_path / "b")] == [""]


@pytest.mark.usefixtures("kept")
def test_a_worker_with_another_scene_or_version_is_refused(vulkan_instance):
    request = single.Request(1, scene="cornell", size=(16, 16), backend="vulkan")
    tracer = work.Tracer()
    scene, hashed = work.Loaded().get(request)
    facts = work.task_for(request, scene).facts(hashed) | {"scene": "", "version of the path tracer": ""}
    with pytest.raises(pools.UserError, match="of another scene and another version of the path tracer"):
        tracer.trace(work.Part(request, tuple(facts.items()), 0, 0, (1,), *tiles.tiles_of((16, 16))))
    tracer.close()


# --- clusters ---


@pytest.mark.usefixtures("kept")
@pytest.mark.needs("distributed")
def test_an_address_that_does_not_answer_is_one_sentence(strata, tmp_path, monkeypatch):
    """One place refuses, and one takes the connection and is silent."""
    monkeypatch.setattr(pools, "ANSWER_S", 0.4)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        with socket.create_server(("127.0.0.1", 0)) as gone:
            closed = gone.getsockname()[1]
        for port in (closed, silent.getsockname()[1]):
            code, out, err = sweep(strata, tmp_path, FOUR, "a", "--cluster", f"tcp://127.0.0.1:{port}")
            assert (code, out) == (2, "") and err.count("\n") == 1
            assert f"--cluster tcp://127.0.0.1:{port} does not answer within 0.4 s" in err
    assert not (tmp_path / "a").exists()


@pytest.mark.usefixtures("kept")
@pytest.mark.needs("distributed")
def test_a_scheduler_that_is_there_is_used_and_one_without_workers_is_refused(strata, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "Workers", partial(pools.Workers, run=sweep_parts.blocks_of))
    monkeypatch.setattr(pools, "ANSWER_S", 2.0)
    distributed = packages.load("distributed")
    options = {"processes": False, "threads_per_worker": 1, "dashboard_address": None, "protocol": "tcp"}
    with distributed.LocalCluster(n_workers=1, host="127.0.0.1", **options) as cluster:
        address = cluster.scheduler_address
        code, _, err = sweep(strata, tmp_path, FOUR, "a", "--cluster", address)
        assert code == 0, err
        assert f"4 references of s.toml: 4 seeds; traced by 1 worker of {address}" in err
        with monkeypatch.context() as patched:
            patched.setattr(pools, "version", lambda: os.urandom(4).hex())
            code, _, err = sweep(strata, tmp_path, FOUR, "b", "--cluster", address)
            assert code == 2 and "the scheduler" in err and "has another version of Strata" in err
        cluster.scale(0)
        monkeypatch.setattr(pools, "ANSWER_S", 0.5)
        code, _, err = sweep(strata, tmp_path, FOUR, "b", "--cluster", address)
        assert code == 2 and f"--cluster {address} has no workers" in err
    assert len(pictures(tmp_path / "a")) == 4 and not (tmp_path / "b").exists()


def test_other_versions_of_packages_are_one_sentence():
    def told(python, numpy):
        return {"host": {"python": python}, "packages": {"numpy": numpy, "distributed": "1"}}

    here = told("3.12.1.final.0", "2.1")
    pools.check_versions(
        "tcp://a:1", {"client": here, "scheduler": told("3.12.9.final.0", "2.1"), "workers": {}}
    )
    for other, says in (
        (told("3.11.1.final.0", "2.1"), "tcp://b:2 has python 3.11, and here is 3.12"),
        (told("3.12.1.final.0", "2.2"), "tcp://b:2 has numpy 2.2, and here is 2.1"),
    ):
        with pytest.raises(pools.UserError, match=says):
            pools.check_versions(
                "tcp://a:1", {"client": here, "scheduler": here, "workers": {"tcp://b:2": other}}
            )


@pytest.mark.usefixtures("kept", "made_up")
def test_without_dask_this_process_traces_and_workers_name_the_extra(strata, tmp_path, monkeypatch):
    def load(name):
        raise ImportError("is not installed")

    monkeypatch.setattr(packages, "load", load)
    for words in (("--workers", 2), ("--cluster", "tcp://10.0.0.1:8786")):
        code, out, err = sweep(strata, tmp_path, FOUR, "a", *words)
        assert (code, out) == (2, "") and err.count("\n") == 1
        assert "needs the package distributed, which is not installed" in err and "`cluster`" in err
    assert not (tmp_path / "a").exists()
    code, _, err = sweep(strata, tmp_path, FOUR, "a")
    assert code == 0 and "traced in this process" in err and len(pictures(tmp_path / "a")) == 4
