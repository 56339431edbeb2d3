"""`strata bench --compare`: what is worse beyond noise is named, and nothing else is; records are built by hand."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path

import pytest

from common.paths import ROOT
from tools.bench import bench, compare, compare_show
from tools.bench.figures import Figure, figures

DEVICE = {"name": "a card", "driver": "driver 1", "class": "discrete", "api_version": "1.3"}


def point(name="medium", gpu=10.0, noise=0.1, **more):
    """Return a preset's point of a record, with a pass that takes most of its time."""
    return {
        "name": name,
        "kind": "preset",
        "front": True,
        "settings": {},
        "gpu_ms": gpu,
        "noise_ms": noise,
        "wall_ms": 12.0,
        "wall_noise_ms": 0.1,
        "cpu_ms": 1.0,
        "cpu_noise_ms": 0.01,
        "passes_ms": {"forward": gpu - 1.0, "tonemap": 1.0},
        "error": {"relative_mse": 0.05, "max_abs": 0.5, "flip": 0.07},
        "work": {"draws": 470, "samples": 1},
        **more,
    }


def made(*points, **more):
    """Return a record of chapter 1 with these points."""
    return {
        "format": bench.FORMAT,
        "chapter": 1,
        "backend": "vulkan",
        "device": DEVICE,
        "system": "Linux x86_64, 2 CPUs",
        "python": "3.12.3",
        "load_before": 0.1,
        "commit": "0123456789ab",
        "date": "2026-01-02T03:04:05+00:00",
        "scene": {"name": "atrium", "instances": 1, "triangles": 2},
        "size": [64, 36],
        "reference": {"preset": "reference", "samples_per_pixel": 16},
        "points": list(points or [point()]),
        "prepared": [],
        "start_s": {},
        "stability": None,
        "rounds": 7,
        "quick": False,
        **more,
    }


def verdicts(old, new, only=()):
    """Return {figure's name: verdict} of what changed."""
    return {one.key[2]: one.verdict for one in compare.compare(old, new, only).changes}


@pytest.fixture
def files(tmp_path):
    """Write two records and return their paths: files(old, new)."""

    def write(*records):
        paths = [tmp_path / name for name in ("old.json", "new.json")]
        for path, one in zip(paths, records, strict=True):
            path.write_text(one if isinstance(one, str) else json.dumps(one), "utf-8")
        return paths

    return write


# --- noise ------------------------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench")
@pytest.mark.parametrize(
    ("gpu", "noise", "verdict"),
    [
        (10.0, 0.1, ""),
        (10.4, 0.0, ""),  # 4 %: clocks drift so far, however still each run was
        (10.59, 0.1, "worse"),  # 0.59 > 3 * (0.05 + 0.1), and more than 5 %
        (10.59, 0.2, ""),  # 0.59 < 3 * (0.05 + 0.2)
        (14.0, 1.4, ""),  # 40 %, and less than what this run alone tells of itself
        (9.0, 0.05, "better"),
        (9.6, 0.0, ""),
    ],
)
def test_a_time_counts_only_beyond_the_noise_of_both_records(gpu, noise, verdict):
    old, new = made(point(noise=0.05)), made(point(gpu=gpu, noise=noise))
    assert verdicts(old, new) == ({"gpu_ms": verdict} if verdict else {})
    opposite = {"worse": "better", "better": "worse"}
    assert verdicts(new, old) == ({"gpu_ms": opposite[verdict]} if verdict else {})


@pytest.mark.feature("tools/bench")
def test_swapped_files_swap_worse_and_better():
    error = {"relative_mse": 0.06, "max_abs": 0.5, "flip": 0.05}
    old, new = made(), made(point(gpu=20.0, error=error, work={"draws": 471, "samples": 4}))
    there, back = verdicts(old, new), verdicts(new, old)
    assert there == {
        "gpu_ms": "worse",
        "relative_mse": "worse",
        "flip": "better",
        "draws": "worse",
        "samples": "other",
    }
    opposite = {"worse": "better", "better": "worse", "other": "other"}
    assert back == {name: opposite[verdict] for name, verdict in there.items()}
    assert verdicts(old, copy.deepcopy(old)) == {}


def test_a_busy_machine_that_leaves_the_quickest_frame_alone_is_no_regression():
    old = made(point(least_ms=9.5))
    assert verdicts(old, made(point(gpu=20.0, least_ms=9.6))) == {}
    assert verdicts(old, made(point(gpu=20.0, least_ms=15.0))) == {"gpu_ms": "worse"}
    assert verdicts(old, made(point(gpu=20.0))) == {"gpu_ms": "worse"}  # a record that does not say it


def test_a_quick_look_has_to_move_further():
    for gpu, verdict in ((12.0, {}), (13.0, {"gpu_ms": "worse"})):
        assert verdicts(made(), made(point(gpu=gpu), quick=True)) == verdict


def test_a_time_without_a_noise_has_to_move_furthest():
    for seconds, verdict in ((2.9, {}), (3.1, {"total_s": "worse"}), (1.3, {"total_s": "better"})):
        old = made(start_s={"cold": {"import": 1.0, "total": 2.0, "shaders_compiled": 3}})
        new = made(start_s={"cold": {"import": 1.0, "total": seconds, "shaders_compiled": 3}})
        assert verdicts(old, new) == verdict


@pytest.mark.parametrize(
    ("old", "new", "verdict"),
    [
        (1.0, math.nan, "worse"),
        (1.0, math.inf, "worse"),
        (math.nan, 1.0, "better"),
        (math.nan, math.nan, ""),
        (math.inf, math.nan, ""),
        (0.0, 1e-9, "worse"),  # what was the same to the bit
        (0.0, 0.0, ""),
    ],
)
def test_no_number_is_worse_than_any(old, new, verdict):
    assert compare.judged(Figure("error", old), Figure("error", new)) == verdict
    if old:
        times = (Figure("time", old, 0.1), Figure("time", new, 0.1))
        assert compare.judged(*times) == verdict


def test_errors_move_by_the_last_bit_of_a_format_and_one_code_of_one_pixel():
    for name, value, worse in (
        ("relative_mse", 0.0504, False),
        ("relative_mse", 0.0506, True),
        ("max_abs", 0.1 + 1 / 255, False),
        ("max_abs", 0.1 + 2 / 255, True),
    ):
        before = {**point()["error"], "max_abs": 0.1}
        error = {**before, name: value}
        assert verdicts(made(point(error=before)), made(point(error=error))) == (
            {name: "worse"} if worse else {}
        )


# --- what cannot be compared ------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench")
@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"device": {**DEVICE, "name": "another card"}}, "device"),
        ({"device": {**DEVICE, "driver": "driver 2"}}, "driver"),
        ({"backend": "gl"}, "backend"),
        ({"system": "Linux x86_64, 16 CPUs"}, "system"),
    ],
)
def test_another_device_or_driver_is_said_and_is_no_regression(change, word):
    found = compare.compare(made(), made(point(gpu=30.0), **change))
    assert [one.verdict for one in found.changes] == ["worse"]
    assert found.regressions == []
    assert [one for one in found.apart if one.startswith(f"The {word} is another one")]


@pytest.mark.parametrize(
    "change", [{"size": [128, 72]}, {"scene": {"name": "atrium", "instances": 1, "triangles": 3}}]
)
def test_another_picture_is_not_compared_at_all(change):
    found = compare.compare(made(), made(point(gpu=30.0), **change))
    assert (found.compared, found.changes) == (0, [])
    assert "nothing is compared" in found.apart[0]


def test_errors_against_another_reference_are_not_compared():
    worse = point(gpu=30.0, error={"relative_mse": 0.9, "max_abs": 1.0, "flip": 0.9})
    reference = {"preset": "reference", "samples_per_pixel": 4}
    assert verdicts(made(), made(worse, reference=reference)) == {"gpu_ms": "worse"}


def test_a_point_with_other_settings_is_another_point():
    found = compare.compare(made(), made(point(gpu=30.0, settings={"msaa": 8})))
    assert (found.compared, found.changes) == (0, [])
    assert "msaa" in found.apart[0]


@pytest.mark.feature("tools/bench")
def test_points_and_parts_that_one_record_lacks_are_listed():
    threads = {
        "points": [{"draws": 9, "threads": 0, "record_ms": 1.0, "cpu_ms": 1.0, "error": {}, "draw_calls": 9}]
    }
    old = made(point(), point("low"))
    new = made(point(work={"draws": 470, "samples": 1, "barriers": 3}), point("high"), threads=threads)
    found = compare.compare(old, new)
    assert found.changes == []
    assert found.only_old == [("settings", "low", "")]
    assert found.only_new == [
        ("settings", "medium", "barriers"),
        ("settings", "high", ""),
        ("threads", "", ""),
    ]


def test_only_some_parts_can_be_compared():
    old = made(start_s={"cold": {"total": 1.0, "shaders_compiled": 3}})
    new = made(point(gpu=30.0), start_s={"cold": {"total": 9.0, "shaders_compiled": 3}})
    assert verdicts(old, new, ["start"]) == {"total_s": "worse"}
    assert verdicts(old, new, ["settings"]) == {"gpu_ms": "worse"}


def test_a_later_record_in_front_and_a_busy_machine_are_said():
    worse = point(gpu=30.0, work={"draws": 471, "samples": 1})
    old, late = made(load_before=4.1), made(worse, date="2025-01-01T00:00:00+00:00")
    found = compare.compare(old, late)
    said = " ".join(found.apart)
    assert "the wrong way round" in said and "busy before the first (load 4.1 on 2 processors)" in said
    assert {one.key[2] for one in found.changes} == {"gpu_ms", "draws"}
    assert [one.key[2] for one in found.regressions] == ["draws"]  # a count is the same on a busy machine
    quiet = compare.compare(made(load_before=3.9), made(worse))
    assert quiet.apart == [] and len(quiet.regressions) == 2


# --- the records of this repository -----------------------------------------------------------------------------------


RECORDS = [
    path
    for path in sorted(bench.FOLDER.glob("ch[0-9][0-9]-*.json"))
    if json.loads(path.read_text("utf-8")).get("format") == bench.FORMAT
]


def measured(record, part):
    """Whether a record has more of a part than the reason why there is nothing, as of queues on a device with one."""
    found = record.get({"settings": "points", "start": "start_s"}.get(part, part))
    return bool(found) and not ("why" in found and not found.get("scenes"))


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_every_part_of_every_record_is_compared(path):
    """A part that was measured has figures; a time that is three times as long is found wherever it stands."""
    record = json.loads(path.read_text("utf-8"))
    found = figures(record)
    assert {part for part, _, _ in found} == {part for part in bench.PARTS if measured(record, part)}
    slow = json.loads(path.read_text("utf-8"), parse_float=float)
    slower(slow)
    changes = compare.compare(record, slow).changes
    times = {key for key, one in found.items() if one.kind == "time" and one.value > 0}
    missed = {key for key in times - {one.key for one in changes} if found[key].noise is None}
    assert not missed
    assert {one.verdict for one in changes} == {"worse"}
    assert len(changes) > 0.9 * len(times)


def slower(value):
    """Make every time of a record three times as long, in place; its noise stays."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, one in list(items):
        if isinstance(one, dict | list):
            slower(one)
        timed = isinstance(key, str) and (key.endswith(("_ms", "_us", "_s")) or key in ("ms", "total"))
        if timed and isinstance(one, float) and "noise" not in key:
            value[key] = one * 3


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench")
def test_a_regression_is_named_and_ends_with_1(strata, files):
    old, new = files(made(), made(point(gpu=20.0)))
    code, printed, _ = strata("bench", "--compare", old, new)
    assert code == 1
    assert "Chapter 1 on Vulkan: regressions" in printed
    for word in ("medium", "gpu_ms", "+100.0%", "slower", "forward", "1 regression among"):
        assert word in printed
    code, printed, _ = strata("bench", "--compare", new, old)
    assert code == 0 and "improvements" in printed and "No regressions" in printed


@pytest.mark.parametrize(
    ("old", "new", "change"),
    [
        (1e308, 1e-308, "-100.0%"),
        (1e-308, 1e308, "x inf"),
        (1.0, 1e150, "x 1e+150"),
        (1.0, 20.0, "x 20"),
        (-10.0, 5.0, "-"),
        (-10.0, -5.0, "-"),
    ],
)
def test_changes_of_any_size_are_short(old, new, change):
    one = compare.Change(("a", "b", "c"), Figure("time", old), Figure("time", new), "worse")
    assert compare_show._change(one) == change and compare_show._grown(one) >= 0


def test_a_part_that_did_not_move_is_not_blamed(strata, files):
    passes = {"forward": 9.0, "tonemap": 1.0}
    old, new = made(point(passes_ms=passes)), made(point(gpu=20.0, passes_ms=passes))
    code, printed, _ = strata("bench", "--compare", *files(old, new))
    assert code == 1 and "slower" in printed and "forward" not in printed


def test_a_comparison_is_json_too(strata, files):
    old, new = files(made(), made(point(gpu=20.0)))
    code, printed, said = strata("bench", "--compare", old, new, "--json", "-")
    found = json.loads(printed)
    assert code == 1 and found["regressions"] == 1 and "regression" in said
    (change,) = found["comparisons"][0]["changes"]
    assert (change["point"], change["verdict"], change["new"]["value"]) == ("medium", "worse", 20.0)
    assert found.keys() == {"kind", "old", "new", "regressions", "notes", "failing", "comparisons"}
    assert found["comparisons"][0].keys() == {
        *("chapter", "backend", "compared", "blames", "apart", "changes", "only_old", "only_new")
    }
    assert change.keys() == {"part", "point", "figure", "kind", "verdict", "old", "new"}
    assert change["old"].keys() == change["new"].keys() == {"value", "noise", "least"}
    assert strata("bench", "--compare", old, new, "--json", "found.json")[0] == 1
    assert json.loads(Path("found.json").read_text("utf-8")) == found


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (("{", made()), "no record of a bench"),
        ((made(), "[]"), "no record of a bench"),
        ((made(), {"points": []}), "no record of a bench"),
        ((made(), {"format": 2, "both": 1}), "no record of a bench"),
        ((made(), {"format": 2, "points": []}), "no whole record"),
        ((made(), made(points=[{"name": "medium"}])), "no whole record"),
        ((made(), made(points="none")), "no whole record"),
        ((made(), made({**point(), "gpu_ms": "fast"})), "no whole record"),
        ((made(), made({**point(), "gpu_ms": 10**400})), "no whole record"),
        ((made(), made(fork=[1])), "no whole record"),
        ((made(), made(chapter=2)), "name two records of one"),
        ((made(format=1), made(format=1)), "format 1, not 2"),
        ((made(), {"format": 2, "kind": "every chapter", "records": [], "failures": []}), "two of a kind"),
    ],
)
def test_what_is_no_record_is_one_sentence(strata, files, texts, said):
    code, printed, complaint = strata("bench", "--compare", *files(*texts))
    assert (code, printed) == (2, "")
    assert said in complaint and complaint.count("\n") == 1


def test_a_file_that_is_not_there_is_one_sentence(strata, files):
    old, _ = files(made(), made())
    for paths in ((old, "none.json"), ("none.json", old), (old, old.parent)):
        code, _, complaint = strata("bench", "--compare", *paths)
        assert code == 2 and complaint.count("\n") == 1 and "no record of a bench" in complaint


def test_a_record_of_another_kind_is_one_sentence(strata, files):
    old, _ = files(made(), made())
    for other in ("ch01-peer.json", "ch01-both-software.json", "scene-graph.json"):
        code, _, complaint = strata("bench", "--compare", old, ROOT / "docs" / "benchmarks" / other)
        assert code == 2 and other in complaint and complaint.count("\n") == 1


def test_another_format_is_one_sentence(strata, files):
    code, _, complaint = strata("bench", "--compare", *files(made(format=1), made()))
    assert code == 2 and "format 1" in complaint and "measure again" in complaint
    assert complaint.count("\n") == 1


def test_records_with_no_figure_in_common_are_no_success(strata, files):
    drawn = made(scene={"name": "spheres", "instances": 1, "triangles": 7})
    for new, words in ((drawn, ()), (made(), ("--only", "cloth"))):
        code, printed, _ = strata("bench", "--compare", *files(made(), new), *words)
        assert code == 2 and "Nothing was compared" in printed and "No regressions" not in printed


# --- every chapter ----------------------------------------------------------------------------------------------------


def whole(*records, failures=()):
    return {
        "format": bench.FORMAT,
        "kind": "every chapter",
        "date": "2026-01-02",
        "commit": "abc",
        "records": list(records),
        "failures": [dict(zip(("chapter", "backend", "why"), one, strict=True)) for one in failures],
    }


def test_benches_of_every_chapter_are_compared_one_by_one(strata, files):
    old = whole(made(), made(backend="gl"), made(chapter=2))
    new = whole(made(backend="gl"), made(point(gpu=30.0)), made(chapter=3))
    code, printed, _ = strata("bench", "--compare", *files(old, new))
    assert code == 1 and "Chapter 1 on Vulkan: regressions" in printed
    assert "OpenGL: regressions" not in printed
    assert "Chapter 2 on Vulkan is only in" in printed and "Chapter 3 on Vulkan is only in" in printed


def test_a_bench_that_fails_now_is_a_regression(strata, files):
    failed = whole(failures=[(1, "vulkan", "the device was lost")])
    code, printed, _ = strata("bench", "--compare", *files(whole(made()), failed))
    assert code == 1 and "Chapter 1 on Vulkan fails" in printed and "the device was lost" in printed
    code, printed, _ = strata("bench", "--compare", *files(failed, whole(made())))
    assert code == 2 and "is measured again" in printed and "Nothing was compared" in printed
    code, printed, _ = strata("bench", "--compare", *files(failed, failed))
    assert code == 2 and "fails in" in printed


@pytest.mark.parametrize(
    "words", [["1"], ["--quick"], ["--all"], ["--record"], ["--size", "64x36"], ["--plot", "a.png"]]
)
def test_what_makes_no_sense_beside_compare_is_refused(strata, files, words):
    code, _, complaint = strata("bench", *words, "--compare", *files(made(), made()))
    assert code == 2 and words[0] in complaint and complaint.count("\n") == 1
