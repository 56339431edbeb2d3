"""What a window's user changes of the frame graph while it runs: passes on and off, and which resource is shown."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Any

from common.errors import StrataError
from tools.panel.graph import GraphLook, GraphState
from tools.window.stop import Stop, nodes_of

if TYPE_CHECKING:
    from backends.contract import Renderer
    from tools.panel.panel import PanelActions


class WindowGraph:
    """The changes of one window, for whichever renderer it shows. Before chapter 4 renderers have no graph."""

    def __init__(self, stop: Stop) -> None:
        self._stop, self._look = stop, GraphLook()
        self.refused = ""
        """Why the last change was refused."""

    def state(self, renderer: Renderer) -> GraphState | None:
        """Return what the panel shows of it."""
        return self._look.state(renderer, self._stop.resource, self.refused)

    def apply(self, renderer: Any, actions: PanelActions) -> bool:
        """Do what the user asked the panel for; return whether that was anything."""
        switch, show = actions.switch, actions.show
        if actions.stop_after is not None and hasattr(renderer, "show_resource"):
            written = [one.writes for one in nodes_of(renderer) if one.name == actions.stop_after]
            show = written[0][0].resource if written else ""
        if switch is not None:
            self._change(partial(renderer.switch_pass, *switch))
        if show is not None:
            self._change(partial(self._stop.follow, renderer, show))
        return switch is not None or show is not None

    @staticmethod
    def off(renderer: Renderer) -> list[str]:
        """Return the passes that are switched off, for `restore`."""
        return [name for name, on in getattr(renderer, "switches", {}).items() if not on]

    def restore(self, renderer: Any, off: Collection[str]) -> None:
        """Have the graph of another renderer be as that of the one before."""
        self.refused = ""
        there = getattr(renderer, "switches", {})
        for name in off:
            if there.get(name):
                self._change(partial(renderer.switch_pass, name, False))
        shown = self._stop.resource
        if shown:
            self._stop.choose("")
            if there:
                self._change(partial(self._stop.follow, renderer, shown))

    def _change(self, change: Callable[[], Any]) -> None:
        """Have the graph changed; where that is refused, the panel says why, and the old one goes on."""
        self.refused = ""
        try:
            change()
        except StrataError as error:
            self.refused = str(error)
