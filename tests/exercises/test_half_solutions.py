"""Solutions that are right at first sight: the checks of exercises have to see what is missing."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import pytest

from chapters.exercises import checking, find
from chapters.exercises.patches import states
from chapters.folders import Folder
from chapters.trees import write_files

pytestmark = pytest.mark.feature("tools/exercises")

CASES = {
    "unsorted": (
        (2, "set-table"),
        ("logic/set_table.py", "(one.set, one.binding, _name(one))", "(one.set, one.kind, _name(one))"),
        "should be",
    ),
    "open though closed": (
        (2, "set-table"),
        ("logic/set_table.py", ".counts[:1] == (0,)", ".counts != ()"),
        'should be "set 0 binding 4: storage Table_, 48 bytes"',
    ),
    "leaked": (
        (2, "reused-slot"),
        ("graphics/bindless.py", "self._resources.defer(lambda: self._give_back(kind, slot))", "pass"),
        "never given out again",
    ),
    "written too early": (
        (2, "reused-slot"),
        (
            "graphics/bindless.py",
            "self._resources.defer(lambda: self._give_back(kind, slot))",
            "self._queue[kind, slot] = self._dummy[kind]\n"
            "        self._resources.defer(lambda: self._slots[kind].give_back(slot))",
        ),
        "the next frame writes it",
    ),
    "a pool for each thread, whatever the frame": (
        (3, "pool-of-another"),
        ("graphics/command_pools.py", "pool_index(slot.index, self._workers", "pool_index(0, self._workers"),
        "Two frame slots",
    ),
    "hashed every time": (
        (3, "put-back-times"),
        ("logic/scene_sources.py", "(found != state or racy)", "True"),
        "read and hashed all the same",
    ),
    "refused unasked": (
        (3, "put-back-times"),
        (
            "logic/scene_sources.py",
            "        if found.size >= 0 and",
            "        if found != state:\n            return False\n        if found.size >= 0 and",
        ),
        "of another time and the same content",
    ),
    "both the other way round": (
        (3, "wrong-way-round"),
        ("graphics/upload_barriers.py", "families = (giver, taker)", "families = (taker, giver)"),
        "the release says",
    ),
    "equals by the last": (
        (3, "critical-path"),
        ("logic/critical_path.py", "max(step.after, key", "max(reversed(step.after), key"),
        "named first",
    ),
    "shared with nobody": (
        (4, "one-step-short"),
        ("logic/graph_memory.py", "if lives[other][1] >= first", "if lives[other][1] >= 0"),
        "512 bytes do",
    ),
    "black behind everything": (
        (4, "empty-sky"),
        ("shaders/lighting.frag", "        sky();", "        out_color = vec4(0.0);"),
        "With background=0.25",
    ),
    "who reads what was written is no writer": (
        (4, "no-new-layout"),
        ("logic/graph_barriers.py", "both is None or both.writes", "both is None or touch.writes"),
        "visible to the first reader",
    ),
    "squared": (
        (4, "natural-vignette"),
        ("shaders/vignette.frag", "pow(cosine, 4.0)", "pow(cosine, 2.0)"),
        "of the light is left",
    ),
    "darker without an angle": (
        (4, "natural-vignette"),
        ("shaders/vignette.frag", "frame.orthographic != 0u ? 1.0 : ", ""),
        "parallel rays",
    ),
    "there without being asked for": (
        (4, "natural-vignette"),
        ("passes/vignette.py", "settings.vignette and ", ""),
        "runs all the same",
    ),
    "by name alone": (
        (4, "fewest-bytes"),
        ("logic/order_bytes.py", "(sum(behind(name).values()), name)", "name"),
        "One branch",
    ),
    "by the peak": (
        (1, "reinhard"),
        (
            "shaders/tonemap.frag",
            "color / (1.0 + color)",
            "color / (1.0 + max(color.r, max(color.g, color.b)))",
        ),
        "each channel",
    ),
    "instead of another curve": (
        (1, "reinhard"),
        ("shaders/tonemap.frag", "color = tone_neutral(color);", "color = color / (1.0 + color);"),
        "is not what it was",
    ),
    "without an orthographic camera": (
        (1, "facing-view"),
        ("shaders/views.glsl", "frame.orthographic != 0u ? frame.world_from_view[2].xyz : to_eye", "to_eye"),
        "leans by",
    ),
    "without an eye": (
        (1, "facing-view"),
        (
            "shaders/views.glsl",
            "frame.orthographic != 0u ? frame.world_from_view[2].xyz : to_eye",
            "frame.world_from_view[2].xyz",
        ),
        "before an eye",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_half_solution_is_not_enough(case, tmp_path, request):
    which, (path, old, new), said = CASES[case]
    exercise = find(*which)
    tree = dict(states(exercise).solution)
    text = tree[path].decode()
    assert text.count(old) == 1
    write_files(tmp_path, {**tree, path: text.replace(old, new).encode()})
    backend = exercise.backends[0] if exercise.backends else ""
    held = request.getfixturevalue("vulkan_device") if backend else None
    one = replace(exercise, backends=(backend,) if backend else ())
    wrong = checking.check(one, Folder(tmp_path.resolve()), lambda backend: nullcontext(held))
    assert wrong is not None and said in wrong
