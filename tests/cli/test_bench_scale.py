"""What things cost, and what building pipelines takes: measured on small scenes, and told from made-up figures."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from chapters import available
from chapters.ch02.settings import SIDES, Settings
from common.errors import UnsupportedError, UserError
from common.reports.benches import difference
from common.scene.crowds import crowd
from common.settings import Scale, Side
from tools.bench import bench, pipelines, report
from tools.bench import scale as bench_scale
from tools.bench.points import QUICK, Subject
from tools.cli.commands import invoke
from tools.run.run import open_device

SMALL = replace(QUICK, warm_up=0, frames=1)


@pytest.fixture(scope="module")
def subject():
    """Chapter 2 on a device whose calls nobody checks: that would take longer than they do."""
    with ExitStack() as stack:
        try:
            device = open_device(stack, "vulkan")
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        yield Subject(2, "vulkan", None, (16, 16), device)


def measured(subject, scale, frames=1):
    """Return the record of one scale."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Settings, "SCALES", (scale,))
        patch.setattr(bench_scale, "LEAST_FRAMES", frames)
        (made,) = bench_scale.scales(subject, SMALL, lambda what, part: None)
    return made


@pytest.fixture(scope="module")
def small(subject):
    """The record of a small scale with all sides of the chapter."""
    sides = tuple(replace(side, most=side.most and 50) for side in SIDES)
    return measured(subject, Scale("draws", partial(crowd, materials=7), (), (1, 10, 200), sides))


@pytest.mark.feature("tools/bench")
def test_every_side_is_measured_at_every_count_and_draws_the_same(small):
    found = {(point["side"], point["count"]): point for point in small["points"]}
    left_out = {(one["side"], one["count"]) for one in small["skipped"]}
    assert {("chapter 1", 200), ("without multi-draw", 200)} <= left_out
    names = [side.name for side in SIDES]
    assert names == ["chapter 1", "without bindless", "without multi-draw", "all features"]
    assert found.keys() == {(side, count) for side in names for count in (1, 10, 200)} - left_out
    for (_, count), point in found.items():
        assert point["error"] == {"max_abs": 0.0, "pixels_differ": 0}
        assert point["work"]["draws"] == count + 1  # and the picture's triangle
        for name in bench_scale.TIMES:
            assert point[f"{name}_ms"] >= point[f"{name}_least_ms"] > 0
        assert point["record_ms"] < point["python_ms"]
    assert small["ratios"]["side"] == "all features", (
        "the chapter as it is, which the others are compared with"
    )
    assert small["ratios"]["times"].keys() == {*names} - {"all features"}


@pytest.mark.feature("tools/bench")
def test_python_does_not_see_how_many_objects_there_are(subject):
    """The least of some frames, and the best of three tries: only what is always slower fails."""
    scale = Scale("draws", partial(crowd, materials=16), (), (10, 10_000, 100_000), (SIDES[0], SIDES[-1]))
    for _ in range(3):
        points = {(p["side"], p["count"]): p for p in measured(subject, scale, frames=3)["points"]}
        own = {count: points["all features", count] for count in scale.quick}
        grown = own[100_000]["python_least_ms"] / own[10]["python_least_ms"]
        other = points["chapter 1", 10_000]
        frames = other["python_least_ms"] / own[10_000]["python_least_ms"]
        recorded = other["record_least_ms"] / own[10_000]["record_least_ms"]
        if grown < 1.5 and frames > 15 and recorded > 50:
            break
    else:
        pytest.fail(
            f"x{grown:.2f} from 10 to 100,000; chapter 1 takes x{frames:.0f}, recording x{recorded:.0f}"
        )
    calls = [own[count]["work"]["draw_calls"] for count in scale.quick]
    assert calls[0] == calls[1] == calls[2]


def test_what_a_device_lacks_is_not_measured_twice(subject):
    class Bare:
        class capabilities:
            features = frozenset({"bindless"})

    assert bench_scale._why_not(Side(without=("bindless",)), 1, Bare) == ""
    assert bench_scale._why_not(Side(without=("multi-draw",)), 1, Bare).endswith("no multi-draw in any case")
    assert bench_scale._why_not(Side(most=10, why="it is slow"), 11, Bare) == "it is slow"
    assert bench_scale._why_not(Side(most=10, why="it is slow"), 10, Bare) == ""


def point(side, count, python, record=1.0, differ=0):
    """Return a point of a record."""
    times = {"python_ms": python, "record_ms": record, "gpu_ms": 2.0, "cpu_ms": python}
    noise = {f"{name}_noise_ms": 0.1 for name in bench_scale.TIMES}
    error = {"max_abs": 0.5 * differ, "pixels_differ": differ}
    return {"side": side, "count": count, **times, **noise, "error": error}


def test_ratios_hold_the_chapter_to_others_at_their_most_and_to_itself_at_its_least():
    points = [
        point("old", 1, 2.0),
        point("new", 1, 1.5),
        point("old", 10, 8.0, record=6.0),
        point("new", 10, 2.0, record=0.5),
        point("new", 100, 2.2),
    ]
    found = bench_scale.ratios(points, "new", 10)
    assert found["times"] == {"old": {"count": 10, "python_ms": 4.0, "record_ms": 12.0, "gpu_ms": 1.0}}
    assert (found["from"], found["grown"]) == (10, {"100": pytest.approx(1.1)})
    assert bench_scale.ratios(points, "new", 1)["grown"].keys() == {"10", "100"}
    assert bench_scale.ratios([point("new", 1, 0.0), point("new", 2, 1.0)], "new", 1)["grown"] == {
        "2": np.inf
    }


def test_a_side_can_be_the_chapter_with_other_knobs(subject, monkeypatch):
    side = Side(knobs=(("anisotropy", 1.0), ("color_format", "rgba32f")))
    assert side.name == "anisotropy=1.0, color_format=rgba32f"
    opened = []
    monkeypatch.setattr(bench_scale, "SLOW_S", 0.0)  # every point is slow
    monkeypatch.setattr(
        bench_scale._Run, "time_recording", lambda run: opened.append(run.renderer.settings.scene.anisotropy)
    )
    scale = Scale("draws", partial(crowd, materials=2), (), (3,), (Side(chapter=2), side))
    made = measured(subject, scale)
    assert opened == [4.0, 1.0] and made["frames"] == 1
    assert [point["side"] for point in made["points"]] == ["chapter 2", side.name]


def test_a_slow_point_gets_the_least_frames(subject, monkeypatch):
    taken = []
    frame = bench_scale._Run.frame
    monkeypatch.setattr(
        bench_scale._Run, "frame", lambda run, view: (taken.append(run.count), frame(run, view))[1]
    )
    monkeypatch.setattr(bench_scale, "LEAST_FRAMES", 2)
    monkeypatch.setattr(
        Settings, "SCALES", (Scale("draws", partial(crowd, materials=2), (), (3,), (Side(),)),)
    )
    for slow, frames in ((0.0, 2), (1e9, 5)):
        taken.clear()
        monkeypatch.setattr(bench_scale, "SLOW_S", slow)
        bench_scale.scales(subject, replace(SMALL, frames=5), lambda what, part: None)
        assert len(taken) == 2 + frames, "two before the measured ones"


def test_what_is_sent_again_as_it_was_takes_no_time_to_record():
    points = [point("old", 10, 8.0, record=6.0), point("new", 10, 2.0, record=0.0)]
    found = bench_scale.ratios(points, "new", 10)
    assert found["times"]["old"] == {"count": 10, "python_ms": 4.0, "record_ms": None, "gpu_ms": 1.0}
    first, second, *_ = bench_scale.sentences({"name": "draws", "points": points, "ratios": found})
    assert first == "At 10 draws, old takes 4 times the Python time of new for a frame."
    assert second == "With new no draw is recorded in these frames: what was recorded once is sent again."


def test_figures_become_sentences():
    points = [point("old", 10, 8.0), point("new", 10, 2.0), point("new", 1000, 1.0, differ=3)]
    made = {"name": "draws", "points": points, "ratios": bench_scale.ratios(points, "new", 10)}
    first, second, third = bench_scale.sentences(made)
    assert first.startswith("At 10 draws, old takes 4 times the Python time of new for a frame")
    assert "From 10 to 1,000 draws" in second and "-50.0%" in second
    assert third == "The pictures differ: new at 1,000 draws by up to 1.5 in 3 pixels."


def test_a_chapter_that_is_measured_at_every_count_is_compared_at_every_count():
    points = []
    for count, more in ((10, 0.02), (100, 0.01), (1000, -0.5)):
        least = {"python_least_ms": 1.0}
        points += [point("chapter 5", count, 2.0) | least, point("new", count, 2.0 + more) | least]
    made = {"name": "draws", "points": points, "ratios": bench_scale.ratios(points, "new", 10)}
    (said,) = [line for line in bench_scale.sentences(made) if "more Python time" in line]
    assert said.startswith(
        "From 10 to 1,000 draws, a frame with new takes +0.010 ms more Python time than with chapter 5"
    )
    assert "at most +0.020 ms (at 10; of the quickest frames +0.000 ms)" in said
    made["points"] = points[1:]
    assert not [line for line in bench_scale.sentences(made) if "more Python time" in line]


def test_a_difference_of_the_last_bit_is_seen():
    image = np.ones((2, 3, 3), np.float32)
    other = image.copy()
    other[1, 2, 0] = np.nextafter(np.float32(1), np.float32(2))
    assert difference(image, image.copy()) == {"max_abs": 0.0, "pixels_differ": 0}
    assert difference(image, other)["pixels_differ"] == 1


# --- pipelines --------------------------------------------------------------------------------------------------------


def test_a_start_times_the_drivers_calls_first_and_again(subject, tmp_path, monkeypatch):
    monkeypatch.setattr(Settings, "PIPELINES", staticmethod(lambda: crowd(1, 1)))
    picture = tmp_path / "picture.npy"
    found = pipelines.once(2, (8, 8), picture)
    assert found["pipelines"] == 2  # one kind of material, and the mip levels of its picture
    assert min(found["first"], found["again"]) > 0
    assert found["cache_bytes"] >= pipelines.HEADER_BYTES
    assert np.load(picture).shape == (8, 8, 3)


def test_states_are_processes_of_their_own_with_caches_of_their_own(monkeypatch):
    seen = []

    class Run:
        returncode = 0
        stderr = ""

        def __init__(self, words, env, **more):
            kept = Path(env["STRATA_CACHE"]) / "pipelines"
            driver = Path(env["MESA_SHADER_CACHE_DIR"])
            assert (env["MESA_SHADER_CACHE_DISABLE"], env["__GL_SHADER_DISK_CACHE"]) == ("true", "0")
            assert env["__GL_SHADER_DISK_CACHE_PATH"] == str(driver) and not list(driver.iterdir())
            (driver / "kept by the driver").touch()
            warm = kept.is_dir()
            kept.mkdir(parents=True, exist_ok=True)
            seen.append("warm" if warm else "cold")
            if words[-1].endswith(".npy"):
                np.save(words[-1], np.ones((2, 2, 3), np.float32))
            first = 20.0 if not warm else 5.0
            self.stdout = json.dumps(
                {"first": first, "again": 2.0, "pipelines": 8, "cache_bytes": 999, "loaded_bytes": 999 * warm}
            )

    monkeypatch.setattr(pipelines.subprocess, "run", Run)
    made = pipelines.measure(2, (8, 8), QUICK, lambda what, part: None)
    assert seen == ["cold"] + ["cold", "warm"] * pipelines.LEAST_STARTS + ["cold", "warm"]
    assert {state: one["times_faster"] for state, one in made["states"].items()} == {
        "cold": 1.0,
        "memory": 10.0,
        "disk": 4.0,
    }
    assert made["error"] == {"max_abs": 0.0, "pixels_differ": 0}
    assert "4.0 times faster than cold" in " ".join(pipelines.sentences(made))
    empty = " ".join(pipelines.sentences({**made, "cache_bytes": 32}))
    assert "keeps nothing in a pipeline cache" in empty and "times faster" not in empty


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("2", "--only", "pipelnes"), "did you mean 'pipelines'?"),
        (("1", "--only", "scales"), "chapter 1 names none in its settings"),
        (("2", "--only", "start", "--record"), "leave out --only, or --record"),
        (("2", "--only", "stability", "--quick", "--plot", "a.png"), "there is nothing to draw"),
    ],
)
def test_a_part_that_cannot_be_measured_is_one_sentence(words, said, strata, monkeypatch):
    monkeypatch.setattr(bench, "measure", lambda *_: pytest.fail("it was measured"))
    code, _, err = strata("bench", *words)
    assert code == 2 and said in err and "Traceback" not in err


def test_opengl_has_no_pipelines_to_build():
    assert "pipelines" not in bench.parts_of(2, "gl")
    assert bench.parts_of(max(available()), "vulkan") == tuple(bench.PARTS)
    with pytest.raises(UserError, match="no pipeline objects"):
        bench.parts_of(2, "gl", ["pipelines"])


def test_one_part_alone_is_measured_written_shown_and_drawn(small, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench_scale, "scales", lambda *_: [small])
    words = [
        "bench",
        "2",
        "--quick",
        "--only",
        "scales",
        "--scene",
        "cornell",
        "--json",
        str(tmp_path / "a.json"),
    ]
    words += ["--plot", str(tmp_path / "a.png")] if report.can_plot() else []
    assert invoke(words) == 0
    record = bench.read_record(tmp_path / "a.json")
    assert record["parts"] == ["scales"]
    assert (record["points"], record["prepared"], record["start_s"]) == ([], [], {})
    assert record["pipelines"] is None and record["stability"] is None
    assert record["scales"] == [small]
    shown = capsys.readouterr().out
    assert "Python ms a frame by number of draws" in shown
    assert "all pictures are the same to the bit" in " ".join(shown.split())
    assert "Not measured: chapter 1 at 200" in shown
    if report.can_plot():
        assert (tmp_path / "a.png").stat().st_size > 1000


def test_the_tables_fit_a_narrow_terminal(small):
    console = Console(width=60, record=True)
    bench_scale.show(small, console)
    assert max(map(len, console.export_text().splitlines()[:8])) <= 60
