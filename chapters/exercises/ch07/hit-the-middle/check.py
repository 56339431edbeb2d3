"""The lamps of each bin against their intervals of depth, and the picture against brute force."""

from __future__ import annotations

from tests.support.lamps import lit_town
from tests.support.light_lists import Lists
from tests.support.towns import walk
from tests.twins.light_lists import built
from tools.exercises.checking import Given

SIZE = (61, 35)
CUTOFF = 0.001
"""The default of `light_cutoff`, in lux."""


def check(given: Given) -> None:
    """70 lamps, of which some reach through hundreds of bins, and others through a few."""
    scene, view = lit_town(70), walk()[0]
    with given.open(scene, SIZE, ("color_linear",), light_lists="bins", graph="deferred") as renderer:
        picture = renderer.render(view).image("color_linear").copy()
        found = Lists(renderer)
    given.silent()
    least, most = (built(scene, view, SIZE, CUTOFF, wider).intervals for wider in (0.0, 1e-3))
    for place, lamp in enumerate(found.order.tolist()):
        near, far = least[lamp]
        first, last = found.bin_of(least[lamp])
        lowest, highest = found.bin_of(most[lamp])
        reach = (
            f"Lamp {lamp} reaches from {max(near, 0.0):.2f} m to {far:.2f} m, which is bin {first} to {last}"
        )
        ahead = far >= 0
        for number in range(first, last + 1) if ahead else ():
            given.need(found.depths[number, place], f"{reach}, and has no bit in bin {number}.")
            low, high = found.bins[number]
            given.need(
                low <= place + 1 <= high,
                f"{reach}. It is number {place + 1} in the order, and bin {number} says that its lamps are {low} to "
                f"{high}.",
            )
        for number in range(len(found.bins)):
            outside = not lowest <= number <= highest or most[lamp, 1] < 0
            given.need(
                not (outside and found.depths[number, place]), f"{reach}, and has a bit in bin {number}, too."
            )
    for number, (low, high) in enumerate(found.bins.tolist()):
        places = found.depths[number].nonzero()[0] + 1
        wanted = (places.min(), places.max()) if len(places) else (0xFFFF, 0)
        given.need(
            (low, high) == wanted,
            f"Bin {number} has the lamps {wanted[0]} to {wanted[1]} of the order, and says {low} to {high}.",
        )
    brute = given.draw(scene, view, size=SIZE, light_lists="brute", graph="deferred")
    other = int((picture != brute).any(axis=-1).sum())
    given.need(other == 0, f"{other} pixels are not what they are with light_lists=brute.")
