"""The parts of a bench: what each measures, and which of them a chapter has."""

from __future__ import annotations

from collections.abc import Sequence

import chapters
from common.errors import UserError
from common.names import suggest
from common.settings import knobs
from tools.bench import prepass

SHADOWS = {
    "memory": "shadow_memory",
    "filters": "shadow_filters",
    "cascades": "shadow_cascades",
    "caching": "shadow_caching",
    "casters": "shadow_casters",
}
"""The parts about shadow maps, and the benches of lessons that measure them."""

RATES = {"rates": "rates", "constants": "constants"}
"""The same of shading rates and specialization constants."""

FOG = {"fog": "fog"}
"""The part about fog, and its bench."""

HISTORY = {"taa": "taa"}
"""The part about histories of colour, and its bench."""

TRACING = {"rays": "rays", "paths": "paths"}
"""The parts about rays and about paths, and their benches."""

PARTS = {
    "settings": "time and error of presets and knobs",
    "prepared": "what is made before the first frame",
    "start": "from nothing to the first picture, cold and warm",
    "stability": "how much the worst case changes the picture",
    "scales": "what objects and materials cost",
    "pipelines": "building pipelines cold and warm",
    "threads": "recording draws by several threads",
    "loads": "loading scenes, with their cache and without",
    "readback": "reading what the GPU wrote, by the kind of memory",
    "graph": "what a frame graph costs and spares",
    "prepass": "the depth pre-pass against overdraw",
    "gbuffer": "formats of the G-buffer against their error",
    "cloth": "how far cloth is from the truth, by how its steps are cut",
    "drift": "energy and length of cloth that is left alone",
    "async": "frames with compute work on a queue of its own",
    "pacing": "the processor's time for waiting and submitting",
    "culling": "what each test leaves, and what it costs",
    "ideal": "triangles drawn against those of visible meshlets",
    "meshlets": "how large meshlets should be",
    "lods": "what levels of detail save, and their error",
    "lights": "what selects the lights of a pixel, and what that costs",
    "surfaces": "a visibility buffer beside a G-buffer",
    "occlusion": "ambient occlusion in screen space against cast rays",
    "transparency": "blended surfaces: sorted, weighted, or as lists of layers",
    "hdr": "automatic exposure and bloom against double precision",
    "memory": "memory of shadow maps against their error by cast rays",
    "filters": "filters and biases of shadow maps against cast rays",
    "cascades": "cascades of the sun by their number and size",
    "caching": "what is drawn again at rest, by a lamp that moves, and along a walk",
    "casters": "drawing the maps of 1 to 256 lights, with culling and without",
    "rates": "invocations, time and error of shading rates, by policy and threshold",
    "constants": "loops of a constant length, and what building their pipelines takes",
    "fog": "what grids and filters of fog cost, and how far they are from single scattering",
    "taa": "what modes of temporal anti-aliasing leave of errors, ghosts and flicker",
    "rays": "rays a second by each way and by Embree, their hits, and what builds cost",
    "paths": "errors of traced paths by their number, and their speed beside Mitsuba's",
}
"""What a bench measures; a chapter may lack any of those that come after `stability`, and `prepared`."""

DRAWN = {
    "cloth",
    "drift",
    "async",
    "pacing",
    "culling",
    "ideal",
    "meshlets",
    "lods",
    "lights",
    "surfaces",
    "occlusion",
    "transparency",
    "hdr",
    *SHADOWS,
    *RATES,
    *FOG,
    *HISTORY,
    *TRACING,
    "settings",
    "prepared",
    "scales",
    "pipelines",
    "loads",
    "graph",
    "prepass",
    "gbuffer",
}
"""The parts that a plot has a panel for."""


def parts_of(which: chapters.Whole, api: str, only: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the PARTS to measure of a chapter on a graphics API: those of `only`, or all that it has.

    Raises UserError for a part that there is not.
    """
    settings_class, missing = chapters.settings_class(which), {}
    spoken = f"chapter {which}" if isinstance(which, int) else f"the fork {which.path}"
    for part, names in (
        ("scales", "SCALES"),
        ("pipelines", "PIPELINES"),
        ("prepared", "PREPARED"),
        ("threads", "THREADS"),
        ("loads", "LOADS"),
        ("readback", "LOADS"),
        ("graph", "graph"),
        ("prepass", prepass.PREPASS),
        ("gbuffer", "gbuffer_format"),
        ("cloth", "cloth_method"),
        ("drift", "cloth_method"),
        ("async", "async_compute"),
        ("pacing", "async_compute"),
        ("culling", "culling"),
        ("ideal", "culling"),
        ("meshlets", "geometry"),
        ("lods", "lod_pixels"),
        ("lights", "light_lists"),
        ("surfaces", "surfaces"),
        ("occlusion", "ssao"),
        ("transparency", "transparency"),
        ("hdr", "exposure"),
        *((part, "shadow_memory") for part in SHADOWS),
        *((part, "rate_policy") for part in RATES),
        *((part, "fog_columns") for part in FOG),
        *((part, "taa") for part in HISTORY),
        ("rays", "ray_way"),
        ("paths", "path_tracer"),
    ):
        if not hasattr(settings_class, names) and names not in knobs(settings_class):
            missing[part] = f"{spoken} names none in its settings ({names})"
    if api != "vulkan":
        missing.setdefault("pipelines", "OpenGL has no pipeline objects")
        missing.setdefault("readback", "OpenGL does not say where a buffer lies")
        missing.setdefault("async", "OpenGL has one queue")
        missing.setdefault("pacing", "OpenGL paces its frames by itself")
    for part in only:
        if part not in PARTS:
            raise UserError(
                f"--only {part}: a bench has no such part{suggest(part, PARTS)}.".replace("?.", "?")
            )
        if part in missing:
            raise UserError(f"--only {part}: there is nothing to measure, since {missing[part]}.")
    return tuple(part for part in PARTS if part not in missing and (not only or part in only))
