"""Figures of chapter 10: passes, phase, froxels, the medium, ways of light, jitter, the sum; `jitter` has a loop."""

from __future__ import annotations

from tools.site.figures.ch10.froxels import froxels_from_above, slices_in_depth
from tools.site.figures.ch10.jitter import samples_over_frames
from tools.site.figures.ch10.lookup import lookups
from tools.site.figures.ch10.medium import parts_of_the_medium, ways_of_light
from tools.site.figures.ch10.passes import passes_of_fog
from tools.site.figures.ch10.phase import phase_function
from tools.site.figures.ch10.series import errors_of_a_slab

FIGURES = {
    "ch10-passes": passes_of_fog,
    "ch10-phase": phase_function,
    "ch10-froxels": froxels_from_above,
    "ch10-slices": slices_in_depth,
    "ch10-medium": parts_of_the_medium,
    "ch10-way": ways_of_light,
    "ch10-jitter": samples_over_frames,
    "ch10-series": errors_of_a_slab,
    "ch10-lookup": lookups,
}
