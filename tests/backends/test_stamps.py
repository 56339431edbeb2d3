"""What ran at the same time: intervals against counting, and the stamps of a device that draws."""

from __future__ import annotations

import numpy as np
import pytest

from backends.vulkan.once import submit_once
from backends.vulkan.stamps import Stamps, can_stamp, common_ms, merged


def test_what_two_lists_have_in_common_is_what_counting_says():
    """Whole numbers: each unit of time belongs to a list or does not."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        lists = []
        for _ in range(2):
            begins = rng.integers(0, 40, rng.integers(0, 8))
            lists.append([(float(begin), float(begin + rng.integers(0, 9))) for begin in begins])
        units = [{unit for begin, end in one for unit in range(int(begin), int(end))} for one in lists]
        assert common_ms(*lists) == common_ms(*reversed(lists)) == len(units[0] & units[1])
        for one, covered in zip(lists, units, strict=True):
            assert sum(end - begin for begin, end in merged(one)) == len(covered)


@pytest.mark.variants("vulkan")
def test_every_submission_is_stamped_and_the_device_is_left_as_it_was(vulkan_device):
    if not can_stamp(vulkan_device):
        pytest.skip("the device has no timestamps")
    before = vulkan_device.fn.vkQueueSubmit2
    stamps = Stamps(vulkan_device)
    try:
        for _ in range(3):
            with submit_once(vulkan_device):
                pass
        found = stamps.timeline()
    finally:
        stamps.close()
    assert vulkan_device.fn.vkQueueSubmit2 is before
    assert list(found) == ["graphics"] and len(found["graphics"]) == 3
    ends = [end for _, end in found["graphics"]]
    assert all(begin <= end for begin, end in found["graphics"]) and ends == sorted(ends)
