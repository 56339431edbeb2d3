"""The figures of a bench's record one by one, each with its name, its kind and its noise: what two records share.

A figure is named by its part, its point and a word: ("settings", "medium", "gpu_ms"), ("scales", "draws, 1000, chapter
1", "work draws"). Its noise is what the record says of it, half the distance of the quartiles; None where it says
nothing. What says how something was drawn, and not what it cost, as the number of samples, is of the kind "fact".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

FACTS = frozenset(
    {
        *("samples", "instances", "lights", "textures", "textures_resident"),
        *("passes_skipped", "recorded_parts", "recording_threads"),
        *("transient_bytes_alone", "transient_bytes_bound", "cloths_at_rest"),
        *("cloth_particles", "bytes", "decoded_bytes", "visible"),
        *("instances_tested", "instances_outside", "instances_hidden", "instances_coarser"),
        *("meshlets_outside", "meshlets_away", "meshlets_hidden"),
    }
)
"""Counters of which more is neither better nor worse."""

CODE = 1.001 / 255
"""The largest difference of two pictures may change by one code of what is shown: it is a single pixel's."""

OF_BOUND = 0.1
"""The pixels of a case of stability may change by so much of the bound."""

Key = tuple[str, str, str]
"""Part, point and name."""


@dataclass(frozen=True)
class Figure:
    """One number of a record; `kind` is "time", "error", "work" or "fact".

    `noise` and `least` are of times; `slack` is what an error or a counter may change by and mean nothing. `within` are
    the times of which it is the sum.
    """

    kind: str
    value: float
    noise: float | None = None
    least: float | None = None
    slack: float = 0.0
    within: Mapping[str, float] = field(default_factory=dict)


def figures(made: dict[str, Any]) -> dict[Key, Figure]:
    """Return the figures of a record. Raises KeyError, TypeError or AttributeError for what is no whole record."""
    found: dict[Key, Figure] = {}
    for part, rows in PARTS.items():
        for point, figure in rows(made):
            found |= {(part, point, name): one for name, one in figure.items() if one is not None}
    return found


def settings(made: dict[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the settings of each (part, point) that has some: a point of other settings is another point."""
    found = {("settings", one["name"]): dict(one["settings"]) for one in made["points"]}
    for swept in made["prepared"]:
        for one in swept["points"]:
            found["prepared", f"{swept['name']}, {one['name']}"] = dict(one["settings"])
    return found


# --- one kind of figure -----------------------------------------------------------------------------------------------

Row = tuple[str, dict[str, Figure | None]]


def _number(value: Any) -> float | None:
    if value is None or isinstance(value, bool):
        return None
    if not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _times(one: Mapping[str, Any], *names: str, within: str = "") -> dict[str, Figure | None]:
    """Return times; the first of them owns what the record calls noise without saying of what."""
    found: dict[str, Figure | None] = {}
    for place, name in enumerate(names):
        stem, _, unit = name.rpartition("_")
        value = _number(one.get(name))
        spread = []
        for word in ("noise", "least"):
            own = one.get(f"{stem}_{word}_{unit}" if stem else f"{word}_{unit}")
            spread.append(_number(own if own is not None or place else one.get(f"{word}_{unit}")))
        noise, least = spread
        parts = (
            {name: float(part) for name, part in one.get(within, {}).items()} if within and not place else {}
        )
        found[name] = None if value is None else Figure("time", value, noise, least, within=parts)
    return found


def _errors(errors: Mapping[str, Any] | None, before: str = "") -> dict[str, Figure | None]:
    found: dict[str, Figure | None] = {}
    for name, given in (errors or {}).items():
        if isinstance(given, Mapping):
            found |= _errors(given, f"{before}{name} ")
        elif (value := _number(given)) is not None:
            found[f"{before}{name}"] = Figure("error", value, slack=CODE if name == "max_abs" else 0.0)
    return found


def _work(counts: Mapping[str, Any], *names: str) -> dict[str, Figure | None]:
    found: dict[str, Figure | None] = {}
    for name in names or counts:
        if (value := _number(counts.get(name))) is not None:
            found[name] = Figure("fact" if name in FACTS else "work", value)
    return found


def _point(*words: Any) -> str:
    return ", ".join(str(word) for word in words)


# --- the parts --------------------------------------------------------------------------------------------------------


def _settings(made: dict[str, Any]) -> Iterator[Row]:
    for one in made["points"]:
        times = _times(one, "gpu_ms", "wall_ms", "cpu_ms", within="passes_ms")
        yield one["name"], times | _errors(one["error"]) | _work(one["work"])


def _prepared(made: dict[str, Any]) -> Iterator[Row]:
    for swept in made["prepared"]:
        for one in swept["points"]:
            times = _times(one, "gpu_ms", within="parts_ms")
            yield _point(swept["name"], one["name"]), times | _errors(one["error"])


def _start(made: dict[str, Any]) -> Iterator[Row]:
    for state, one in made["start_s"].items():
        total = Figure(
            "time", float(one["total"]), within={k: v for k, v in one.items() if k not in NO_STEPS}
        )
        yield state, {"total_s": total, **_work(one, "shaders_compiled")}


NO_STEPS = frozenset({"total", "shaders_compiled"})
"""What a start has beside the seconds of its steps."""


def _stability(made: dict[str, Any]) -> Iterator[Row]:
    held = made["stability"] or {"bound": 0.0, "cases": []}
    for one in held["cases"]:
        yield (
            one["case"],
            {"pixels_changed": Figure("error", float(one["pixels_changed"]), slack=OF_BOUND * held["bound"])},
        )


def _scales(made: dict[str, Any]) -> Iterator[Row]:
    for scale in made.get("scales", ()):
        for one in scale["points"]:
            times = _times(one, "python_ms", "record_ms", "gpu_ms")
            yield (
                _point(scale["name"], one["count"], one["side"]),
                times | _errors(one["error"]) | _work(one["work"]),
            )


def _pipelines(made: dict[str, Any]) -> Iterator[Row]:
    if held := made.get("pipelines"):
        yield "all", _errors(held["error"]) | _work(held, "pipelines")
        for state, one in held["states"].items():
            yield state, _times(one, "ms")


def _threads(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("threads") or {"points": ()})["points"]:
        figure = _times(one, "record_ms", "cpu_ms") | _errors(one["error"]) | _work(one, "draw_calls")
        yield _point(f"{one['draws']} draws", f"{one['threads']} threads"), figure


def _loads(made: dict[str, Any]) -> Iterator[Row]:
    for scene in made.get("loads", ()):
        for way, one in scene["ways"].items():
            names = ("first_frame_s", "complete_s") if way == "stream" else ("load_s",)
            yield _point(scene["scene"], way), _times(one, *names) | _work(one, "bytes", "textures")
        if scene["ways"]:
            yield scene["scene"], _errors(scene["errors"])


def _readback(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("readback") or {"points": ()})["points"]:
        yield one["kind"], _times(one, "ms")


def _graph(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("graph") or {"graphs": (), "chains": (), "frames": ()}
    counts = (
        "passes",
        "barriers",
        "transitions",
        "transient_bytes",
        "passes_skipped",
        "transient_bytes_bound",
    )
    for one in held["graphs"]:
        yield one["name"], _times(one, "compile_ms") | _work(one, *counts)
    for one in held["chains"]:
        yield _point(f"a chain of {one['passes']} passes"), _times(one, "compile_ms")
    for one in held["frames"]:
        yield _point(f"{one['passes']} passes", one["way"]), _times(one, "render_us", "driver_us", "own_us")


def _prepass(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("prepass") or {"points": ()})["points"]:
        point = _point(one["path"], f"{one['layers']} layers", "with it" if one["prepass"] else "without")
        yield point, _times(one, "gpu_ms", within="passes_ms") | _errors(one["error"]) | _work(one, "shaded")


def _gbuffer(made: dict[str, Any]) -> Iterator[Row]:
    for scene in made.get("gbuffer") or ():
        for one in scene["points"]:
            errors = {
                side: {k: v for k, v in of.items() if k != "max_linear"} for side, of in one["error"].items()
            }
            figure = _times(one, "gpu_ms", within="passes_ms") | _errors(errors) | _work(one, "bytes")
            yield _point(scene["scene"], scene["environment"], one["format"]), figure


def _cloth(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("cloth") or {"points": (), "executions": {"points": ()}}
    for one in held["points"]:
        words = (one["kind"], f"{one['substeps']} substeps", f"{one['iterations']} iterations")
        errors = _errors({name: one[name] for name in ("rms_m", "greatest_m", "stretch")})
        yield _point(*words), _times(one, "ms") | errors
    for one in held["executions"]["points"]:
        yield _point(one["execution"], f"{one['particles']} particles"), _times(one, "gpu_ms")


def _drift(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("drift") or {"points": ()})["points"]:
        errors = _errors({name: one[name] for name in ("strays", "stretch_rms", "stretch_greatest")})
        yield _point(one["name"], one["precision"], f"h omega {one['h_omega']:g}"), errors


def _async(made: dict[str, Any]) -> Iterator[Row]:
    for scene in (made.get("async") or {"scenes": ()})["scenes"]:
        yield scene["scene"], _errors(scene["error"])
        for state in ("on", "off"):
            if scene.get(state):
                yield _point(scene["scene"], state), _times(scene[state], "frame_ms", "cpu_ms")


def _pacing(made: dict[str, Any]) -> Iterator[Row]:
    for one in made.get("pacing") or ():
        figure = _times(one, "wait_us", "submit_us") | _work(
            one, "objects", "calls", "cpu_waits", "queue_waits"
        )
        yield one["way"], figure


def _culling(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("culling") or {"ways": (), "pyramid": ()}
    for one in held["ways"]:
        times = _times(one, "gpu_ms", "frame_ms", "wall_ms", "python_ms", within="passes_ms")
        yield one["way"], times | _work(one["work"])
    for one in held["pyramid"]:
        yield "pyramid, {}x{}".format(*one["size"]), _times(one, "gpu_ms")


def _ideal(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("ideal") or {"views": ()}
    for one in held["views"]:
        yield one["view"], _work(one, "meshlets", "whole", "visible") | _errors({"late": one["late"]})


def _meshlets(made: dict[str, Any]) -> Iterator[Row]:
    for one in made.get("meshlets") or ():
        figure = _times(one, "gpu_ms") | _times(one, "build_s") | _work(one, "meshlets", "bytes")
        yield _point(f"{one['vertices']} vertices", one["path"]), figure | _work(one["work"])


def _lods(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("lods") or {"rows": ()}
    if held["rows"]:
        yield "all", _times(held, "build_s")
    for one in held["rows"]:
        yield f"{one['pixels']:g} pixels", _times(one, "gpu_ms") | _errors(one["error"]) | _work(one["work"])


def _lights(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("lights") or {"rows": ()}
    for one in held["rows"]:
        yield f"{one['lights']} lamps", _work(one["work"])
        for way in one["ways"]:
            times = _times(way, "build_ms") | _times(way, "light_ms")
            yield _point(f"{one['lights']} lamps", way["way"]), times | _work(way, "pixels_differ")


def _occlusion(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("occlusion") or {"points": ()})["points"]:
        errors = _errors({"rmse": one["rmse"], "bias": abs(one["bias"])})
        yield _point(one["way"], f"radius {one['radius']:g}"), _times(one, "ms") | errors


def _surfaces(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("surfaces") or {"rows": ()})["rows"]:
        yield (
            _point(one["view"], one["way"]),
            _times(one, "ms") | _errors(one["error"]) | _work(one, "triangles"),
        )


def _transparency(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("transparency") or {"rows": ()})["rows"]:
        yield _point(f"{one['panes']} panes", one["way"]), _times(one, "ms") | _errors(one["error"])


def _hdr(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("hdr") or dict.fromkeys(("exposures", "adaptation", "bloom", "passes"), ())
    for one in held["exposures"]:
        yield _point(one["picture"], one["way"], one["format"]), _errors({"stops": abs(one["error_stops"])})
    for one in held["adaptation"]:
        point = _point(one["way"], f"{one['from_nits']:g} to {one['to_nits']:g} nits")
        yield point, _errors({"stops": one["error_stops"]}) | _work(one, "frames")
    for one in held["bloom"]:
        errors = {name: abs(one[name]) for name in ("mean_error", "largest_error", "energy", "shift")}
        yield _point(f"bloom, {one['levels']} levels", one["format"]), _errors(errors)
    for one in held["passes"]:
        yield "{}, {}x{}".format(one["pass"], *one["size"]), _times(one, "ms", "frame_ms")


SHADOW_ERRORS = ("error", "wrong", "off_edges", "dark", "bright")


def _shadow_row(one: dict[str, Any], *more: str) -> dict[str, Figure | None]:
    """Return the time and the errors of a row of factors of shadows."""
    return _times(one, "ms") | _errors({name: one[name] for name in (*SHADOW_ERRORS, *more)})


def _memory(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("memory") or {"rows": ()})["rows"]:
        counts = {"used_mib": one["used_mib"], "lights": one["lights"], "lowered": one["lowered"]}
        yield _point(one["kind"], one["name"]), _shadow_row(one) | _work(counts)


def _filters(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("filters") or {"rows": ()})["rows"]:
        yield _point(one["lights"], one["name"]), _shadow_row(one, "soft_error", "soft_wrong")


def _cascades(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("cascades") or {"rows": ()})["rows"]:
        point = _point(f"{one['cascades']} cascades", f"{one['texels']} texels")
        yield point, _shadow_row(one) | _work(one, "mib", "drawn")


def _caching(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("caching") or {"rows": ()})["rows"]:
        times = _times(one, "gpu_ms") | _times(one, "python_ms") | _times(one, "cpu_ms")
        yield one["state"], times | _work(one["work"]) | _work(one, "most_faces")


def _casters(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("casters") or {"rows": ()})["rows"]:
        times = _times(one, "ms", "frame_ms") | _times(one, "light_ms")
        yield _point(f"{one['lights']} lights", one["way"]), times | _work(one, "faces")


def _rates(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("rates") or {"rows": ()})["rows"]:
        times = _times(one, "ms", "mask_ms", "edges_ms", "light_ms")
        errors = _errors({name: one[name] for name in ("flip", "pixels_differ")})
        yield _point(one["scene"], one["way"], one["name"]), times | errors | _work(one, "share")


def _constants(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("constants") or dict.fromkeys(("loops", "builds", "frames"), ())
    for one in held["loops"]:
        yield f"{one['taps']} taps, {one['way']}", _times(one, "ms")
    for one in held["builds"]:
        yield f"a pipeline, {one['way']}", _times(one, "ms")
    for one in held["frames"]:
        yield f"{one['pass']}, {one['name']}", _times(one, "ms") | _work(one, "pixels_differ")


def _fog(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("fog") or {"rows": (), "bands": ()}
    for one in held["rows"]:
        errors = _errors({name: one[name] for name in ("rms", "median", "p95")})
        if one["bias"] is not None:
            errors |= _errors({"bias": abs(one["bias"])})
        times = _times(one, "fog_ms", "light_ms", within="passes_ms")
        yield _point(one["scene"], one["name"]), times | errors | _work(one, "codes")
    for one in held["bands"]:
        yield _point("bands", f"{one['slices']} slices", one["way"]), _errors({"codes": one["codes"]})


def _taa(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("taa") or {"rows": (), "times": ()}
    for one in held["rows"]:
        names = ("flicker", "flicker_rest", "ghost_max", "ghost_mean")
        yield _point(one["case"], one["mode"]), _errors({name: one[name] for name in names})
    for one in held["times"]:
        yield _point("time", one["mode"]), _times(one, "taa_ms", "motion_ms")


def _rays(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("rays") or {"rows": (), "builds": (), "refits": ()}
    for one in held["rows"]:
        errors = _errors({"t_error": one["t_error"]}) | _work(one, "differ")
        yield _point(one["scene"], f"{one['rays']} rays", one["way"]), _times(one, "ms") | errors
    for one in held["builds"]:
        yield _point(one["scene"], "build", one["way"]), _times(one, "ms") | _work(one, "bytes")
    for one in held["refits"]:
        yield _point(one["scene"], one["what"], one["way"]), _times(one, "ms") | _work(one, "dispatches")


PARTS = {
    "settings": _settings,
    "prepared": _prepared,
    "start": _start,
    "stability": _stability,
    "scales": _scales,
    "pipelines": _pipelines,
    "threads": _threads,
    "loads": _loads,
    "readback": _readback,
    "graph": _graph,
    "prepass": _prepass,
    "gbuffer": _gbuffer,
    "cloth": _cloth,
    "drift": _drift,
    "async": _async,
    "pacing": _pacing,
    "culling": _culling,
    "ideal": _ideal,
    "meshlets": _meshlets,
    "lods": _lods,
    "lights": _lights,
    "surfaces": _surfaces,
    "occlusion": _occlusion,
    "transparency": _transparency,
    "hdr": _hdr,
    "memory": _memory,
    "filters": _filters,
    "cascades": _cascades,
    "caching": _caching,
    "casters": _casters,
    "rates": _rates,
    "constants": _constants,
    "fog": _fog,
    "taa": _taa,
    "rays": _rays,
}
"""How the points of each part of a bench are found in its record."""
