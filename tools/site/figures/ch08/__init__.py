"""Figures of chapter 8: faces of lights, bias, cascades, pages, texels by need, casters, movers; `snapping`: a loop."""

from __future__ import annotations

from tools.site.figures.ch08.bias import bias_of_a_slope
from tools.site.figures.ch08.cascades import cascades_from_above
from tools.site.figures.ch08.casters import casters_of_a_lamp
from tools.site.figures.ch08.faces import faces_of_a_lamp
from tools.site.figures.ch08.movers import tile_of_movers
from tools.site.figures.ch08.need import texels_by_need
from tools.site.figures.ch08.pages import table_of_pages

FIGURES = {
    "ch08-faces": faces_of_a_lamp,
    "ch08-bias": bias_of_a_slope,
    "ch08-cascades": cascades_from_above,
    "ch08-pages": table_of_pages,
    "ch08-need": texels_by_need,
    "ch08-casters": casters_of_a_lamp,
    "ch08-movers": tile_of_movers,
}
