"""Frames in which something is written and then used without another layout: a barrier has to stand between."""

from __future__ import annotations

from typing import Any

from backends.contract import Access
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """A buffer, an image for shaders to write, a target that is drawn on; readers in a row share a barrier."""
    _between(
        given,
        "a buffer that a compute shader fills and two others read",
        ((), (Access("sums", "storage", bytes=256),)),
        ((Access("sums", "storage"),), (Access("one", "storage", bytes=256),)),
        ((Access("sums", "storage"), Access("one", "storage")), (Access("out", "storage", bytes=256),)),
    )
    _between(
        given,
        "an image that shaders store to and load from",
        ((), (Access("sums", "storage", format="rgba16f"),)),
        ((Access("sums", "storage"),), (Access("one", "storage", bytes=256),)),
        ((Access("sums", "storage"), Access("one", "storage")), (Access("out", "storage", bytes=256),)),
    )
    drawn = _barriers(
        given,
        ((), (Access("lit", "color", format="rgba16f", clear=(0.0,) * 4),)),
        ((), (Access("out", "color", of="lit", format="rgba16f"),)),
    )
    given.need(
        drawn[1].get("lit") == {"color_write"},
        "Of a target that is drawn to and then blended over, nothing makes the first drawing visible to the second.",
    )
    again = _graph(
        given,
        ((), (Access("sums", "storage", bytes=256),)),
        ((Access("sums", "storage"),), (Access("one", "storage", bytes=256),)),
        ((Access("sums", "indirect"), Access("one", "storage")), (Access("two", "storage", bytes=256),)),
        ((Access("two", "storage"),), (Access("out", "storage", of="sums", bytes=256),)),
    ).steps[3]
    waited = {
        stage for barrier in again.barriers if barrier.resource == "sums" for stage in barrier.before.stages
    }
    given.need(
        waited >= {"compute", "indirect"},
        "A pass writes a buffer again that two passes have read in different ways, and waits for one of them alone.",
    )


def _between(given: Given, what: str, *passes: tuple[tuple[Access, ...], tuple[Access, ...]]) -> None:
    found = _barriers(given, *passes)
    given.need(
        found[1].get("sums") == {"storage_write"},
        f"Of {what}, nothing makes what was written visible to the first reader.",
    )
    given.need(
        "sums" not in found[2], f"Of {what}, the second reader waits for the first, which wrote nothing."
    )


def _barriers(
    given: Given, *passes: tuple[tuple[Access, ...], tuple[Access, ...]]
) -> list[dict[str, set[str]]]:
    """Return by step the resources that have a barrier, with the writing that it makes visible."""
    return [
        {
            barrier.resource: {access for access in barrier.before.access if access.endswith("_write")}
            for barrier in step.barriers
        }
        for step in _graph(given, *passes).steps
    ]


def _graph(given: Given, *passes: tuple[tuple[Access, ...], tuple[Access, ...]]) -> Any:
    node, compiler = given.module("graph.types").Node, given.module("graph.frame_graph")
    nodes = [node(f"pass {number}", reads, writes) for number, (reads, writes) in enumerate(passes)]
    return compiler.compile_graph(nodes, (8, 8), {"out"})
