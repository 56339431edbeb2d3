"""Figures of chapter 9: codes, the mask, its feedback, the work list, blocks and others; `feedback` has a loop."""

from __future__ import annotations

from tools.site.figures.ch09.blocks import blocks_and_passes
from tools.site.figures.ch09.cells import cells_of_the_study
from tools.site.figures.ch09.codes import codes_of_rates
from tools.site.figures.ch09.combiners import rates_combined
from tools.site.figures.ch09.constants import two_compilers
from tools.site.figures.ch09.feedback import mask_over_frames
from tools.site.figures.ch09.lists import list_of_an_area
from tools.site.figures.ch09.mask import tile_of_the_mask

FIGURES = {
    "ch09-codes": codes_of_rates,
    "ch09-mask": tile_of_the_mask,
    "ch09-feedback": mask_over_frames,
    "ch09-list": list_of_an_area,
    "ch09-blocks": blocks_and_passes,
    "ch09-combiners": rates_combined,
    "ch09-constants": two_compilers,
    "ch09-cells": cells_of_the_study,
}
