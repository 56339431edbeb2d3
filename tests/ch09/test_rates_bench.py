"""The benches of shading rates and constants: what they find is of the right size, and tables and figures say it."""

from __future__ import annotations

import json
from importlib import import_module

import numpy as np
import pytest

from chapters.ch09.benches import constants, pass_times, rates
from chapters.ch09.rates.model import encode
from common.errors import UserError
from common.reports.benches import Effort
from tests.support.bench_views import drawn, shown
from tests.support.packages import BACKENDS
from tests.support.scenes import quad_scene
from tests.support.shadows import point, sun, yard
from tools.bench import bench, figures
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)
SIZE = (64, 48)  # whole texels and whole blocks
VULKAN, GL = BACKENDS
DRIVEN = (VULKAN, pytest.param(*GL.values, marks=[*GL.marks, pytest.mark.long]))
"""A bench drives what the tests of rates draw with both, so OpenGL is measured with --long alone."""

pytestmark = pytest.mark.feature("tools/bench")


def measured(request, module, **patched):
    """Return what a reader of the JSON gets of a bench's quick look at a yard with a sun and a lamp."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    scene = yard(sun((0.5, -1.0, 0.3)), point((-1.2, 3.0, 0.8)))
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Subject, "load", lambda self, name, around="none": scene)
        for name, value in patched.items():
            patch.setattr(module, name, value)
        subject = Subject(9, request.param, scene, SIZE, device)
        record = module.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and 0.0 <= told[-1] < 1.0
    return json.loads(json.dumps(record, allow_nan=False))


# --- rates ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def lit_by_compute(request):
    return measured(request, rates, WAYS={"compute": rates.WAYS["compute"]})


@pytest.fixture(scope="module", params=DRIVEN)
def lit_by_fragments(request):
    """Return the record of two passes, and of a device's own rates where there is one that has them."""
    return measured(request, rates, WAYS={way: rates.WAYS[way] for way in ("passes", "device")})


def check_rates(record):
    """Hold shares and errors to what each row is."""
    rows = {(row["way"], row["name"]): row for row in record["rows"]}
    assert record["size"] == list(SIZE) and (record["turn"], record["left_out"]) == (8, [])
    flips = all(row["flip"] is not None for row in record["rows"])
    for way in {way for way, _ in rows}:
        full = rows[way, rates.FULL]
        assert (full["share"], full["pixels_differ"]) == (1.0, 0.0) and full["times"] in (1.0, None)
        assert full["flip"] == (0.0 if flips else None) and full["mask_ms"] == full["edges_ms"] == 0.0
        for name, share in (("all coarse", 1 / 4), ("all coarse, 4x4", 1 / 16)):
            assert rows[way, name]["share"] == share and rows[way, name]["pixels_differ"] > 0.05
        sobel = rows[way, "sobel 0.1/0.1"]
        # The turns alone: an eighth of the texels is lit in full.
        assert 1 / 4 + 3 / 4 / 8 - 1e-9 <= sobel["share"] < 1.0
        assert sobel["pixels_differ"] < 0.05
        if flips:
            assert (
                sobel["flip"] < 0.01 < rows[way, "all coarse"]["flip"] < rows[way, "all coarse, 4x4"]["flip"]
            )


@pytest.mark.feature("vrs/software", "vrs/rate-policies")
def test_shares_and_errors_by_compute_are_those_of_the_rates(lit_by_compute):
    check_rates(lit_by_compute)
    assert all(row["counted"] is None for row in lit_by_compute["rows"])  # there are no fragments


@pytest.mark.feature("vrs/rate-policies")
def test_shares_and_errors_by_fragments_are_those_of_the_rates_and_counted(lit_by_fragments):
    """A rasteriser that runs quads of 2x2 fragments where fewer pass would count more of them, and never fewer."""
    check_rates(lit_by_fragments)
    for row in lit_by_fragments["rows"]:
        if row["counted"] is not None:
            assert row["counted_mask"] * (1 - 1e-9) <= row["counted"] <= 1.0 + 1e-9


def test_times_are_sums_of_their_passes(lit_by_compute):
    for row in lit_by_compute["rows"]:
        assert row["ms"] == pytest.approx(sum(row[f"{name}_ms"] for name in rates.GROUPS))
        assert all(row[f"{name}_ms"] >= 0.0 <= row[f"{name}_noise_ms"] for name in rates.GROUPS)
        if row["ms"]:  # the clock of a busy machine may find none of these short times
            assert row["times"] == pytest.approx(lit_by_compute["rows"][0]["ms"] / row["ms"])
        else:
            assert row["times"] is row["times_noise"] is None
        if row["settings"]["rate_policy"] != "sobel":
            assert row["edges_ms"] == 0.0


@pytest.fixture(scope="module", params=DRIVEN)
def stamped(request):
    """Return the record of a device that is taken to be none in software: it is measured by timestamps."""
    ways = {"passes": rates.WAYS["passes"]}
    return measured(request, rates, WAYS=ways, FEW=rates.FEW[:1], is_software=lambda subject: False)


def test_timestamps_are_those_of_frames_that_nothing_looks_into(stamped):
    full, sobel = stamped["rows"]
    assert not stamped["clock"] and (full["name"], sobel["name"]) == (rates.FULL, "sobel 0.1/0.1")
    assert full["mask_ms"] == full["edges_ms"] == 0.0 < full["light_ms"] and full["times"] == 1.0
    assert min(sobel[f"{name}_ms"] for name in rates.GROUPS) > 0.0
    assert "on the GPU" in shown(rates, stamped)


@pytest.mark.needs("matplotlib")
def test_the_table_says_all_rows_and_the_plot_has_a_line_for_each_way(lit_by_fragments):
    rated = lit_by_fragments
    text = shown(rates, rated)
    assert all(row["name"] in text and row["way"] in text for row in rated["rows"])
    assert "means over the 8 frames of a turn" in text and "counts the fragments" in text
    ways = dict.fromkeys(row["way"] for row in rated["rows"])
    assert drawn(rates, rated) == [f"atrium, {way}" for way in ways]
    assert len(dict(figures.PARTS["rates"]({"rates": rated}))) == len(rated["rows"])


@pytest.mark.parametrize(
    ("codes", "size", "truth"),
    [
        ([[0]], (16, 16), 256),
        ([[encode(2, 2)]], (16, 16), 64),
        ([[encode(4, 2)]], (16, 16), 32),
        ([[encode(4, 4)]], (5, 3), 2),  # two blocks across, both cut
        ([[0, encode(2, 2)], [encode(4, 4), 0]], (20, 18), 256 + 2 * 8 + 4 * 1 + 4 * 2),
    ],
)
@pytest.mark.feature("vrs/rate-encoding")
@pytest.mark.runs_on("vulkan", "gl")
def test_blocks_of_a_mask_are_counted_to_the_edge_of_the_picture(codes, size, truth):
    assert rates.invocations(np.array(codes), (16, 16), size) == truth


def test_rows_have_names_of_their_own_and_known_knobs():
    for rows in (rates.ROWS, rates.FEW):
        assert len(dict(rows)) == len(rows)
    assert {name for name, _ in rates.FEW} <= {name for name, _ in rates.ROWS}
    values = [values for name, values in rates.ROWS if name.startswith("sobel") and "4x4" not in name]
    pairs = {(one["rate_threshold"], one["rate_surface"]) for one in values}
    assert pairs == {(edge, surface) for edge in (0.03, 0.1, 0.3, 1.0) for surface in (0.1, 0.3)}
    assert {values.get("rate_radius") for _, values in rates.ROWS} == {None, 0.0, 0.3, 0.6}


def test_the_time_of_a_pass_on_a_software_driver_is_what_more_of_it_takes(monkeypatch):
    """A frame of 5 ms, of which the pass takes 3, and each recording of it anew 7 ms more in the first frame."""
    now = [0.0]
    monkeypatch.setattr(pass_times.clock, "perf_counter", lambda: now[0])

    class Pass:
        name = "lighting"

        def record(self, commands):
            now[0] += 3e-3

    class Renderer:
        def __init__(self):
            self.passes, self._frames, self.fresh = [Pass()], self, True

        def forget(self):
            self.fresh = True

        def render(self, view):
            now[0] += 2e-3 + 7e-3 * self.fresh
            self.fresh = False
            self.passes[0].record(None)
            return self

        timings = ()

    groups = {"light": ("light",), "none": ("mask",)}
    views = iter(range(100))
    found = pass_times.times_of(Renderer(), views, groups, 3, software=True)
    assert found == {"light": (pytest.approx(3.0), pytest.approx(0.0, abs=1e-9)), "none": (0.0, 0.0)}


# --- constants --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def constant(request):
    return measured(request, constants, QUICK_BUILDS=2)


@pytest.mark.feature("specialization/pipeline-constants")
@pytest.mark.needs("matplotlib")
def test_each_way_to_loop_is_measured_and_shown(constant):
    found = {(row["taps"], row["way"]) for row in constant["loops"]}
    assert found == {(taps, way) for taps in constants.TAPS for way in constants.WAYS}
    assert len(constant["loops"]) == len(found) and all(row["ms"] >= 0.0 for row in constant["loops"])
    assert [row["way"] for row in constant["builds"]] == list(constants.CONSTANTS)
    assert all(row["ms"] > 0.0 and row["pipelines"] == 2 for row in constant["builds"])
    record, loop, steps = constant["frames"]
    assert (record["pixels_differ"], loop["pixels_differ"], steps["pixels_differ"]) == (None, 0, None)
    assert (record["pass"], loop["pass"], steps["pass"]) == ("lighting", "lighting", "ssao")
    text = shown(constants, constant)
    assert all(f"{row['name']}" in text for row in constant["frames"]) and "with a define" in text
    assert drawn(constants, constant) == ["specialization", "define"]
    many = len(constants.TAPS) * 3 + 2 + 3
    assert len(dict(figures.PARTS["constants"]({"constants": constant}))) == many


# --- both -------------------------------------------------------------------------------------------------------------


def test_a_chapter_without_rates_has_no_such_parts():
    subject = Subject(8, "vulkan", quad_scene(), (8, 8), None)
    for name in bench.RATES.values():
        module = import_module(f"chapters.ch09.benches.{name}")
        assert module.measure(subject, SMALL, lambda what, part: None) is None
    assert not set(bench.RATES) & set(bench.parts_of(8, "vulkan"))
    for api in ("vulkan", "gl"):
        assert set(bench.RATES) <= set(bench.parts_of(9, api))
    assert all(dict(figures.PARTS[part]({})) == {} for part in bench.RATES)


@pytest.mark.parametrize(
    ("which", "part", "said"),
    [(9, "rate", "a bench has no such part"), (8, "rates", "there is nothing to measure, since chapter 8")],
)
def test_a_wrong_part_is_one_sentence(which, part, said):
    with pytest.raises(UserError, match=said) as raised:
        bench.run(which, backend="vulkan", only=[part])
    sentence = str(raised.value)
    assert sentence.startswith(f"--only {part}: ") and sentence.count(". ") == 0 and "\n" not in sentence
    assert part != "rate" or "rates" in sentence  # the nearest one is named
