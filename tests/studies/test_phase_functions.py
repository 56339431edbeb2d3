"""The study phase-functions: its integrals, both forms against float64, and a picture that shows them."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch10.studies.phase_functions import Settings, anisotropies, table
from chapters.ch10.studies.phase_functions.exact import directions, nodes
from common.errors import SettingError
from common.settings import apply_overrides
from tests.support.bounds import codes_off
from tests.twins.fog import henyey_greenstein

pytestmark = pytest.mark.feature("fog/henyey-greenstein")
WHICH, SIZE = "10/phase-functions", (320, 160)
ULP = 2.0**-24
G = np.array([-0.5, 0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.99], np.float32).astype(np.float64)

NODE = 28 * ULP
"""What steps of Vulkan's precision leave in the stable form, relative; tests/shaders/test_phase.py counts them."""

BETWEEN = NODE + 1.5 * 8 * ULP
"""The same with 1 - cos from directions. Its three differences round once each and count twice, three products and two
sums follow, and lengths of the vectors are off by half a step each; d^(3/2) has that one and a half times."""


@pytest.fixture(scope="module")
def drawn(stage):
    with stage.open(WHICH, SIZE) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return renderer.values(), frame.image("color"), frame.work


def between():
    """Return the truth of both forms (8, 512): the twin at the angle between the directions, in float64."""
    first, leaving = (vectors.astype(np.float64) for vectors in directions())
    cosine = leaving @ first / (np.linalg.norm(first) * np.linalg.norm(leaving, axis=1))
    sine = np.linalg.norm(np.cross(first, leaving), axis=1)
    # tan of half the angle is exact near the peak, where the cosine is not.
    angle = np.arctan2(sine / (np.linalg.norm(first) * np.linalg.norm(leaving, axis=1)), cosine)
    return henyey_greenstein(2 * np.sin(angle / 2) ** 2, G[:, None])


def test_it_integrates_to_1_with_mean_cosine_g(drawn):
    """1e-6 and what rounding may leave of all values at once: the node's and the function's."""
    values, *_ = drawn
    rows = table(Settings(), values)
    assert rows["g"].tolist() == G.tolist()
    for row, g in zip(rows, G, strict=True):
        most = 1e-6 if g <= 0.9 else NODE + 1.5 * ULP
        assert abs(row["integral"] - 1) <= most and abs(row["mean_cosine"] - g) <= most, g
    wrong = table(Settings(), values * np.float32(1.00001))
    assert (np.abs(wrong["integral"] - 1) > 5e-6).all()


def test_the_nodes_are_a_quadrature(drawn):
    """Of polynomials, and of what has a peak at 0."""
    at, weights = nodes()
    assert weights.sum() == pytest.approx(2, rel=1e-14) and weights @ at**5 == pytest.approx(
        2**6 / 6, rel=1e-13
    )
    assert weights @ (1 / (1e-4 + at)) == pytest.approx(np.log(20001), rel=1e-9)
    assert (np.diff(at) > 0).all() and len(at) == 512


def test_the_stable_form_is_exact_at_nodes_and_between_directions(drawn):
    values, *_ = drawn
    at = nodes()[0].astype(np.float32).astype(np.float64)
    node, direct = henyey_greenstein(at, G[:, None]), between()
    assert np.abs(values[..., 0] / node - 1).max() <= NODE
    assert np.abs(values[..., 1] / direct - 1).max() <= BETWEEN
    assert table(Settings(), values)["stable"].max() <= BETWEEN


def test_the_usual_form_loses_digits_as_the_peak_narrows(drawn):
    """Its d is a sum of numbers up to 4 with 12 roundings or so, of which (1 - g)^2 is left: at worst
    1.5 x 12 x 2 ULP / (1 - g)^2. The largest of 512 is above a hundredth of that."""
    values, *_ = drawn
    rows, direct = table(Settings(), values), between()
    off = np.abs(values[..., 2] / direct - 1).max(axis=1)
    assert np.abs(off - rows["usual"]).max() <= 1e-9
    narrow = (1 - np.abs(G)) ** 2
    assert (off <= 1.5 * 24 * ULP / narrow + NODE).all()
    assert (off[4:] > 0.15 * ULP / narrow[4:]).all()
    assert (off[5:] > 10 * rows["stable"][5:]).all() and off[7] > 1e-4


def test_counters_are_the_table_in_parts_of_a_milliard(drawn):
    values, _, work = drawn
    for row in table(Settings(), values):
        g = round(100 * float(row["g"]))
        assert work[f"integral_{g}"] == pytest.approx(1e9 * abs(row["integral"] - 1), abs=0.51)
        assert work[f"cosine_{g}"] == pytest.approx(1e9 * abs(row["mean_cosine"] - row["g"]), abs=0.51)
        assert work[f"stable_{g}"] == pytest.approx(1e9 * row["stable"], abs=0.51)
        assert work[f"usual_{g}"] == pytest.approx(1e9 * row["usual"], abs=0.51)
    assert (work["dispatches"], work["draws"]) == (1, 1)


def test_lobes_have_the_radius_of_the_logarithm(stage, drawn):
    """A pixel that no outline and no ring is near shows how many lobes it is in."""
    _, picture, _ = drawn
    width, height = 192, 160
    y, x = np.mgrid[:height, :width] + 0.5
    scale = 1 / (0.62 * width)
    right, down = (x - 0.36 * width) * scale, (y - 0.5 * height) * scale
    far = np.hypot(right, down)
    apart = 1 - right / far
    clear = np.abs(far * 7.5 - np.round(far * 7.5)) > 2 * scale * 7.5
    color = np.full((height, width, 3), (0.05, 0.05, 0.06))
    counts = np.zeros((height, width), int)
    for lobe, g in enumerate(G):
        outside = far - (np.log10(4 * np.pi * henyey_greenstein(apart, g)) + 3) / 7.5
        slope = np.hypot(*np.gradient(outside))
        clear &= np.abs(outside) > 2 * slope + 0.5 * scale
        own = np.array([0.2, 0.4, 0.95]) + lobe / 7 * np.array([0.8, 0.3, -0.8])
        color = np.where((outside < 0)[..., None], 0.88 * color + 0.12 * own, color)
        counts += outside < 0
    assert clear.mean() > 0.3 and {*np.unique(counts[clear])} >= {0, 1, 8}
    off = np.abs(picture[:, :width] - 255 * color)[clear]
    assert off.max() <= codes_off(stage.device) + 0.1


def test_bars_show_the_errors_of_both_forms(stage, drawn):
    """A bar ends within a pixel of where log10 of the values' own error is; 8 decades are 90 % of 20 pixels high."""
    values, picture, _ = drawn
    truth, right = between(), picture[:, 192:].astype(int)
    for lobe in range(8):
        row = right[20 * lobe : 20 * (lobe + 1)]
        red, green = (row[..., 0] > 150) & (row[..., 1] < 100), (row[..., 1] > 150) & (row[..., 0] < 100)
        for column in range(0, 128, 5):
            points = slice(column * 4, column * 4 + 4)
            stable, usual = (
                np.abs(values[lobe, points, form] / truth[lobe, points] - 1).max() for form in (1, 2)
            )
            heights = [18 * np.clip(np.log10(max(off, 1e-30)) / 8 + 1, 0, 1) for off in (stable, usual)]
            # The truth that a shader has and this one differ by 2^-48 or so; near 10^-8 that may count.
            assert abs(green[:, column].sum() - heights[0]) <= 1.1, (lobe, column)
            over = max(heights[1] - heights[0], 0)
            assert abs(red[:, column].sum() - over) <= 1.6, (lobe, column)
    assert (right[140:160, :64, 0] > 150).sum() > 2 * (right[80:100, :64, 0] > 150).sum()


def test_the_last_row_is_that_of_the_settings(stage):
    settings = Settings(anisotropy=0.25)
    with stage.open(WHICH, (48, 36), settings=settings) as renderer:
        renderer.render(chapters.view_of(renderer)).image("color")
        values = renderer.values()
    at = nodes()[0].astype(np.float32).astype(np.float64)
    assert anisotropies(settings)[-1] == 0.25
    assert np.abs(values[-1, :, 0] / henyey_greenstein(at, 0.25) - 1).max() <= NODE


@pytest.mark.parametrize("value", ["1", "0.995", "-0.1", "nan"])
def test_an_anisotropy_of_1_or_beyond_is_refused_in_one_sentence(value):
    with pytest.raises(SettingError, match="anisotropy") as found:
        apply_overrides(Settings(), [f"anisotropy={value}"])
    assert "\n" not in str(found.value)
