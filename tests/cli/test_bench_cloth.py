"""What a bench says of cloth, of queues and of pacing: measured small, and of figures made up."""

from __future__ import annotations

import json
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from backends.vulkan.device import Device
from chapters import scenes
from chapters.ch05.benches import async_compute
from chapters.ch05.benches import cloth as bench_cloth
from chapters.ch05.benches import drift as bench_drift
from chapters.ch05.benches import executions as bench_executions
from chapters.ch05.benches import pacing as bench_pacing
from chapters.ch05.benches.sheet import level_sheet, medium_of, opened, states, timed_step
from common.errors import UserError
from common.reports.benches import Effort
from tools.bench import bench, report
from tools.bench.points import Subject
from tools.run.run import open_device

SMALL = Effort(1, 1, 1, 1, 1, everything=False)
TINY = bench_cloth.Sweep(edge=4, steps=4, numbers=(8,), truth=32)
PARTS = ("cloth", "drift", "async", "pacing")


@pytest.fixture(scope="module")
def subject(vulkan_instance):
    """A scene without cloth, small, on a device of its own."""
    with ExitStack() as stack:
        device = open_device(stack, "vulkan")
        yield Subject(5, "vulkan", scenes.load("cornell"), (16, 8), device)


def nothing(what, part):
    """Report nothing."""


@contextmanager
def progress():
    """Give a callback for progress; at the end, assert that it never fell and stayed within 0 and 1."""
    told = []
    yield lambda what, part: told.append(part)
    assert told and told == sorted(told) and told[0] >= 0.0 and told[-1] <= 1.0, told


def strict(made):
    """Return what a reader of the JSON gets, that knows no NaN."""
    return json.loads(json.dumps(made, allow_nan=False))


@pytest.fixture(scope="module")
def cloth(subject):
    """The part `cloth`, of a few particles for a few steps."""
    with pytest.MonkeyPatch.context() as patch, progress() as step:
        patch.setattr(bench_executions, "QUICK_EDGES", (3,))
        patch.setattr(bench_executions, "STEPS", 2)
        return strict(bench_cloth.measure(subject, SMALL, step, TINY))


@pytest.fixture(scope="module")
def drift(subject):
    """The part `drift`, of a few substeps."""
    with progress() as step:
        return strict(bench_drift.measure(subject, SMALL, step, substeps=150))


@pytest.fixture(scope="module")
def pacing(subject):
    """The part `pacing`, of a few frames."""
    with pytest.MonkeyPatch.context() as patch, progress() as step:
        patch.setattr(bench_pacing, "QUICK_FRAMES", 3)
        patch.setattr(bench_pacing, "WARM_UP", 2)
        return strict(bench_pacing.measure(subject, SMALL, step))


# --- measured ---------------------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench")
def test_every_way_to_cut_a_step_has_its_time_and_error(cloth):
    assert cloth["particles"] == 16 and cloth["seconds"] == pytest.approx(4 / 60)
    assert [one["kind"] for one in cloth["points"]] == list(bench_cloth.KINDS)
    for one in cloth["points"]:
        assert one["gpu_ms"] > 0 and one["noise_ms"] >= 0
        assert 0 < one["rms_m"] <= one["greatest_m"] < 0.05
        assert 0 < one["stretch"] < 1
    small, many = cloth["points"][:2]
    assert (small["substeps"], small["iterations"], many["substeps"], many["iterations"]) == (8, 1, 1, 8)
    assert small["rms_m"] < many["rms_m"]
    executions = cloth["executions"]
    assert executions["same"] and executions["goes_over"] == 1024
    assert [(one["execution"], one["particles"]) for one in executions["points"]] == [
        (name, 9) for name in bench_executions.EXECUTIONS
    ]


def test_errors_are_those_of_the_states_that_the_gpu_came_to(subject):
    """The twin with the steps of the run, in float32, is where the GPU is: so errors to the truth are its own, too."""
    with opened(subject, level_sheet(4), medium_of(subject, cloth_substeps=2)) as renderer:
        for number in range(4):
            timed_step(subject, renderer, number, 1 / 60)
        (state,) = states(renderer)
        with pytest.raises(AssertionError, match="made 2 steps"):
            timed_step(subject, renderer, 5, 1 / 60)
    sheet, truth = bench_cloth._truth(
        subject, level_sheet(4), replace(TINY, truth=2), 1 / 60, lambda part: None
    )
    from chapters.ch05.benches.twin import Twin
    from chapters.ch05.cloth.types import Steps

    twin = Twin(sheet, Steps(substeps=2), dtype=np.float32).advance(3)
    assert np.abs(twin.positions - state.positions).max() < 1e-6
    assert len(truth) == bench_cloth.READINGS and not np.array_equal(truth[0].positions, truth[-1].positions)


@pytest.mark.feature("tools/bench")
def test_left_alone_springs_keep_their_energy_and_xpbd_loses_it(drift):
    points = {(one["name"], one["h_omega"], one["precision"]): one for one in drift["points"]}
    assert points["euler", 0.02, "float32"]["strays"] < 0.01
    assert points["verlet", 0.2, "float32"]["strays"] < 0.01
    assert (
        points["XPBD", 2.0, "float32"]["energy_last"] < points["XPBD", 0.2, "float32"]["energy_last"] < 0.99
    )
    for one in drift["points"]:
        assert one["curve"][-1][0] <= one["substeps"] and one["curve"][-1][1] > 0
        assert 0 < one["stretch_rms"] <= one["stretch_greatest"]


@pytest.mark.feature("tools/bench")
def test_pacing_is_told_for_each_way(pacing):
    assert [one["way"] for one in pacing] == ["timelines", "timelines-1.2", "fences"]
    assert "with timelines (at best" in bench_pacing.sentence(pacing)


@pytest.mark.feature("tools/bench")
def test_without_a_family_for_compute_the_record_says_so(subject, monkeypatch):
    monkeypatch.setattr(subject.device, "compute_queue", None)
    made = strict(async_compute.measure(subject, SMALL, nothing))
    assert made["family"] is False and made["why"] and made["scenes"] == []
    assert async_compute.sentences(made) == [f"Nothing runs beside drawing here: {made['why']}."]


def test_frames_with_the_setting_on_and_off_are_the_same(subject, monkeypatch):
    """With the device's own queue in the place of one for compute: all is done but running beside."""
    if subject.device.compute_queue is None:
        monkeypatch.setattr(subject.device, "compute_queue", subject.device.queue)
    assert isinstance(subject.device, Device)
    drawn = Subject(5, "vulkan", level_sheet(6), (16, 8), subject.device)
    monkeypatch.setattr(async_compute, "STAMPED", 2)
    # One queue has one name, and so its stamps are of no use but to be taken.
    assert (
        not async_compute.clocks_agree(subject.device)
        or subject.device.compute_queue is not subject.device.queue
    )
    monkeypatch.setattr(async_compute, "clocks_agree", lambda device: True)
    one = strict(async_compute.frames_of(drawn, SMALL, nothing, balanced=True, frames=3))
    assert one["error"] == {"max_abs": 0.0, "pixels_differ": 0}
    assert 1 <= one["substeps"] <= async_compute.MOST_SUBSTEPS
    assert one["ratio"] == pytest.approx(one["off"]["frame_ms"] / one["on"]["frame_ms"])
    assert one["stamps"] is None or one["stamps"]["submissions"] >= 4  # warm-up, frames, and those alone
    for run in (one["on"], one["off"]):
        assert run["frame_ms"] > 0 and run["drawing_ms"] > 0 and run["compute_ms"] > 0


def test_the_large_sheet_hangs_in_the_building(subject, monkeypatch):
    from chapters.ch05.cloth.scene import cloth_scene

    monkeypatch.setattr(scenes, "load", lambda name, around: subject.scene)  # the atrium takes a second
    scene = async_compute.building_with_sheet(subject, 12)
    (sheet,) = cloth_scene(scene).cloths
    assert len(scene.instances) == len(subject.scene.instances) + 1
    places = sheet.positions + sheet.anchor
    assert len(places) == 144 and np.allclose(np.ptp(places, axis=0), (4, 0, 4))
    assert np.allclose(places[:, 1], 6)


def test_a_chapter_without_cloth_has_none_of_these_parts(subject):
    assert set(PARTS) <= set(bench.parts_of(5, "vulkan")) and not set(PARTS) & set(
        bench.parts_of(4, "vulkan")
    )
    assert {"cloth", "drift"} == set(PARTS) & set(bench.parts_of(5, "gl"))
    with pytest.raises(UserError, match=r"chapter 4 names none in its settings \(cloth_method\)"):
        bench.parts_of(4, "vulkan", ["drift"])
    with pytest.raises(UserError, match="OpenGL has one queue"):
        bench.parts_of(5, "gl", ["async"])
    older = Subject(4, "vulkan", subject.scene, (16, 8), subject.device)
    for part in (bench_cloth, bench_drift, async_compute, bench_pacing):
        assert part.measure(older, SMALL, nothing) is None


# --- what is said -----------------------------------------------------------------------------------------------------


def queues(on_ms, off_ms, **more):
    """Return the part `async`."""
    rows = {
        name: {"frame_ms": took, "noise_ms": 0.1, "cpu_ms": 0.5, "drawing_ms": 3.0, "compute_ms": 2.0}
        for name, took in (("on", on_ms), ("off", off_ms))
    }
    error = {"max_abs": 0.0, "pixels_differ": 0}
    scene = {
        "scene": "a",
        "substeps": 8,
        **rows,
        "ratio": off_ms / on_ms,
        "error": error,
        "stamps": None,
        **more,
    }
    return {"family": True, "why": "", "size": [4, 4], "scenes": [scene]}


def test_what_a_queue_of_its_own_spares():
    first, second = async_compute.sentences(queues(4.0, 5.0))
    assert "takes 0.80 times as long" in first and "+1.000 ms are spared of the 2.000 ms" in first
    assert "noise" not in first and "same to the bit" in second
    (slower, _) = async_compute.sentences(queues(5.1, 5.0))
    assert "takes 1.02 times as long" in slower and "within the noise" in slower
    stamps = {"submissions": 12, "compute_ms": 24.0, "both_ms": 20.0}
    (told, _) = async_compute.sentences(queues(4.0, 5.0, stamps=stamps))
    assert "for 24.00 ms, and for 20.00 ms of it drawing" in told
    bound = queues(4.0, 5.0)
    bound["scenes"][0]["on"]["cpu_ms"] = 3.9
    bound["scenes"][0]["error"]["pixels_differ"] = 2
    first, second = async_compute.sentences(bound)
    assert "the GPU waits for it" in first and "differ" in second


def test_a_dispatch_pays_from_where_it_pays_for_good():
    times = {64: (2.0, 1.0), 256: (2.0, 3.0), 1024: (4.0, 3.0), 4096: (9.0, 3.0)}  # at 64 by chance
    points = [
        {"execution": name, "particles": count, "gpu_ms": took, "noise_ms": 0.1}
        for count, both in times.items()
        for name, took in zip(("group", "dispatch"), both, strict=True)
    ]
    made = {"substeps": 8, "goes_over": 4096, "same": True, "points": points}
    first, second = bench_executions.sentences(made)
    assert "from 1,024 particles on; the chapter goes over beyond 4,096" in first and "same bits" in second
    made["points"] = points[:4]
    assert "not faster than a work group with 256" in bench_executions.sentences(made)[0]


def test_tables_and_panels_show_every_part(cloth, drift, pacing, capsys):
    made = {"cloth": cloth, "drift": drift, "async": queues(4.0, 5.0), "pacing": pacing}
    for part in PARTS:
        report.shows(part).show(made[part], Console(width=100))
    said = capsys.readouterr().out
    for word in ("XPBD, iterations", "dispatch", "euler", "float64", "queues", "fences", "spared"):
        assert word in said
    if report.can_plot():
        from matplotlib.figure import Figure

        drawn = [(report.shows(part), made[part]) for part in PARTS]
        for shown, one in (*drawn, (bench_executions, cloth["executions"])):
            axes = Figure().add_subplot()
            shown.plot(axes, one)
            assert axes.get_title() and axes.get_ylabel() and axes.get_legend() is not None
        axes = Figure().add_subplot()
        async_compute.plot(axes, {"family": False, "why": "there is one queue", "size": [4, 4], "scenes": []})
        assert axes.texts[0].get_text() == "there is one queue"
