"""Figures of chapter 12: two levels, a walk through a hierarchy, edges, offsets, the binding table, paths."""

from __future__ import annotations

from tools.site.figures.ch12.edges import edges_by_arithmetic
from tools.site.figures.ch12.levels import two_levels
from tools.site.figures.ch12.lobes import densities_of_lobes
from tools.site.figures.ch12.offsets import offsets_by_distance
from tools.site.figures.ch12.paths import paths_in_a_box
from tools.site.figures.ch12.samples import error_against_samples
from tools.site.figures.ch12.table import binding_table
from tools.site.figures.ch12.walk import walk_of_a_ray

FIGURES = {
    "ch12-levels": two_levels,
    "ch12-walk": walk_of_a_ray,
    "ch12-edges": edges_by_arithmetic,
    "ch12-offsets": offsets_by_distance,
    "ch12-table": binding_table,
    "ch12-paths": paths_in_a_box,
    "ch12-lobes": densities_of_lobes,
    "ch12-samples": error_against_samples,
}
