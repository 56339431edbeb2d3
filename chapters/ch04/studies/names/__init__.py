"""Study: step 1 of the frame graph. The order of the passes, and which of them run, follow from names.

A pass declares the names that it reads and the name that it writes. `connect` finds the writer of each name: an edge
from the writer to each reader. It goes backwards from what the frame has to deliver, and leaves out the passes that it
does not reach. `order` sorts the others so that each runs after the passes that it reads from.

There is no more yet. Every name has an image of its own, and before each pass a barrier waits for all earlier work.
The study `barriers` replaces this barrier, the study `memory` the images.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.lessons import Study
from common.settings import knob

from ...graph.names import Wiring, connect
from ...graph.order import order
from ..glow import SHOWN, declared

STUDY = Study(
    title="step 1: names",
    idea="Passes declare what they read and write, and the order of the frame follows from these names alone.",
    order=1,
    features=("frame-graph/edges",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    show: str = knob("glow", "the result that the last pass reads", choices=SHOWN)
    shuffle: int = knob(0, "seed of the order in which the passes are declared", minimum=0, maximum=1000)


def frame(settings: Settings) -> tuple[list[str], Wiring]:
    """Return the names of the passes in the order of the frame, and how they are connected."""
    wiring = connect(declared(settings.shuffle, settings.show), {}, {})
    names = [node.name for node in wiring.nodes]
    return order(names, wiring.edges, {name: {} for name in names}), wiring
