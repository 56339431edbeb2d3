"""The code of shading rates, and the pixel of a block that is lit."""

from __future__ import annotations

import pytest

from chapters.ch09.rates import model
from chapters.ch09.settings import Settings
from common.settings import replaced

CODES = {
    0: (1, 1),
    1: (1, 2),
    2: (1, 4),
    4: (2, 1),
    5: (2, 2),
    6: (2, 4),
    8: (4, 1),
    9: (4, 2),
    10: (4, 4),
}


@pytest.mark.feature("vrs/rate-encoding")
def test_codes_are_those_of_the_extension():
    assert {code: model.decode(code) for code in CODES} == CODES
    assert {model.encode(*block): block for block in CODES.values()} == CODES
    assert model.coarse_code(replaced(Settings(), rate_coarse="4x4")) == 10


@pytest.mark.feature("vrs/rate-encoding")
@pytest.mark.parametrize("code", [3, 7, 11, 12, 15, 16, -1])
def test_other_numbers_are_no_codes(code):
    with pytest.raises(ValueError, match="no code of a shading rate"):
        model.decode(code)


@pytest.mark.parametrize("block", [(3, 1), (0, 2), (8, 8)])
def test_other_blocks_have_no_code(block):
    with pytest.raises(ValueError, match="sides of 1, 2 or 4"):
        model.encode(*block)
