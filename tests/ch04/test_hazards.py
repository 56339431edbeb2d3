"""The simulator that holds the frame graph's barriers: it finds every kind of hazard, and raises no false alarm.

Each case is a few events by hand, with what the specification says of them.
"""

from __future__ import annotations

import pytest

from tests.support.hazards import (
    Barriers,
    Dependency,
    Given,
    Signal,
    Submit,
    Use,
    Wait,
    find_hazards,
    is_safe,
)

barriers = pytest.mark.feature("frame-graph/barriers")
sharing = pytest.mark.feature("frame-graph/resource-aliasing")
DRAWN = ("color", "color_write")
SAMPLED = ("fragment", "sampled")


def use(resource, *touches, layout="", needs=None, fills=True, queue="main"):
    reads = any(not access.endswith("_write") for _, access in touches) if needs is None else needs
    return Use("somebody", resource, frozenset(touches), layout, reads, fills, queue)


def change(resource, first, second, old="", new=""):
    """A dependency between two lists such as "color:color_write": stages before the colon, accesses behind it."""
    (stages, _, access), (later, _, seen) = first.partition(":"), second.partition(":")
    sets = [frozenset(text.split()) for text in (stages, access, later, seen)]
    return Dependency(resource, *sets, old, new)


def barrier(*words, queue="main", **more):
    return Barriers((change(*words, **more),), queue)


FILLED = use("buffer", ("compute", "storage_write"))
READ = use("buffer", ("fragment", "storage_read"))
WRITTEN = use("buffer", ("fragment", "storage_write"))
TO_READ = barrier("buffer", "compute:storage_write", "fragment:storage_read")

SAFE = {
    "reading behind a barrier": [FILLED, TO_READ, READ],
    "reading along a chain": [
        FILLED,
        barrier("buffer", "compute:storage_write", "copy:copy_read"),
        barrier("buffer", "copy", "fragment:storage_read"),
        READ,
    ],
    "waiting is enough to write behind a read": [
        FILLED,
        TO_READ,
        READ,
        barrier("buffer", "fragment", "compute"),
        FILLED,
    ],
    "a barrier of another resource waits as well": [
        FILLED,
        TO_READ,
        READ,
        barrier("other", "fragment", "compute"),
        FILLED,
    ],
    "what is available may be written over": [
        FILLED,
        barrier("buffer", "compute:storage_write", "fragment"),
        WRITTEN,
    ],
    "reading twice": [FILLED, TO_READ, READ, READ],
    "an image that is cleared, sampled and cleared again": [
        barrier("image", "", "color:color_write", old="undefined", new="color"),
        use("image", DRAWN, layout="color"),
        barrier("image", "color:color_write", "fragment:sampled", old="color", new="read"),
        use("image", SAMPLED, layout="read"),
        barrier("image", "fragment", "color:color_write", old="undefined", new="color"),
        use("image", DRAWN, layout="color"),
    ],
    "another queue that waits": [
        FILLED,
        Signal("done"),
        Wait("done", queue="second"),
        use("buffer", ("compute", "storage_read"), queue="second"),
    ],
    "the host that waits, behind a barrier for it": [
        FILLED,
        barrier("buffer", "compute:storage_write", "host:host_read"),
        Signal("done"),
        Wait("done", queue="host"),
        use("buffer", ("host", "host_read"), queue="host"),
    ],
    "what the host wrote before work was submitted": [
        use("buffer", ("host", "host_write"), queue="host"),
        Submit(),
        READ,
    ],
    "what the owner says that one may read": [
        Given("buffer", frozenset({("fragment", "storage_read")})),
        READ,
    ],
    "what is ready for everybody": [Given("buffer"), READ, use("buffer", ("vertex", "uniform"))],
}

UNSAFE = {
    "nothing in between": ([FILLED, READ], "not ordered behind storage_write"),
    "waiting alone": ([FILLED, barrier("buffer", "compute", "fragment"), READ], "does not see"),
    "another stage": ([FILLED, TO_READ, use("buffer", ("vertex", "storage_read"))], "not ordered behind"),
    "another access": ([FILLED, TO_READ, use("buffer", ("fragment", "uniform"))], "does not see"),
    "another resource": (
        [FILLED, barrier("other", "compute:storage_write", "fragment:storage_read"), READ],
        "does not see",
    ),
    "a chain that is broken": (
        [
            FILLED,
            barrier("buffer", "compute:storage_write", "copy:copy_read"),
            barrier("buffer", "vertex", "fragment:storage_read"),
            READ,
        ],
        "not ordered behind",
    ),
    "barriers of one call are no chain": (
        [
            FILLED,
            Barriers(
                (
                    change("buffer", "compute:storage_write", "copy:copy_read"),
                    change("buffer", "copy", "fragment:storage_read"),
                )
            ),
            READ,
        ],
        "not ordered behind",
    ),
    "a chain that begins before it is available": (
        [
            FILLED,
            barrier("buffer", "compute", "copy"),
            barrier("buffer", "compute:storage_write", "vertex:uniform"),
            barrier("buffer", "copy", "fragment:storage_read"),
            READ,
        ],
        "does not see",
    ),
    "writing behind a read": ([FILLED, TO_READ, READ, FILLED], "not ordered behind storage_read"),
    "writing twice": ([FILLED, FILLED], "not ordered behind storage_write"),
    "writing over what is not available": (
        [FILLED, barrier("buffer", "compute", "fragment"), WRITTEN],
        "not yet available",
    ),
    "the wrong layout": (
        [
            barrier("image", "", "color:color_write", old="undefined", new="color"),
            use("image", DRAWN, layout="color"),
            barrier("image", "color:color_write", "fragment:sampled", old="color", new="general"),
            use("image", SAMPLED, layout="read"),
        ],
        "is in layout 'general', not 'read'",
    ),
    "a barrier that is wrong about the layout": (
        [
            Given("image", layout="read"),
            barrier("image", "", "color:color_write", old="general", new="color"),
        ],
        "is in layout 'read', not 'general'",
    ),
    "a change of layout under a reader": (
        [
            Given("image", layout="read"),
            use("image", SAMPLED, layout="read"),
            barrier("image", "color", "color:color_write", old="undefined", new="color"),
        ],
        "changes layout, not ordered behind sampled",
    ),
    "a change of layout of what is not available": (
        [
            Given("image", layout="color"),
            use("image", DRAWN, layout="color"),
            barrier("image", "color", "fragment:sampled", old="color", new="read"),
        ],
        "color_write of somebody in color is not available",
    ),
    "a change of layout that another stage does not see": (
        [
            Given("image", layout="color"),
            barrier("image", "", "fragment:sampled", old="color", new="read"),
            use("image", ("compute", "sampled"), layout="read"),
        ],
        "not ordered behind its change to layout 'read'",
    ),
    "content that nobody wrote": ([READ], "the content is lost"),
    "content that was given up": (
        [
            Given("image", layout="read"),
            barrier("image", "", "fragment:sampled", old="undefined", new="read"),
            use("image", SAMPLED, layout="read"),
        ],
        "the content is lost",
    ),
    "content that was not stored": (
        [
            Given("image", layout="color"),
            use("image", DRAWN, layout="color", fills=False),
            barrier("image", "color:color_write", "fragment:sampled", old="color", new="read"),
            use("image", SAMPLED, layout="read"),
        ],
        "the content is lost",
    ),
    "another queue that does not wait": (
        [FILLED, Signal("done"), use("buffer", ("compute", "storage_read"), queue="second")],
        "not ordered behind",
    ),
    "a signal of another stage": (
        [
            FILLED,
            Signal("done", ("fragment",)),
            Wait("done", queue="second"),
            use("buffer", ("compute", "storage_read"), queue="second"),
        ],
        "not ordered behind",
    ),
    "the host without a barrier for it": (
        [
            FILLED,
            Signal("done"),
            Wait("done", queue="host"),
            use("buffer", ("host", "host_read"), queue="host"),
        ],
        "does not see",
    ),
    "the host that does not wait": (
        [
            FILLED,
            barrier("buffer", "compute:storage_write", "host:host_read"),
            use("buffer", ("host", "host_read"), queue="host"),
        ],
        "not ordered behind",
    ),
    "what the host wrote after work was submitted": (
        [Submit(), use("buffer", ("host", "host_write"), queue="host"), READ],
        "not ordered behind host_write",
    ),
    "an owner who let others read": (
        [Given("buffer", frozenset({("vertex", "uniform")})), READ],
        "not ordered behind its owner's writing",
    ),
    "an owner who still writes": (
        [Given("buffer", frozenset({("copy", "copy_write")})), READ],
        "not ordered behind its owner's use",
    ),
}


@barriers
@pytest.mark.parametrize("name", SAFE)
def test_what_is_ordered_and_visible_is_no_hazard(name):
    assert [str(hazard) for hazard in find_hazards(SAFE[name])] == []
    assert is_safe(SAFE[name])


@barriers
@pytest.mark.parametrize("name", UNSAFE)
def test_each_kind_of_hazard_is_found(name):
    events, text = UNSAFE[name]
    found = [str(hazard) for hazard in find_hazards(events)]
    assert any(text in hazard for hazard in found), found
    assert not is_safe(events)


@barriers
def test_resources_that_share_bytes_overwrite_each_other():
    first, second = use("first", ("compute", "storage_write")), use("second", ("compute", "storage_write"))
    again = barrier("second", "compute:storage_write", "compute:storage_read storage_write")
    read = use("first", ("compute", "storage_read"))
    events = [
        first,
        again,
        second,
        again,
        barrier("first", "compute:storage_write", "compute:storage_read"),
        read,
    ]
    assert find_hazards(events, {"first": (0, 0, 64), "second": (1, 0, 64)}) == []
    assert find_hazards(events, {"first": (0, 0, 64), "second": (0, 64, 128)}) == []
    together = find_hazards(events, {"first": (0, 0, 64), "second": (0, 63, 128)})
    assert {hazard.text for hazard in together} == {"is read, but the content is that of 'second'"}


@barriers
@sharing
def test_memory_is_taken_over_from_all_who_used_its_bytes():
    """An image over the bytes of two buffers waits for both: each of the stretches has its own last users."""
    places = {"low": (0, 0, 64), "high": (0, 64, 128), "image": (0, 32, 96)}
    low, high = use("low", ("compute", "storage_write")), use("high", ("copy", "copy_write"))
    draw = use("image", DRAWN, layout="color")

    def events(first):
        taken = barrier("image", first, "color:color_write", old="undefined", new="color")
        return [low, high, taken, draw]

    assert is_safe(events("compute copy:storage_write copy_write"), places)
    for first in ("compute:storage_write", "copy:copy_write", "compute copy:copy_write"):
        assert not is_safe(events(first), places)
