"""Which backend draws: a table of machines, children that crash or hang, and this machine itself."""

from __future__ import annotations

import sys

import pytest

from backends import choice
from backends.choice import choose, decide
from backends.gl.driver import probe
from backends.selftest.verdicts import Identity
from common.errors import UnsupportedError, UserError

NONE = None


def machine(vulkan, gl):
    """Return a probe that answers with kinds (None: not there), and the list of what it was asked."""
    asked = []

    def ask(backend):
        asked.append(backend)
        kind = {"vulkan": vulkan, "gl": gl}[backend]
        if kind is None:
            raise UnsupportedError(f"No {backend} was found (why): ./strata doctor says what to install.")
        return kind, f"a {kind} device of {backend}"

    return ask, asked


@pytest.mark.parametrize(
    ("vulkan", "gl", "gpu", "chosen", "questions"),
    [
        ("discrete", "discrete", True, "vulkan", ["vulkan"]),
        ("integrated", "discrete", True, "vulkan", ["vulkan"]),
        ("virtual", NONE, True, "vulkan", ["vulkan"]),
        ("software", "discrete", True, "gl", ["vulkan", "gl"]),
        ("software", "virtual", True, "gl", ["vulkan", "gl"]),
        ("software", "software", True, "vulkan", ["vulkan", "gl"]),
        ("software", NONE, True, "vulkan", ["vulkan", "gl"]),
        ("software", "discrete", False, "vulkan", ["vulkan"]),
        (NONE, "discrete", True, "gl", ["vulkan", "gl"]),
        (NONE, "software", True, "gl", ["vulkan", "gl"]),
        (NONE, "software", False, "gl", ["vulkan", "gl"]),
    ],
)
def test_hardware_comes_before_software_and_vulkan_before_opengl(vulkan, gl, gpu, chosen, questions):
    """OpenGL is asked only where its answer could change the choice."""
    ask, asked = machine(vulkan, gl)
    found = decide("auto", ask, lambda: gpu)
    assert found.backend == chosen == choose("auto", ask, lambda: gpu)
    assert asked == questions * 2
    assert found.reason and not found.reason.endswith(".")
    if vulkan is None:
        assert "no vulkan was found (why)" in found.reason  # it says so when it moves on
    if gl is None and "gl" in questions:
        assert "no gl was found (why)" in found.reason


@pytest.mark.parametrize(
    ("vulkan", "gl", "gpu", "reason"),
    [
        ("discrete", NONE, True, "Vulkan on a discrete device of vulkan"),
        (
            "software",
            "discrete",
            True,
            "OpenGL on a discrete device of gl, since Vulkan has a software driver only",
        ),
        (NONE, "discrete", True, "OpenGL on a discrete device of gl, since no vulkan was found (why)"),
        (
            "software",
            NONE,
            False,
            "Vulkan's software driver, since there is no GPU (a software device of vulkan)",
        ),
        (
            "software",
            "software",
            True,
            "Vulkan's software driver, since no GPU was found (a software device of vulkan)",
        ),
        (
            "software",
            NONE,
            True,
            "Vulkan's software driver, since no GPU was found (a software device of vulkan), and no gl was found (why)",
        ),
        (
            NONE,
            "software",
            True,
            "OpenGL's software driver (a software device of gl), since no vulkan was found (why)",
        ),
    ],
)
def test_each_choice_says_why_the_other_backend_was_not_taken(vulkan, gl, gpu, reason):
    assert decide("auto", machine(vulkan, gl)[0], lambda: gpu).reason == reason


def test_a_backend_that_was_asked_for_says_so():
    ask, _ = machine("software", "software")
    assert decide("vulkan", ask).reason == "asked for"
    assert decide("gl", ask).reason == "asked for, on a software device of gl"


def test_a_machine_with_neither_says_what_to_install():
    with pytest.raises(UnsupportedError) as caught:
        choose("auto", machine(NONE, NONE)[0])
    text = str(caught.value)
    assert "neither Vulkan 1.3 nor OpenGL 4.5" in text and "apt install mesa-vulkan-drivers" in text
    assert "\n" not in text and text.endswith(".")


def test_what_is_asked_for_is_taken_or_refused_with_the_reason():
    ask, asked = machine("software", "software")
    assert choose("vulkan", ask) == "vulkan" and choose("gl", ask) == "gl"
    assert asked == ["vulkan", "gl"]  # which tries the driver, where it was not tried yet
    with pytest.raises(UnsupportedError, match=r"No gl was found \(why\)"):
        choose("gl", machine("discrete", NONE)[0])
    with pytest.raises(UserError, match=r"There is no backend 'opengl'"):
        choose("opengl", ask)
    with pytest.raises(UserError, match=r"'vulcan'; did you mean 'vulkan'\?$"):
        choose("vulcan", ask)


# --- the child --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "its driver crashed, exit code -11"),
        ("import time; time.sleep(60)", "its driver hung for 0.5 s"),
        ("print('not json')", "its driver crashed, exit code 0"),
        ("print('[]')", "its driver crashed, exit code 0"),
        ("""print('{"problem": "No OpenGL."}')""", "No OpenGL."),
    ],
    ids=["crash", "hang", "noise", "other json", "problem"],
)
def test_a_driver_that_crashes_or_hangs_counts_as_none(code, said):
    if sys.platform == "win32" and "SIGSEGV" in code:
        pytest.skip("signals are those of POSIX")
    with pytest.raises(UnsupportedError) as caught:
        probe.ask([sys.executable, "-c", code], timeout_s=0.5 if "sleep" in code else 30.0)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_the_last_line_counts():
    """Drivers print to the standard output."""
    answer = '{"kind": "discrete", "device": "a card", "driver": "1", "build": "2", "advertised": ["fp64"]}'
    found = probe.ask([sys.executable, "-c", f"print('MESA: hello'); print({answer!r})"])
    assert found == probe.Found("discrete", Identity("a card", "1", "2"), ("fp64",))
    with pytest.raises(UnsupportedError, match="no process could be started"):
        probe.ask(["/no/such/python"])


def test_this_machine(gl_context):
    """The child says what a context says here, and `auto` finds something."""
    assert choice.probe("gl") == (gl_context.capabilities.kind, gl_context.capabilities.device)
    assert choose() in ("vulkan", "gl")
