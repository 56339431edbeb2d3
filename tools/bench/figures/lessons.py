"""Figures of the benches of lessons (tools/bench/lessons)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tools.bench.figures.kinds import Figure, Row, errors_of, point_of, times_of, work_of


def _loads(made: dict[str, Any]) -> Iterator[Row]:
    for scene in made.get("loads", ()):
        for way, one in scene["ways"].items():
            names = ("first_frame_s", "complete_s") if way == "stream" else ("load_s",)
            yield point_of(scene["scene"], way), times_of(one, *names) | work_of(one, "bytes", "textures")
        if scene["ways"]:
            yield scene["scene"], errors_of(scene["errors"])


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
        yield one["name"], times_of(one, "compile_ms") | work_of(one, *counts)
    for one in held["chains"]:
        yield point_of(f"a chain of {one['passes']} passes"), times_of(one, "compile_ms")
    for one in held["frames"]:
        yield (
            point_of(f"{one['passes']} passes", one["way"]),
            times_of(one, "render_us", "driver_us", "own_us"),
        )


def _gbuffer(made: dict[str, Any]) -> Iterator[Row]:
    for scene in made.get("gbuffer") or ():
        for one in scene["points"]:
            errors = {
                side: {k: v for k, v in of.items() if k != "max_linear"} for side, of in one["error"].items()
            }
            figure = times_of(one, "gpu_ms", within="passes_ms") | errors_of(errors) | work_of(one, "bytes")
            yield point_of(scene["scene"], scene["environment"], one["format"]), figure


def _cloth(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("cloth") or {"points": (), "executions": {"points": ()}}
    for one in held["points"]:
        words = (one["kind"], f"{one['substeps']} substeps", f"{one['iterations']} iterations")
        errors = errors_of({name: one[name] for name in ("rms_m", "greatest_m", "stretch")})
        yield point_of(*words), times_of(one, "ms") | errors
    for one in held["executions"]["points"]:
        yield point_of(one["execution"], f"{one['particles']} particles"), times_of(one, "gpu_ms")


def _drift(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("drift") or {"points": ()})["points"]:
        errors = errors_of({name: one[name] for name in ("strays", "stretch_rms", "stretch_greatest")})
        yield point_of(one["name"], one["precision"], f"h omega {one['h_omega']:g}"), errors


def _async(made: dict[str, Any]) -> Iterator[Row]:
    for scene in (made.get("async") or {"scenes": ()})["scenes"]:
        yield scene["scene"], errors_of(scene["error"])
        for state in ("on", "off"):
            if scene.get(state):
                yield point_of(scene["scene"], state), times_of(scene[state], "frame_ms", "cpu_ms")


def _pacing(made: dict[str, Any]) -> Iterator[Row]:
    for one in made.get("pacing") or ():
        figure = times_of(one, "wait_us", "submit_us") | work_of(
            one, "objects", "calls", "cpu_waits", "queue_waits"
        )
        yield one["way"], figure


def _culling(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("culling") or {"ways": (), "pyramid": ()}
    for one in held["ways"]:
        times = times_of(one, "gpu_ms", "frame_ms", "wall_ms", "python_ms", within="passes_ms")
        yield one["way"], times | work_of(one["work"])
    for one in held["pyramid"]:
        yield "pyramid, {}x{}".format(*one["size"]), times_of(one, "gpu_ms")


def _ideal(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("ideal") or {"views": ()}
    for one in held["views"]:
        yield one["view"], work_of(one, "meshlets", "whole", "visible") | errors_of({"late": one["late"]})


def _meshlets(made: dict[str, Any]) -> Iterator[Row]:
    for one in made.get("meshlets") or ():
        figure = times_of(one, "gpu_ms") | times_of(one, "build_s") | work_of(one, "meshlets", "bytes")
        yield point_of(f"{one['vertices']} vertices", one["path"]), figure | work_of(one["work"])


def _lods(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("lods") or {"rows": ()}
    if held["rows"]:
        yield "all", times_of(held, "build_s")
    for one in held["rows"]:
        yield (
            f"{one['pixels']:g} pixels",
            times_of(one, "gpu_ms") | errors_of(one["error"]) | work_of(one["work"]),
        )


def _lights(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("lights") or {"rows": ()}
    for one in held["rows"]:
        yield f"{one['lights']} lamps", work_of(one["work"])
        for way in one["ways"]:
            times = times_of(way, "build_ms") | times_of(way, "light_ms")
            yield point_of(f"{one['lights']} lamps", way["way"]), times | work_of(way, "pixels_differ")


def _occlusion(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("occlusion") or {"points": ()})["points"]:
        errors = errors_of({"rmse": one["rmse"], "bias": abs(one["bias"])})
        yield point_of(one["way"], f"radius {one['radius']:g}"), times_of(one, "ms") | errors


def _surfaces(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("surfaces") or {"rows": ()})["rows"]:
        yield (
            point_of(one["view"], one["way"]),
            times_of(one, "ms") | errors_of(one["error"]) | work_of(one, "triangles"),
        )


def _transparency(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("transparency") or {"rows": ()})["rows"]:
        yield point_of(f"{one['panes']} panes", one["way"]), times_of(one, "ms") | errors_of(one["error"])


def _hdr(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("hdr") or dict.fromkeys(("exposures", "adaptation", "bloom", "passes"), ())
    for one in held["exposures"]:
        yield (
            point_of(one["picture"], one["way"], one["format"]),
            errors_of({"stops": abs(one["error_stops"])}),
        )
    for one in held["adaptation"]:
        point = point_of(one["way"], f"{one['from_nits']:g} to {one['to_nits']:g} nits")
        yield point, errors_of({"stops": one["error_stops"]}) | work_of(one, "frames")
    for one in held["bloom"]:
        errors = {name: abs(one[name]) for name in ("mean_error", "largest_error", "energy", "shift")}
        yield point_of(f"bloom, {one['levels']} levels", one["format"]), errors_of(errors)
    for one in held["passes"]:
        yield "{}, {}x{}".format(one["pass"], *one["size"]), times_of(one, "ms", "frame_ms")


SHADOW_ERRORS = ("error", "wrong", "off_edges", "dark", "bright")


def _shadow_row(one: dict[str, Any], *more: str) -> dict[str, Figure | None]:
    """Return the time and the errors of a row of factors of shadows."""
    return times_of(one, "ms") | errors_of({name: one[name] for name in (*SHADOW_ERRORS, *more)})


def _memory(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("memory") or {"rows": ()})["rows"]:
        counts = {"used_mib": one["used_mib"], "lights": one["lights"], "lowered": one["lowered"]}
        yield point_of(one["kind"], one["name"]), _shadow_row(one) | work_of(counts)


def _filters(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("filters") or {"rows": ()})["rows"]:
        yield point_of(one["lights"], one["name"]), _shadow_row(one, "soft_error", "soft_wrong")


def _cascades(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("cascades") or {"rows": ()})["rows"]:
        point = point_of(f"{one['cascades']} cascades", f"{one['texels']} texels")
        yield point, _shadow_row(one) | work_of(one, "mib", "drawn")


def _caching(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("caching") or {"rows": ()})["rows"]:
        times = times_of(one, "gpu_ms") | times_of(one, "python_ms") | times_of(one, "cpu_ms")
        yield one["state"], times | work_of(one["work"]) | work_of(one, "most_faces")


def _casters(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("casters") or {"rows": ()})["rows"]:
        times = times_of(one, "ms", "frame_ms") | times_of(one, "light_ms")
        yield point_of(f"{one['lights']} lights", one["way"]), times | work_of(one, "faces")


def _rates(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("rates") or {"rows": ()})["rows"]:
        times = times_of(one, "ms", "mask_ms", "edges_ms", "light_ms")
        errors = errors_of({name: one[name] for name in ("flip", "pixels_differ")})
        yield point_of(one["scene"], one["way"], one["name"]), times | errors | work_of(one, "share")


def _constants(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("constants") or dict.fromkeys(("loops", "builds", "frames"), ())
    for one in held["loops"]:
        yield f"{one['taps']} taps, {one['way']}", times_of(one, "ms")
    for one in held["builds"]:
        yield f"a pipeline, {one['way']}", times_of(one, "ms")
    for one in held["frames"]:
        yield f"{one['pass']}, {one['name']}", times_of(one, "ms") | work_of(one, "pixels_differ")


def _fog(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("fog") or {"rows": (), "bands": ()}
    for one in held["rows"]:
        errors = errors_of({name: one[name] for name in ("rms", "median", "p95")})
        if one["bias"] is not None:
            errors |= errors_of({"bias": abs(one["bias"])})
        times = times_of(one, "fog_ms", "light_ms", within="passes_ms")
        yield point_of(one["scene"], one["name"]), times | errors | work_of(one, "codes")
    for one in held["bands"]:
        yield point_of("bands", f"{one['slices']} slices", one["way"]), errors_of({"codes": one["codes"]})


def _taa(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("taa") or {"rows": (), "times": ()}
    for one in held["rows"]:
        names = ("flicker", "flicker_rest", "ghost_max", "ghost_mean")
        yield point_of(one["case"], one["mode"]), errors_of({name: one[name] for name in names})
    for one in held["times"]:
        yield point_of("time", one["mode"]), times_of(one, "taa_ms", "motion_ms")


def _rays(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("rays") or {"rows": (), "builds": (), "refits": ()}
    for one in held["rows"]:
        errors = errors_of({"t_error": one["t_error"]}) | work_of(one, "differ")
        yield point_of(one["scene"], f"{one['rays']} rays", one["way"]), times_of(one, "ms") | errors
    for one in held["builds"]:
        yield point_of(one["scene"], "build", one["way"]), times_of(one, "ms") | work_of(one, "bytes")
    for one in held["refits"]:
        yield (
            point_of(one["scene"], one["what"], one["way"]),
            times_of(one, "ms") | work_of(one, "dispatches"),
        )


def _paths(made: dict[str, Any]) -> Iterator[Row]:
    held = made.get("paths") or {"errors": (), "speeds": ()}
    for one in held["errors"]:
        yield point_of(one["sequence"], f"{one['samples']} paths"), errors_of({"error": one["error"]})
    for one in held["speeds"]:
        yield (
            point_of(one["scene"], "paths", one["by"]),
            times_of(one, "ms") | errors_of({"noise": one["noise"]}),
        )


PARTS = {
    "loads": _loads,
    "graph": _graph,
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
    "paths": _paths,
}
"""How the points of these parts are found in a record."""
