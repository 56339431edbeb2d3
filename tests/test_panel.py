"""The panel without a window: which widget a setting gets, what a user's hand makes of it, and what is drawn."""

from __future__ import annotations

import dataclasses
import os
import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import chapters
from backends.window import Event
from common.settings import Grouped, flat, group, knob, knobs, preset
from common.view.draw_lists import FONT
from tests.support.panel import PanelUser, example, seen
from tools.lessons.places import places_of
from tools.panel import imgui
from tools.panel.knobs import value_of, widget_of, widgets
from tools.panel.panel import EV_RANGE, History, PanelActions, open_panel, preset_of
from tools.panel.reference import ReferenceState


@dataclass
class Settings:
    """One knob of every kind."""

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {"low": {"count": 1}, "high": {"count": 9}}

    on: bool = knob(True, "whether it is on")
    kind: str = knob("red", "what it looks like", choices=("red", "green", "blue"))
    count: int = knob(4, "how many", unit="pieces", minimum=1, maximum=16, reference=16)
    share: float = knob(0.5, "how much of it", minimum=0, maximum=1)
    rays: int = knob(8, "rays a pixel", minimum=1, maximum=4096)
    nits: float = knob(-1.0, "light", minimum=-1, maximum=1e9)
    dark: float = knob(0.02, "grey", minimum=0, maximum=1000)
    least: float = knob(2.0, "at least one", minimum=1)
    free: int = knob(5, "any whole number")
    seed: int = knob(7, "a large number", minimum=0, maximum=2**40)
    large: int = knob(7, "more than a slider can count", minimum=0, maximum=2**30)
    word: str = knob("abc", "any text")


EXPECTED = {
    # name: (kind, whole, bounds, logarithmic)
    "on": ("checkbox", False, (0.0, 0.0), False),
    "kind": ("combo", False, (0.0, 0.0), False),
    "count": ("slider", True, (1, 16), False),
    "share": ("slider", False, (0, 1), False),
    "rays": ("slider", True, (1, 4096), True),
    "nits": ("slider", False, (-1, 1e9), True),
    "dark": ("slider", False, (0, 1000), True),
    "least": ("drag", False, (1, 1e30), False),
    "free": ("drag", True, (-(2**30) + 1, 2**30 - 1), False),
    "seed": ("text", False, (0.0, 0.0), False),
    "large": ("text", False, (0.0, 0.0), False),
    "word": ("text", False, (0.0, 0.0), False),
}


# --- settings and their widgets ---------------------------------------------------------------------------------------


def test_every_kind_of_knob_has_its_widget():
    found = {one.name: (one.kind, one.whole, one.bounds, one.logarithmic) for one in widgets(Settings)}
    assert found == EXPECTED


def test_a_tooltip_says_what_a_knob_is_for_and_what_it_may_be():
    count = widget_of("count", knobs(Settings)["count"])
    assert count.label == "count [pieces]"
    for said in ("how many", "1 to 16", "default 4", "16 is the truest"):
        assert said in count.tooltip


@pytest.mark.parametrize("number", chapters.available())
def test_every_setting_of_every_chapter_has_a_widget_that_can_hold_its_default(number):
    kind = chapters.settings_class(number)
    for widget in widgets(kind):
        assert value_of(widget, widget.knob.default) == widget.knob.default
        if widget.kind in ("slider", "drag"):
            assert widget.bounds[0] <= widget.knob.default <= widget.bounds[1]


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("share", float(np.float32(0.1)), 0.1),
        ("share", 1.5, 1.0),
        ("nits", float(np.float32(123456.7)), 123457.0),
        ("count", 99, 16),
        ("least", -3.0, 1.0),
        ("seed", "1099511627775", 2**40 - 1),
        ("seed", "-1", None),
        ("seed", "many", None),
        ("word", "x y", "x y"),
        ("on", False, False),
        ("kind", "blue", "blue"),
    ],
)
def test_what_a_widget_gives_becomes_a_value_that_the_knob_allows(name, given, expected):
    found = value_of(widget_of(name, knobs(Settings)[name]), given)
    assert found == expected
    assert found is None or type(found) is type(getattr(Settings(), name))


def test_the_preset_is_known_by_its_values():
    assert preset_of(Settings(count=9)) == "high"
    assert preset_of(Settings()) == ""


@dataclass
class LightSettings:
    """One subject."""

    bulbs: int = knob(3, "lamps that shine", minimum=0, maximum=9)
    warm: bool = knob(False, "how red they are")


@dataclass
class WaterSettings:
    """Another one."""

    waves: int = knob(2, "how rough the sea is", minimum=0, maximum=9)
    foam: bool = knob(True, "whether waves break")
    depth: float = knob(3.0, "of the sea", unit="m", minimum=0, maximum=9)
    salt: float = knob(0.1, "in it", minimum=0, maximum=1)
    fish: bool = knob(False, "whether any are there")
    calm: bool = knob(False, "whether the sea is flat")


@dataclass(init=False)
class Subjects(Grouped):
    """Settings in groups."""

    light: LightSettings = group(LightSettings)
    water: WaterSettings = group(WaterSettings)


def test_knobs_know_their_subjects():
    found = {one.name: one.subject for one in widgets(Subjects)}
    assert found["bulbs"] == "light" and found["depth"] == "water" and len(found) == 8
    assert {one.subject for one in widgets(Settings)} == {""}


def test_subjects_are_folded_and_a_search_opens_those_that_have_it(panel):
    user = PanelUser(panel, example(Subjects()))
    assert {
        "subject light",
        "subject water",
        "find",
    } <= panel.places.keys() and "set waves" not in panel.places
    assert user.click(*user.place("subject light", 0.2)) == []
    assert "set bulbs" in panel.places and "set waves" not in panel.places
    user.click(*user.place("find", 0.5))
    user.type("sea")  # of two knobs it is in the meaning, of none in the name
    assert {name for name in panel.places if name.startswith("set ")} == {
        "set waves",
        "set depth",
        "set calm",
    }
    assert "subject light" not in panel.places
    user.type(" flat")
    assert {name for name in panel.places if name.startswith("set ")} == {"set calm"}
    (actions,) = user.click(*user.place("set calm", 0.05))
    assert actions.settings.water.calm and actions.settings.light.bulbs == 3


def test_a_right_click_on_a_knob_asks_where_it_is_explained(user):
    user.state = dataclasses.replace(user.state, explained={"on": 'README.md, "Light"'})
    assert user.click(*user.place("set on", 0.1), button=1) == [PanelActions(read="on")]
    assert user.click(*user.place("set kind", 0.9), button=1) == [], "nothing explains it"


@pytest.mark.parametrize("number", chapters.available())
def test_every_knob_is_explained_somewhere(number):
    """And a knob that a part of the README names leads to a line with its name."""
    places = places_of(number)
    assert places.keys() == knobs(chapters.settings_class(number)).keys()
    for name, place in places.items():
        lines = place.path.read_text("utf-8").splitlines()
        line = lines[place.line - 1]
        assert f"`{name}" in line or f"`--set {name}" in line or line.endswith(f"# {place.heading}"), name


@pytest.mark.parametrize("number", chapters.available())
def test_presets_name_knobs_and_set_them(number):
    kind = chapters.settings_class(number)
    assert [*kind.PRESETS][:4] == ["low", "medium", "high", "reference"]
    for name, values in kind.PRESETS.items():
        assert values.keys() <= knobs(kind).keys()
        assert {key: flat(preset(kind, name))[key] for key in values} == values


def test_knobs_lead_to_the_parts_that_explain_them():
    places = places_of(5)
    assert (places["aperture"].path.parent.name, places["aperture"].heading) == ("ch04", "A lens")
    assert (places["ambient"].path.parent.name, places["ambient"].heading) == ("ch01", "Light in numbers")
    assert (places["alias"].path.parent.name, places["alias"].heading) == ("ch04", "Memory")
    assert places_of("1/first-triangle") == {}


def test_times_stay_in_sight_beside_the_panel_where_there_is_room(panel):
    panel.history.add({"forward": 1.0})
    PanelUser(panel, example(Settings()), (1280, 720))
    left, _, right, _ = panel.places["plot"]
    assert left > 1280 / 2 and right < 1280
    PanelUser(panel, example(Settings()), (640, 1400))
    assert panel.places["plot"][2] < 640


def test_the_section_on_a_frozen_picture(panel):
    user = PanelUser(panel, example(Settings()), (640, 1400))
    user.click(*user.place("Compare", 0.2))
    assert user.click(*user.place("freeze")) == [PanelActions(freeze=True)]
    assert "wipe" not in panel.places
    state = ReferenceState(True, 1.5, 0.5, 12, 0.25, 0.125)
    user.state = dataclasses.replace(user.state, reference=state)
    user.wait()
    assert user.click(*user.place("flip")) == [PanelActions(flip=True)]
    assert user.click(*user.place("let go")) == [PanelActions(freeze=False)]
    on_the_way, _ = user.drag(user.place("wipe", 0.3), user.place("wipe", 0.5))
    wipes = [one.wipe for one in on_the_way]
    assert len(wipes) > 2 and wipes == sorted(wipes) and wipes[0] < wipes[-1], "it follows the hand"


# --- a user -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def panel():
    made = open_panel()
    if made is None:
        pytest.skip("the extra ui is not installed")
    yield made
    made.close()


@pytest.fixture
def user(panel):
    return PanelUser(panel, example(Settings()))


def changed(**values):
    """What the panel asks for when these settings are to change."""
    return [PanelActions(settings=dataclasses.replace(Settings(), **values))]


def test_nothing_is_asked_for_while_nothing_happens(user):
    assert user.wait(10) == []
    assert not user.panel.restless
    user.panel.event(Event("move", 1.0, 1.0))
    assert user.panel.restless
    user.wait(4)
    assert not user.panel.restless


def test_a_checkbox_and_a_combo_count_at_once(user):
    assert user.click(*user.place("set on", 0.1)) == changed(on=False)
    assert user.choose("set kind", 2, 3) == changed(kind="blue")
    assert user.choose("set kind", 0, 3) == [], "that is what it is already"


@pytest.mark.parametrize(
    ("name", "expected"), [("count", 16), ("share", 1.0), ("rays", 4096), ("nits", 1e9), ("dark", 1000.0)]
)
def test_a_slider_counts_when_it_is_let_go(user, name, expected):
    width = user.place("preset", 1.0)[0]
    start, end = user.place(f"set {name}", 0.1), (width + 300, user.place(f"set {name}")[1])
    on_the_way, after = user.drag(start, end)
    assert on_the_way == []
    assert after == changed(**{name: expected})


def test_a_logarithmic_slider_has_its_decades_at_equal_distances(user):
    left, _, right, _ = user.panel.places["preset"]  # as wide as the sliders, and without a unit beside it
    y = user.place("set rays")[1]
    width = user.panel._imgui.calc_text_size("preset").x + user.panel._imgui.get_style().item_inner_spacing.x
    _, after = user.drag((left + 10, y), (left + (right - left - width) / 2, y))
    (actions,) = after
    assert 40 < actions.settings.rays < 100, "the middle of 1 to 4096 is 64"


def test_a_number_without_a_range_is_dragged(user):
    x, y = user.place("set free", 0.2)
    _, after = user.drag((x, y), (x + 100, y))
    assert after[0].settings.free > 5
    x, y = user.place("set least", 0.2)
    _, after = user.drag((x, y), (x - 3000, y))
    assert after == changed(least=1.0)


def test_text_counts_after_enter_and_a_wrong_one_not_at_all(user):
    user.click(*user.place("set word", 0.2))
    assert user.panel.takes_keys()
    assert user.type("", "END") == user.type("xyz") == []
    assert user.type("", "ENTER") == changed(word="abcxyz")
    assert not user.panel.takes_keys()
    user.click(*user.place("set seed", 0.2))
    assert user.type("q", "ENTER") == []


def test_a_preset_sets_all_it_names(user):
    assert user.choose("preset", 1, 3) == changed(count=9)
    user.state = example(Settings(count=9))
    user.wait()
    assert user.choose("preset", 1, 2) == []
    assert user.choose("preset", 0, 2) == changed(count=1)


@pytest.mark.feature("ui/camera-mode-combo")
def test_the_camera_changes_when_the_other_mode_is_chosen_and_only_then(user):
    assert user.choose("mode", 1, 2) == [], "it orbits already"
    assert user.choose("mode", 0, 2) == [PanelActions(mode="first person")]
    user.state = example(Settings(), mode="first person")
    user.wait()
    assert user.choose("mode", 0, 2) == []
    assert user.choose("mode", 1, 2) == [PanelActions(mode="orbit")]


@pytest.mark.feature("tools/frame")
def test_the_pass_to_stop_after_is_chosen_from_those_of_the_frame(user):
    user.state = example(Settings(), passes=("forward", "tonemap"))
    user.wait()
    assert user.choose("stop_after", 0, 3) == []
    assert user.choose("stop_after", 1, 3) == [PanelActions(stop_after="forward")]
    user.state = example(Settings(), passes=("forward", "tonemap"), stop_after="forward", stopped="color_hdr")
    user.wait()
    assert user.choose("stop_after", 1, 3) == []
    assert user.choose("stop_after", 0, 3) == [PanelActions(stop_after="")]


def test_every_button_asks_for_its_own_thing(user):
    assert user.click(*user.place("screenshot")) == [PanelActions(screenshot=True)]
    assert user.click(*user.place("step")) == [PanelActions(step=True)]
    assert user.click(*user.place("copy")) == [PanelActions(copy="1,2,3:0,0,0:50")]
    assert user.click(*user.place("paused", 0.1)) == [PanelActions(paused=True)]
    user.state = example(Settings(), paused=True)
    user.wait()
    assert user.click(*user.place("paused", 0.1)) == [PanelActions(paused=False)]
    assert user.click(5.0, 719.0) == user.click(600.0, 300.0) == []


def test_exposure_and_speed_follow_their_sliders(user):
    start, end = user.place("ev_offset", 0.3), user.place("ev_offset", 2.0)
    on_the_way, after = user.drag(start, end)
    offsets = [actions.ev_offset for actions in on_the_way]
    assert offsets == sorted(offsets) and offsets[-1] == EV_RANGE and len(offsets) > 1
    assert after == []
    on_the_way, _ = user.drag(
        user.place("speed", 0.3), (user.place("speed")[0] - 900, user.place("speed")[1])
    )
    assert on_the_way[-1] == PanelActions(speed=0.05)


@pytest.mark.feature("ui/input-routing")
def test_buttons_and_places_reach_the_panel_and_only_inside_it(panel):
    user = PanelUser(panel, example(Settings()))
    io = panel._imgui.get_io()
    for button in range(3):
        user.frame(Event("button", button=button, down=True))
        assert [bool(io.mouse_down[one]) for one in range(3)] == [one == button for one in range(3)]
        user.frame(Event("button", button=button, down=False))
    user.frame(Event("button", button=7, down=True))
    left, top = panel.places["set on"][:2]
    assert panel.takes_mouse(left, top)
    assert not panel.takes_mouse(5.0, 5.0)
    assert not panel.takes_mouse(630.0, 20.0), "frames per second are only to be looked at"
    panel.visible = False
    assert not panel.takes_mouse(left, top) and not panel.restless


# --- what is drawn ----------------------------------------------------------------------------------------------------


def test_the_glyphs_that_came_are_those_that_the_package_has(user):
    """The first list brings the whole texture, later ones what is new; the sum is the texture that ImGui holds."""
    first = user.updates[0]
    assert (first.texture, first.whole) == (FONT, True)
    user.state = example(Settings(), message="ÄÖÜäöüß 0123456789 àéîõû ÅÆØ ½ ± µ × ÷" * 3)
    user.wait()
    assert len(user.updates) > 1
    texels = {}
    for update in user.updates:
        if update.whole:
            texels[update.texture] = update.pixels.copy()
        else:
            height, width = update.pixels.shape[:2]
            texels[update.texture][update.y : update.y + height, update.x : update.x + width] = update.pixels
    (texture,) = list(user.panel._imgui.get_platform_io().textures)[-1:]
    held = texture.get_pixels_array().reshape(texture.height, texture.width, 4)
    assert np.array_equal(texels[max(texels)], held)
    assert 0.005 < (held[..., 3] > 0).mean() < 0.9


def test_every_texture_that_is_drawn_with_has_been_given(user):
    given = {update.texture for update in user.updates}
    assert {command.texture for command in user.panel.drawn.commands} <= given
    for scale in (1.5, 3.0, 6.0):  # glyphs of other sizes: the texture grows, and another one takes its place
        user.panel._imgui.get_style().font_scale_main = scale
        user.wait(3)
        dropped = set(user.panel.drawn.dropped)
        given |= {update.texture for update in user.updates}
        assert {command.texture for command in user.panel.drawn.commands} <= given - dropped


def test_every_command_draws_within_its_clip_what_its_window_made(user):
    """The rate's window follows the panel's in the list: its indices count from its own vertices."""
    user.state = example(Settings(), frame_rate=60.0)
    user.wait()
    drawn = user.panel.drawn
    corner = [command for command in drawn.commands if command.clip[0] > 450]
    assert corner
    for command in corner:
        used = drawn.indices[command.first : command.first + command.count] + command.base
        assert (drawn.vertices["position"][used, 0] > 450).all()


def test_the_panel_leaves_no_file_and_no_setting_of_the_process(panel, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    PanelUser(panel, example(Settings()))
    panel.close()
    assert list(tmp_path.iterdir()) == []
    assert "PYGLFW_LIBRARY" not in os.environ


@pytest.mark.parametrize("missing", ["imgui_bundle", "imgui_bundle.imgui"])
def test_without_the_package_there_is_no_panel_and_no_error(missing, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "imgui_bundle"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "imgui_bundle", None)
    assert imgui.load() is None
    assert open_panel() is None


# --- times ------------------------------------------------------------------------------------------------------------


@pytest.mark.feature("ui/statistics-overlay")
def test_the_history_keeps_the_last_frames_and_scales_any_series():
    history = History(5)
    assert history.limits() == (0.0, 1.0) and history.names() == []
    for value in range(8):
        history.add({"a": 2.0, "b": -float(value), **({"c": 0.0} if value > 5 else {})})
    assert history.names() == ["a", "b", "c"]
    low, high = history.limits()
    assert (low, high) == (-7.0, 2.0)
    assert history.median("b") == -5.0
    points = history.points("b", low, high)
    assert np.allclose(points[:, 0], [0, 0.25, 0.5, 0.75, 1.0])
    assert np.allclose(points[:, 1], (np.array([-3, -4, -5, -6, -7]) + 7) / 9)
    assert np.allclose(history.points("a", low, high)[:, 1], 1.0)
    assert np.allclose(history.points("c", low, high), [(0.75, 7 / 9), (1.0, 7 / 9)])


@pytest.mark.feature("ui/statistics-overlay")
@pytest.mark.parametrize("value", [0.0, 3.0, -3.0, float("nan"), float("inf")])
def test_constant_and_wrong_series_make_no_nan(value):
    history = History(4)
    for _ in range(6):
        history.add({"x": value})
    low, high = history.limits()
    assert low < high and np.isfinite([low, high]).all()
    points = history.points("x", low, high)
    assert np.isfinite(points).all()
    assert (points[:, 1] >= 0.0).all() and (points[:, 1] <= 1.0).all(), "inside the chart, not left out of it"


@pytest.mark.feature("ui/camera-mode-combo")
@pytest.mark.feature("ui/statistics-overlay")
def test_each_backend_shows_the_camera_the_times_and_the_rate(user, vulkan_device, gl_context):
    """Another mode changes its own box; times and the rate change the chart and the corner."""

    def shown(**state):
        user.state = example(Settings(), **state)
        user.panel.event(Event("move", 1.0, 1.0))
        user.wait()
        return seen(user, vulkan_device, gl_context)

    orbit, again, walks = shown(), shown(), shown(mode="first person")
    left, top, right, bottom = np.rint(user.panel.places["mode"]).astype(int)
    for number in range(2):
        assert np.array_equal(orbit[number], again[number])
        changed = (orbit[number] != walks[number]).any(-1)
        assert changed[top:bottom, left:right].any()
        changed[top:bottom, left:right] = False
        assert not changed.any(), "the mode is shown in one place"
    for step in range(60):
        user.panel.history.add({"forward": 1.0 + step % 3})
    rated = shown(frame_rate=60.0)
    for before, after in zip(orbit, rated, strict=True):
        changed = (before != after).any(-1)
        assert changed[:40, 560:].any() and changed[:, :560].sum() > 100, (
            "the rate in the corner, and the chart"
        )


@pytest.mark.feature("ui/statistics-overlay")
def test_times_are_drawn_as_lines_and_the_rate_is_in_the_corner(user):
    before = len(user.panel.drawn.vertices)
    for number in range(300):
        user.panel.history.add({"forward": 1.0 + number % 3, "tonemap": 0.0})
    user.frame()
    assert len(user.panel.drawn.vertices) > before + 2 * 200 * 2
    user.state = example(Settings(), frame_rate=60.0)
    user.wait()
    corner = user.panel.drawn.vertices["position"][:, 0].max()
    assert 600 < corner <= 640


@pytest.fixture
def interface():
    loaded = imgui.load()
    if loaded is None:
        pytest.skip("the extra ui is not installed")
    opened = imgui.Interface(loaded)
    yield opened
    opened.close()


def test_a_texture_of_the_interface_is_freed_once_no_frame_uses_it(interface) -> None:
    """ImGui asks for it earlier: the frame that was drawn last may still read the texture."""
    status = interface.imgui.ImTextureStatus
    marks: list[Any] = []
    texture = SimpleNamespace(unique_id=7, width=1, height=1, unused_frames=0, status=status.want_destroy)
    texture.set_tex_id, texture.set_status = marks.append, marks.append
    data = SimpleNamespace(textures=[texture])
    interface._textures = {7: 5}
    assert interface._textures_of(data) == ((), ()) and marks == []
    texture.unused_frames = 1
    assert interface._textures_of(data) == ((), (5,))
    assert marks == [0, status.destroyed]
