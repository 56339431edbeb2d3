"""What a bench says of recording by threads: measured small, and the sentences for figures made up."""

from __future__ import annotations

from contextlib import ExitStack

import pytest
from rich.console import Console

import chapters
from common.reports.benches import Effort
from tools.bench import threads as bench_threads
from tools.bench.points import Subject
from tools.run.run import open_device

SMALL = Effort(1, 1, 1, 1, 1, everything=False)


@pytest.mark.parametrize(("chapter", "fullscreen"), [(3, 1), (4, 2)])
def test_every_number_of_threads_is_measured_and_draws_the_same(
    vulkan_instance, monkeypatch, chapter, fullscreen
):
    """Chapter 3 runs its passes one by one; in chapter 4 a graph does, and would send its frames again."""
    monkeypatch.setattr(chapters.settings_class(chapter), "THREADS", (0, 2))
    monkeypatch.setattr(bench_threads, "LEAST_FRAMES", 2)
    with ExitStack() as stack:
        device = open_device(stack, "vulkan")
        subject = Subject(chapter, "vulkan", None, (16, 16), device)  # type: ignore[arg-type]
        made = bench_threads.measure(subject, SMALL, lambda what, part: None, draws=(600,))
    assert made is not None and made["frames"] >= 2
    alone, shared = made["points"]
    assert (alone["threads"], alone["parts"]) == (0, 0)
    assert (shared["threads"], shared["parts"]) == (2, 600 // 256)
    assert alone["draw_calls"] == shared["draw_calls"] == 600 + fullscreen
    for point in made["points"]:
        assert 0 < point["record_ms"] < point["cpu_ms"] and point["error"]["pixels_differ"] == 0


def test_a_chapter_without_threads_has_nothing_to_measure():
    assert bench_threads.measure(Subject(2, "vulkan", None, (8, 8), None), SMALL, print) is None  # type: ignore[arg-type]


def made_up(draws: int, threads: int, record_ms: float, differ: int = 0) -> dict[str, object]:
    """Return a point."""
    times = {"record_ms": record_ms, "cpu_ms": record_ms + 1, "record_noise_ms": 0.1, "cpu_noise_ms": 0.1}
    error = {"pixels_differ": differ, "max_abs": 0.5}
    return {"draws": draws, "threads": threads, "parts": 3, "draw_calls": draws, "error": error, **times}


def test_the_figures_are_said_in_ratios_and_a_difference_is_not_kept_back(capsys):
    points = [made_up(1000, 0, 2.0), made_up(1000, 4, 1.0), made_up(10_000, 0, 10.0)]
    points += [made_up(10_000, 1, 13.0), made_up(10_000, 4, 15.0)]
    first, second = bench_threads.sentences({"points": points})
    assert "At 10,000 draws the best number of threads beside the renderer's, 1, takes 1.30 times" in first
    assert "a call takes 1.00 us" in first and "same to the bit" in second
    points.append(made_up(10_000, 2, 99.0, differ=7))
    assert "with 2 threads in 7 pixels" in bench_threads.sentences({"points": points})[1]
    bench_threads.show({"points": points}, Console(width=100))
    shown = capsys.readouterr().out
    assert "1 + 4" in shown and "1.50" in shown and "0.50" in shown
