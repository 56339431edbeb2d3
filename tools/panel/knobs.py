"""What becomes of a chapter's settings in the panel: one widget for each knob, chosen by its type, range and choices.

A value that a slider passes through is shown beside it but counts only when the slider is let go, since a renderer may
have to be opened anew for it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from common.errors import SettingError
from common.settings import Knob, Value, knobs, parse

Kind = Literal["checkbox", "combo", "slider", "drag", "text"]

DECADES = 100.0
"""From this ratio of the largest value to the smallest that matters on, a slider is logarithmic."""

SEARCHED = 8
"""So many knobs have a search."""

_LARGEST = 2**30 - 1
"""Dear ImGui refuses sliders whose ends lie beyond half of what 32 bits hold."""
_LARGE = 1e30


@dataclass(frozen=True)
class Widget:
    """How one setting is shown; `bounds` and `logarithmic` are those of a slider or of dragging."""

    name: str
    kind: Kind
    label: str
    tooltip: str
    knob: Knob
    whole: bool = False
    bounds: tuple[float, float] = (0.0, 0.0)
    logarithmic: bool = False

    @property
    def subject(self) -> str:
        """The group of settings that the knob belongs to, "" for none."""
        return self.knob.path.rpartition(".")[0]

    @property
    def searched(self) -> str:
        """What the search for a knob looks at, in lower case."""
        return f"{self.name} {self.label} {self.subject} {self.knob.doc}".lower()


def widgets(settings: type) -> list[Widget]:
    """Return the widgets of a settings class, in its order."""
    return [widget_of(name, record) for name, record in knobs(settings).items()]


def widget_of(name: str, record: Knob) -> Widget:
    """Return the widget of one knob: bool a checkbox, choices a combo, a number with a range a slider, else text."""
    label = name.replace("_", " ") + (f" [{record.unit}]" if record.unit else "")
    default = ("on" if record.default else "off") if isinstance(record.default, bool) else record.default
    tip = f"{record.doc}\n\n{record.range_text()}; default {default}"
    if record.reference is not None:
        tip += f"; {record.reference} is the truest"
    made = Widget(name, "text", label, tip, record)
    if isinstance(record.default, bool):
        return dataclasses.replace(made, kind="checkbox")
    if record.choices:
        return dataclasses.replace(made, kind="combo")
    if isinstance(record.default, str):
        return made
    whole, low, high = isinstance(record.default, int), record.minimum, record.maximum
    if whole and max(abs(low or 0), abs(high or 0), abs(record.default)) > _LARGEST:
        return made
    if low is not None and high is not None:
        least = low if low > 0 else abs(record.default) or 1.0
        made = dataclasses.replace(made, kind="slider", logarithmic=high / least >= DECADES)
    else:
        made = dataclasses.replace(made, kind="drag")
    limit = _LARGEST if whole else _LARGE
    bounds = (-limit if low is None else low, limit if high is None else high)
    return dataclasses.replace(made, whole=whole, bounds=bounds)


def value_of(widget: Widget, value: Any) -> Value | None:
    """Return what a widget gave as a value that the knob allows, None if it allows none such.

    Widgets count in 32-bit floats: 0.1 comes back as 0.10000000149, and six digits are what was meant. What has the six
    digits of the default is the default: a sixtieth has more.
    """
    if widget.kind in ("slider", "drag"):
        low, high = widget.bounds
        value = min(max(value, low), high)
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    default = widget.knob.default
    if isinstance(default, float) and text == f"{default:.6g}":
        return default
    try:
        return parse(widget.name, widget.knob, text)
    except SettingError:
        return None


class Knobs:
    """The widgets of one settings object on an ImGui context, with the values that are being changed."""

    def __init__(self, imgui: Any, placed: Callable[[str], None]) -> None:
        self._imgui, self._placed = imgui, placed
        self._pending: dict[str, Any] = {}
        self._search = ""
        self.asked = ""

    def build(
        self, shown: list[Widget], values: Mapping[str, Any], explained: Mapping[str, str]
    ) -> dict[str, Value]:
        """Show a search and the widgets, by subject; return the values that the user has settled on, by name.

        `explained` says of a knob where a README explains it. A click with the right button puts its name into `asked`.
        """
        imgui, self.asked = self._imgui, ""
        groups: dict[str, list[Widget]] = {}
        for widget in shown:
            groups.setdefault(widget.subject, []).append(widget)
        if len(shown) >= SEARCHED:
            _, self._search = imgui.input_text_with_hint(
                "find", "a part of a name or a meaning", self._search
            )
            self._placed("find")
        words = self._search.lower().split() if len(shown) >= SEARCHED else []
        changes: dict[str, Value] = {}
        for subject, inside in groups.items():
            found = [one for one in inside if all(word in one.searched for word in words)]
            if not found:
                continue
            if words:
                imgui.set_next_item_open(True)
            opened = not subject or imgui.tree_node(subject.replace("_", " "))
            if subject:
                self._placed(f"subject {subject}")
            if opened:
                changes |= self._group(found, values, explained)
            if opened and subject:
                imgui.tree_pop()
        return changes

    def _group(
        self, shown: list[Widget], values: Mapping[str, Any], explained: Mapping[str, str]
    ) -> dict[str, Value]:
        changes = {}
        for widget in shown:
            value = self._pending.get(widget.name, values[widget.name])
            changed, value = self._draw(widget, value)
            self._placed(f"set {widget.name}")
            place = explained.get(widget.name, "")
            self._imgui.set_item_tooltip(
                f"{widget.tooltip}\n\nRight click: {place}" if place else widget.tooltip
            )
            if place and self._imgui.is_item_clicked(1):
                self.asked = widget.name
            at_once = widget.kind in ("checkbox", "combo")
            if changed and not at_once:
                self._pending[widget.name] = value
            if changed if at_once else self._imgui.is_item_deactivated_after_edit():
                self._pending.pop(widget.name, None)
                settled = value_of(widget, value)
                if settled is not None and settled != values[widget.name]:
                    changes[widget.name] = settled
            elif not self._imgui.is_item_active():
                self._pending.pop(widget.name, None)
        return changes

    def _draw(self, widget: Widget, value: Any) -> tuple[bool, Any]:
        imgui, (low, high) = self._imgui, widget.bounds
        if widget.kind == "checkbox":
            return imgui.checkbox(widget.label, value)
        if widget.kind == "combo":
            choices = widget.knob.choices or ()
            changed, index = imgui.combo(widget.label, choices.index(value), [str(one) for one in choices])
            return changed, choices[index]
        if widget.kind == "text":
            return imgui.input_text(widget.label, str(value))
        flags = imgui.SliderFlags_.always_clamp
        if widget.logarithmic:
            flags |= imgui.SliderFlags_.logarithmic
        if widget.kind == "slider":
            if widget.whole:
                return imgui.slider_int(widget.label, value, int(low), int(high), "%d", flags)
            return imgui.slider_float(widget.label, value, low, high, "%.4g", flags)
        if widget.whole:
            return imgui.drag_int(
                widget.label, value, max(abs(value), 20) * 0.01, int(low), int(high), "%d", flags
            )
        return imgui.drag_float(widget.label, value, max(abs(value), 0.1) * 0.01, low, high, "%.4g", flags)
