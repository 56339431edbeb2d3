"""Figures of chapter 7: normals, light lists, ambient occlusion, exposure, layers; `walk` and `fill` are loops."""

from __future__ import annotations

from tools.site.figures.ch07.exposure import histogram
from tools.site.figures.ch07.layers import lists_of_layers
from tools.site.figures.ch07.lights import bins, tiles
from tools.site.figures.ch07.normals import octahedral_normals
from tools.site.figures.ch07.occlusion import rays_over_depth

FIGURES = {
    "ch07-octahedral": octahedral_normals,
    "ch07-bins": bins,
    "ch07-tiles": tiles,
    "ch07-occlusion": rays_over_depth,
    "ch07-histogram": histogram,
    "ch07-layers": lists_of_layers,
}
