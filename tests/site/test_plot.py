"""Time against error on a page: every number of the record, at its place."""

from __future__ import annotations

import json
import re

import pytest

from tools.bench.bench import FOLDER
from tools.site.figures.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, figure, short, ticks

RECORDS = sorted(FOLDER.glob("ch[0-9][0-9]-*.json"))
RECORDS = [path for path in RECORDS if json.loads(path.read_text("utf-8")).get("format") == 2]
RECORDS = [
    path for path in RECORDS if json.loads(path.read_text("utf-8"))["points"]
]  # else of other parts alone
POINT = re.compile(
    r'<g class="point (\w+)"[^>]*? data-name="([^"]+)"([^>]*) transform="translate\(([\d.]+) ([\d.]+)\)"'
)


@pytest.mark.feature("tools/site")
@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_the_plot_has_the_points_of_the_record(path) -> None:
    made = json.loads(path.read_text("utf-8"))
    html = figure(made, path.name)
    found = {
        name: (kind, dict(re.findall(r'data-(\w+)="([^"]*)"', rest)))
        for kind, name, rest, *_ in POINT.findall(html)
    }
    assert len(found) == len(made["points"]) > 3
    for point in made["points"]:
        kind, numbers = found[point["name"]]
        assert kind == point["kind"]
        assert float(numbers["ms"]) == point["gpu_ms"] and float(numbers["noise"]) == point["noise_ms"]
        assert (
            float(numbers["mse"]) == point["error"]["relative_mse"]
            and float(numbers["max"]) == point["error"]["max_abs"]
        )
        assert ("flip" in numbers) == (point["error"]["flip"] is not None)


def test_places_are_linear_in_time_and_error_and_inside() -> None:
    made = json.loads(RECORDS[0].read_text("utf-8"))
    places = {name: (float(x), float(y)) for _, name, _, x, y in POINT.findall(figure(made, "a.json"))}
    points = sorted(made["points"], key=lambda one: one["gpu_ms"])
    low, middle, high = points[0], points[len(points) // 2], points[-1]
    share = (middle["gpu_ms"] - low["gpu_ms"]) / (high["gpu_ms"] - low["gpu_ms"])
    xs = [places[one["name"]][0] for one in (low, middle, high)]
    assert (xs[1] - xs[0]) / (xs[2] - xs[0]) == pytest.approx(share, abs=0.002)
    points.sort(key=lambda one: one["error"]["flip"])
    assert [places[one["name"]][1] for one in points] == sorted((y for _, y in places.values()), reverse=True)
    assert all(LEFT <= x <= WIDTH - RIGHT and TOP <= y <= HEIGHT - BOTTOM for x, y in places.values())


def test_the_line_of_the_noise_goes_from_the_time_less_the_noise_to_the_time_with_it() -> None:
    points = json.loads(RECORDS[0].read_text("utf-8"))["points"]
    made = json.loads(RECORDS[0].read_text("utf-8")) | {
        "points": [{**one, "noise_ms": 0.1 * one["gpu_ms"]} for one in points]
    }
    html = figure(made, "a.json")
    places = {name: float(x) for _, name, _, x, _ in POINT.findall(html)}
    lines = re.findall(r'data-name="([^"]+)".*?<line class="noise" x1="([-\d.]+)" x2="([-\d.]+)"/>', html)
    assert len(lines) == len(points)
    first, last = (choose(points, key=lambda one: one["gpu_ms"]) for choose in (min, max))
    scale = (places[last["name"]] - places[first["name"]]) / (last["gpu_ms"] - first["gpu_ms"])
    noise = {one["name"]: 0.1 * one["gpu_ms"] * scale for one in points}  # in pixels
    assert max(noise.values()) > 5.0
    for name, left, right in lines:
        assert (float(left), float(right)) == pytest.approx((-noise[name], noise[name]), abs=0.15)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 10.0, [0, 2, 4, 6, 8, 10]),
        (103.0, 240.0, [100, 150, 200, 250]),
        (0.034, 0.0757, [0.03, 0.04, 0.05, 0.06, 0.07, 0.08]),
        (5.0, 5.0, [5, 6, 7, 8, 9, 10]),
        (-0.3, 0.2, [-0.3, -0.2, -0.1, 0, 0.1, 0.2]),
    ],
)
def test_ticks_are_round_and_around_all(low: float, high: float, expected: list[float]) -> None:
    assert ticks(low, high) == pytest.approx(expected)


def test_numbers_have_three_digits_and_no_exponent() -> None:
    values = {187.456: "187", 12345.0: "12345", 11.15: "11.2", 0.01234: "0.0123", 0.0: "0", 1.0: "1.00"}
    assert {value: short(value) for value in values} == values


def test_names_of_presets_do_not_lie_over_each_other() -> None:
    made = json.loads(RECORDS[0].read_text("utf-8"))
    close = [{**point, "gpu_ms": 100.0 + 0.1 * n} for n, point in enumerate(made["points"])]
    for point in close:
        point["error"] = {**point["error"], "flip": 0.05}
    html = figure({**made, "points": close}, "a.json")
    names = re.findall(
        r'translate\(([\d.]+) ([\d.]+)\)"><title>[^<]*</title>.*?<text x="([-\d.]+)" y="([-\d.]+)">', html
    )
    places = [(float(x) + float(dx), float(y) + float(dy)) for x, y, dx, dy in names]
    presets = [point for point in close if point["kind"] == "preset"]
    assert len(places) == len(presets) == 4
    assert all(abs(a[1] - b[1]) >= 15 or abs(a[0] - b[0]) >= 24 for a in places for b in places if a is not b)


@pytest.mark.feature("tools/site")
def test_a_record_without_points_is_refused() -> None:
    with pytest.raises(KeyError):
        figure({"points": []}, "a.json")
