"""The binding table of the chapter's ray pipeline, on two kinds of device."""

from __future__ import annotations

from chapters.ch12.pipelines.vulkan_rays import RayLimits, Region, table_layout
from chapters.ch12.rays.groups import MISSES, ray_description
from tools.site.figures.canvas import Canvas

DEVICES = {
    "handles of 32 bytes; alignment of handles 16, of regions 32": RayLimits(32, 16, 32, 1, 1 << 30, 4096),
    "handles of 32 bytes; alignment of handles 32, of regions 64": RayLimits(32, 32, 64, 1, 1 << 30, 4096),
}
"""Numbers of a software driver, and those that GPUs have."""
NAMES = ("generation", "miss", "hit", "callable")


def counts() -> tuple[int, int, int, int]:
    """Return the records of each region of the chapter's pipeline."""
    described = ray_description("rays/picture.rgen")
    return 1, len(described.miss), len(described.hits), len(described.callables)


def regions_of(limits: RayLimits) -> tuple[tuple[Region, ...], int]:
    """Return the regions, and the bytes of the table."""
    return table_layout(counts(), limits)


def binding_table() -> Canvas:
    """A bar of bytes for each device, and what names a record."""
    c = Canvas(760, 340, "The binding table: regions and records by the alignments of two devices")
    scale, left = 3.0, 30.0
    files = ("picture.rgen", *(name.rpartition("/")[2] for name in MISSES), "hit.rchit")
    for number, (title, limits) in enumerate(DEVICES.items()):
        y = 56.0 + 120 * number
        regions, end = regions_of(limits)
        c.text(left, y - 14, title, 13, bold=True)
        c.rectangle((left, y, scale * end, 34), "paper", "line", True, 0)
        record = 0
        for region, name, count, fill in zip(regions, NAMES, counts(), ("a", "b", "c", "d"), strict=True):
            for place in range(count):
                x = left + scale * (region.offset + place * region.stride)
                c.box(x, y, scale * limits.handle_size, 34, files[record], fill, 11, round=0)
                record += 1
            if count:
                c.note(
                    left + scale * region.offset, y + 52 + 16 * (name == "miss"), f"{name} at {region.offset}"
                )
        c.text(left + scale * end + 8, y + 22, f"{end} bytes", 12)
    c.note(
        left, 290, "A hit takes record: instance offset + ray offset + geometry x ray stride, here always 0."
    )
    c.note(left, 310, "A miss takes the record that the call names: 0 for trace, 1 for occluded.")
    return c
