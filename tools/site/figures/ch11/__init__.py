"""Figures of chapter 11: passes, jitter, motion, blur of histories, boxes, rest, tones, scales; `walk` has a loop."""

from __future__ import annotations

from tools.site.figures.ch11.blur import blur_of_histories
from tools.site.figures.ch11.box import boxes_of_colours
from tools.site.figures.ch11.jitter import sequences_in_a_pixel
from tools.site.figures.ch11.motion import vectors_as_colours
from tools.site.figures.ch11.passes import passes_behind_lighting
from tools.site.figures.ch11.rest import pixel_at_an_edge
from tools.site.figures.ch11.scales import time_that_is_held
from tools.site.figures.ch11.tone import tone_curves

FIGURES = {
    "ch11-passes": passes_behind_lighting,
    "ch11-jitter": sequences_in_a_pixel,
    "ch11-motion": vectors_as_colours,
    "ch11-blur": blur_of_histories,
    "ch11-box": boxes_of_colours,
    "ch11-rest": pixel_at_an_edge,
    "ch11-curves": tone_curves,
    "ch11-scales": time_that_is_held,
}
