"""How many samples a pixel has: what the settings ask for, what the device offers, and what shaders are told of it."""

from __future__ import annotations

from collections.abc import Collection

from common.errors import UserError
from common.settings import AtMost

from ..scene.packing import Variant
from ..settings import Settings
from .views import PICTURE


def choose_samples(settings: Settings, offered: Collection[int], device: str) -> tuple[int, str]:
    """Return the samples of each pixel, and why they are fewer than a preset's wish, "" where they are not.

    `offered` are the numbers that the device has for the formats in use. Raises UserError for another number, unless it
    is `AtMost`: then the largest that is offered, and no larger than the wish, counts. A view has one.
    """
    wished = settings.shading.msaa
    if settings.shading.view != PICTURE:
        return 1, "the mean of a view's samples is no value of any surface" if wished > 1 else ""
    numbers = sorted(offered)
    shown = " or ".join(filter(None, (", ".join(map(str, numbers[:-1])), str(numbers[-1]))))
    if wished in numbers:
        return int(wished), ""
    if not isinstance(wished, AtMost):
        raise UserError(
            f"{device} draws {settings.shading.color_format} pictures with {shown} samples a pixel, "
            f"not with {wished}: set msaa to one of those."
        )
    most = max(number for number in numbers if number <= wished)
    return most, f"the preset wishes for {wished:d}, the device has {shown}"


def coverage_defines(variant: Variant, settings: Settings) -> tuple[tuple[str, int | float | str], ...]:
    """Return what makes a material's alpha mask end within pixels, where they have samples to end between."""
    if settings.shading.msaa > 1 and settings.shading.mask_coverage and variant.alpha_mode == "mask":
        return (("COVERAGE_SAMPLES", settings.shading.msaa),)
    return ()


def resolve_defines(settings: Settings) -> tuple[tuple[str, int | float | str], ...]:
    """Return what resolve.frag is built with."""
    weighted: tuple[tuple[str, int | float | str], ...] = (
        (("TONE_WEIGHTED", 1),) if settings.post.resolve == "tone-weighted" else ()
    )
    return (("SAMPLES", settings.shading.msaa), *weighted)
