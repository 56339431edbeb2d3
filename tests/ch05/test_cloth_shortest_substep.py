"""The shortest substep of XPBD in 32 bits: below it weight rounds away, energy comes from nowhere, and that is told."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from chapters.ch05.benches import measures as measures
from chapters.ch05.benches.twin import Twin
from chapters.ch05.cloth.build import build_cloth
from chapters.ch05.cloth.frames import ClothFrames, drawn_from
from chapters.ch05.cloth.scene import cloth_scene
from chapters.ch05.cloth.steps import UNITS, fit_steps, least_substep
from chapters.ch05.cloth.types import Forces, Steps
from chapters.ch05.scene.pages import plan_pages
from chapters.ch05.settings import Settings
from tests.support import cloths
from tests.support.cloth_scenes import cloth, cloth_scene_of

sheet = partial(cloths.sheet, build_cloth, 4, 4, damping_per_s=0.0)
VACUUM = Forces(air_density=0.0)
NOTHING = Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)


@pytest.mark.parametrize(("edge", "unit"), [(0.3, 2.0**-24), (0.4, 2.0**-23), (1.3, 2.0**-22)])
def test_it_is_that_in_which_weight_moves_a_particle_by_some_units_of_its_position(edge, unit):
    made = sheet(edge)
    assert np.spacing(np.float32(3 * edge)) == unit
    assert least_substep(made) == pytest.approx(np.sqrt(UNITS * unit / 9.81))


@pytest.mark.parametrize("edge", [0.3, 1.3])
def test_below_half_a_unit_cloth_does_not_feel_its_weight(edge):
    """What the bound is derived from: a h < u / (2 h) is rounded away, a h = 4 u / h is not."""
    lost = least_substep(sheet(edge)) / np.sqrt(2 * UNITS)
    for h, fallen in ((0.98 * lost, 0.0), (least_substep(sheet(edge)), 1.0)):
        free = sheet(edge, pins=[], drag=0.0)
        v = Twin(free, Steps(h, 1), VACUUM, dtype=np.float32).advance(50).velocities
        assert np.allclose(v[-4:, 1], -9.81 * 50 * h * fallen, rtol=0.01), (
            "of the row that is farthest from the anchor"
        )


def kept(h, dtype):
    """Return which part of its energy a sheet has after 100 substeps without anything that takes or gives some."""
    made = sheet(0.3)
    twin = Twin(made, Steps(h, 1), NOTHING, dtype=dtype)
    noise = np.random.default_rng(1).normal(size=made.positions.shape) * 0.3
    twin.state.velocities = np.where(made.held[:, None], 0.0, noise).astype(dtype)
    first = measures.energy(made, twin.state, NOTHING).total
    return measures.energy(made, twin.advance(100), NOTHING).total / first


def test_energy_grows_far_below_the_bound_in_32_bits_and_not_at_it():
    h = least_substep(sheet(0.3))
    assert kept(h / 8, np.float32) > 1.03 and kept(h / 8, np.float64) < 1.0
    assert kept(h, np.float32) < 0.98


def test_steps_that_are_cut_too_short_are_cut_into_fewer_and_told():
    made, asked = sheet(0.3), Steps(dt=1 / 1000, substeps=64)
    same, fitted, notes = fit_steps([made, sheet(0.1)], asked)
    assert same[0] is made and fitted == replace(asked, substeps=fitted.substeps)
    assert fitted.h >= least_substep(made) > 1e-3 / (fitted.substeps + 1)
    assert len(notes) == 1 and f"{fitted.substeps} substeps" in notes[0] and "not 64" in notes[0]
    assert fit_steps([made], fitted) == ([made], fitted, [])
    assert fit_steps([made], Steps()) == ([made], Steps(), []), "the default is far from that"
    springs = Steps(dt=1 / 1000, substeps=64, method="springs")
    assert fit_steps([made], springs)[1] == springs, "springs keep a velocity of their own"


def test_a_step_that_cannot_be_cut_into_fewer_says_what_helps():
    far = sheet(400.0)
    _, fitted, notes = fit_steps([far], Steps(dt=1 / 1000, substeps=1))
    assert fitted.substeps == 1 and len(notes) == 1 and "1,200.0 m" in notes[0] and "longer steps" in notes[0]


def test_a_scene_says_it_once():
    found = cloth_scene(cloth_scene_of(cloth()))
    planned = plan_pages(found.scene, ["positions", "normals"])
    settings = replace(Settings(), cloth_step=1 / 1000, cloth_substeps=64)
    for _ in range(2):
        frames = ClothFrames(found, settings, drawn_from(found, planned))
    assert frames.steps.substeps < 64
    assert len([text for text in found.source.warnings if "gains energy" in text]) == 1
