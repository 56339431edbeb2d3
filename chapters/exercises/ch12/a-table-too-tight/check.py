"""Layouts of binding tables for devices with different alignments, against the rules of vkCmdTraceRaysKHR."""

from __future__ import annotations

from typing import Any

from tools.exercises.checking import Given

DEVICES = ((32, 16, 32), (32, 32, 64), (32, 64, 64), (24, 16, 128), (48, 32, 64))
COUNTS = ((1, 1, 1, 0), (1, 2, 1, 0), (1, 2, 5, 3), (1, 0, 3, 1))
NAMES = ("generation", "miss", "hit", "callable")


def check(given: Given) -> None:
    """Addresses, strides and sizes of all regions."""
    module: Any = given.module("pipelines.vulkan_rays")
    for size, alignment, base in DEVICES:
        device = f"With handles of {size} bytes and alignments of {alignment} and {base}"
        limits = module.RayLimits(size, alignment, base, 1, 1 << 30, 4096)
        for counts in COUNTS:
            regions, end = module.table_layout(counts, limits)
            taken = 0
            for name, count, region in zip(NAMES, counts, regions, strict=True):
                if not count:
                    given.need(region.size == region.stride == 0, f"{device} an empty region has a size.")
                    continue
                given.need(
                    region.offset % base == 0,
                    f"{device} the region of {name} begins at {region.offset} bytes.",
                )
                given.need(
                    region.stride % alignment == 0 and region.stride >= size,
                    f"{device} records of {name} are {region.stride} bytes apart.",
                )
                given.need(
                    region.size == count * region.stride,
                    f"{device} the region of {name} has {region.size} bytes for {count} records.",
                )
                given.need(
                    region.offset >= taken, f"{device} the region of {name} begins inside the one before."
                )
                taken = region.offset + region.size
            given.need(
                regions[0].size == regions[0].stride, f"{device} stride and size of generation differ."
            )
            given.need(end >= taken, f"{device} the table ends before its last region.")
