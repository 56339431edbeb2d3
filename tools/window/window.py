"""The window of `strata run N`: a loop that moves the camera, draws when something changed, and shows the picture.

Over it lies the panel (`tools.panel.panel`), where imgui-bundle is installed. It is drawn again when the user does
something, without a new frame of the scene.
"""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from backends.window import Window
from common.errors import StrataError
from common.settings import set_live
from common.view.camera import Camera
from common.view.clock import FrameClock
from common.view.positioners import Orbit
from tools.cli.console import say
from tools.panel.panel import Panel, PanelActions, PanelState, open_panel
from tools.run.live import Live
from tools.run.pacing import LATENCY, Pacer
from tools.window.camera import camera_text, first_person, open_camera, orbit
from tools.window.graph import WindowGraph
from tools.window.keys import freeze_culling
from tools.window.opening import Opened, Refused, open_screen, open_window
from tools.window.reference import Reference
from tools.window.stop import Stop, nodes_of, written

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.view.draw_lists import DrawList
    from tools.lessons.places import Place

LONGEST_STEP_S = 0.1
"""The most that a camera moves in one frame, in seconds of its motion: a frame that took long is no reason to jump."""

IDLE_WAIT_S = 0.1
"""How long to sleep where nothing changed; an event ends it at once, a change of the scene by program waits for it."""

MINIMISED_WAIT_S = 0.5
TITLE_EVERY_S = 0.5

STEP_S = 1 / 60
"""How far the panel's step lets time go."""


class Shows(Protocol):
    """What brings a renderer's picture into the window, on either backend."""

    def show(self, renderer: Renderer) -> bool:
        """Show the last picture; return whether that happened."""

    def lay(self, drawn: DrawList | None) -> None:
        """Draw a user interface over whatever is shown from now on; None takes it away."""

    def picture(self, renderer: Renderer) -> np.ndarray:
        """Return the last picture alone, (H, W, 4) uint8."""


@dataclass
class Figures:
    """What a window did: frames drawn, pictures shown, looks at the clock at which nothing had changed."""

    drawn: int = 0
    shown: int = 0
    idle: int = 0
    messages: list[str] = field(default_factory=list)  # of the validation layers, each distinct one once


class Loop:
    """The frames of one window. Everything it works with is given, so that a test can give something else."""

    def __init__(
        self,
        window: Window,
        screen: Shows,
        renderer: Renderer,
        camera: Camera,
        title: str,
        *,
        time: float = 0.0,
        on_frame: Callable[[Renderer, Frame], None] | None = None,
        timer_ns: Callable[[], int] = clock.perf_counter_ns,
        panel: Panel | None = None,
        reopen: Callable[..., Renderer] | None = None,
        name: str = "strata",
        quality: str = "",
        live: Live | None = None,
        places: Mapping[str, Place] | None = None,
    ) -> None:
        self.window, self.screen, self.renderer, self.camera = window, screen, renderer, camera
        self.time, self.paused, self.speed = time, False, 1.0
        self.figures = Figures()
        self.panel, self.message = panel, ""
        self.stop = Stop()
        self.reference = Reference()
        self._places = places or {}
        self._graph = WindowGraph(self.stop)
        self._title, self._told, self._on_frame, self._reopen = title, "", on_frame, reopen
        self._name, self._quality, self._live = name, quality, live
        self._clock = FrameClock(timer_ns)
        self._since, self._frames_since, self._rate = 0.0, 0, 0.0
        self._ev100 = camera.ev100
        self._warned = len(renderer.scene.warnings)
        self._pacer = Pacer()
        self._unread: deque[Frame] = deque()  # frames whose figures the GPU may still be writing
        self._work: Mapping[str, int] = {}
        self._warm = False  # in a renderer's first frame drivers compile: its times would dwarf all others
        self._panel_due = True  # the panel does not yet show what happened last
        if panel is not None:
            window.listener = panel

    def run(self, frames: int | None = None) -> Figures:
        """Draw until the window is closed, or `frames` frames are drawn: then every step draws one."""
        self._clock.tick()
        self._tell("")
        while frames is None or self.figures.drawn < frames:
            self.window.poll()
            for key in self.window.take_keys():
                self.press(key)
            if self.window.closing:
                break
            self.step(always=frames is not None)
        return self.figures

    def press(self, key: str) -> None:
        """Do what a key is for, other than to move the camera."""
        if key == "ESCAPE":
            self.window.request_close()
        elif key == "SPACE":
            self.paused = not self.paused
        elif key == "R" and self.figures.drawn:  # before that there is no picture
            self._freeze()
        elif key == "F" and self.reference.picture is not None:
            self._measure_flip()
        elif key == "K":
            self._panel_due |= freeze_culling(self.renderer.settings)
        elif key == "C":
            now, scene = self.camera.positioner, self.renderer.scene
            self.camera.positioner = (first_person if isinstance(now, Orbit) else orbit)(
                now.world_from_view, scene
            )
        elif key in ("F1", "TAB") and self.panel is not None:
            self.panel.visible = not self.panel.visible
            self._panel_due = self.window.damaged = True
            if not self.panel.visible:
                self._lay(None)

    def step(self, always: bool = False) -> None:
        """Draw and show one frame, or sleep where it would show nothing new; `always` draws it in any case."""
        passed = self._clock.tick().delta.s
        if self.window.minimised:
            self._sleep(MINIMISED_WAIT_S)
            return
        self._follow_shaders()
        renderer, window = self.renderer, self.window
        if window.size != renderer.size:
            renderer.resize(window.size)
        if not self.paused:
            self.time += passed * self.speed
        view = self.camera.advance(min(passed, LONGEST_STEP_S), window.inputs)
        panel = self.panel if self.panel is not None and self.panel.visible else None
        due = always or self.stop.due or not renderer.idle(view, self.time)
        frame = self._pacer.render(renderer, view, self.time) if due else None
        if frame is not None:
            self.reference.drawn(passed)
        else:
            self.figures.idle += 1
            touched = panel is not None and (panel.restless or self._panel_due or self.reference.stale)
            if not window.damaged and not touched:
                self._tell("nothing moves")
                self._sleep(IDLE_WAIT_S)
                return
        if frame is not None:
            self.stop.look(renderer, frame, view)
            if panel is None and self.stop.after:
                self._lay(None)
        if panel is not None and self.reference.due(frame is not None):
            self.reference.measure(self._picture())
        self._read_figures(frame)
        actions = self._draw_panel(panel, passed, frame is not None) if panel is not None else None
        self._show()
        if frame is not None:
            self.figures.drawn += 1
            self._measure(frame, passed)
            for warning in renderer.scene.warnings[self._warned :]:  # of textures that were loaded meanwhile
                self.message = warning
                say(f"strata: {renderer.scene.name}: {warning}")
            self._warned = len(renderer.scene.warnings)
            if self._on_frame is not None:
                self._on_frame(renderer, frame)
        if actions:
            self._apply(actions)

    # --- the panel ---

    def _read_figures(self, frame: Frame | None) -> None:
        """Hand the panel what the GPU did some frames ago, or all of it where no frame follows."""
        if self.panel is None:
            return
        if frame is not None:
            self._unread.append(frame)
        while len(self._unread) > (LATENCY if frame is not None else 0):
            done = self._unread.popleft()
            self._work = done.work
            if self._warm:
                self.panel.history.add(done.timings)
            self._warm = True

    def _draw_panel(self, panel: Panel, passed: float, moving: bool) -> PanelActions:
        """Draw the panel for the next picture shown; return what the user wants, to be done after that."""
        renderer, positioner = self.renderer, self.camera.positioner
        state = PanelState(
            settings=renderer.settings,
            plan=renderer.plan,
            scene=renderer.scene,
            device=f"{renderer.capabilities.device}, {renderer.capabilities.backend}",
            quality=self._quality,
            frame_rate=self._rate if moving else 0.0,
            work=self._work,
            mode="orbit" if isinstance(positioner, Orbit) else "first person",
            camera=camera_text(self.camera, renderer.scene),
            ev_offset=self.camera.ev100 - self._ev100,
            time=self.time,
            paused=self.paused,
            speed=self.speed,
            message=self.message,
            error=self._live.error if self._live is not None else "",
            passes=tuple(one.name for one in nodes_of(renderer)),
            stop_after=self.stop.after,
            stopped=self.stop.told,
            graph=self._graph.state(renderer),
            reference=self.reference.state,
            explained={name: place.spoken for name, place in self._places.items()},
        )
        actions = panel.frame(state, self.window.size, passed)
        self._lay(panel.drawn)
        # A drawn frame makes new figures; when nothing moves any more, they are to be shown once.
        self._panel_due = moving or bool(actions)
        return actions

    def _apply(self, actions: PanelActions) -> None:
        """Do what the user asked the panel for."""
        if actions.mode is not None and (actions.mode == "orbit") != isinstance(
            self.camera.positioner, Orbit
        ):
            self.press("C")
        if actions.ev_offset is not None:
            self.camera.ev100 = self._ev100 + actions.ev_offset
        if actions.paused is not None:
            self.paused = actions.paused
        if actions.speed is not None:
            self.speed = actions.speed
        if actions.step:
            self.paused, self.time = True, self.time + STEP_S
        if actions.copy:
            self.window.copy_text(actions.copy)
        if actions.screenshot:
            self.message = written(self._picture(), self._name)
        if actions.freeze:
            self._freeze()
        elif actions.freeze is not None:
            self.reference.drop()
        if actions.wipe is not None:
            self.reference.wipe(actions.wipe)
        if actions.flip:
            self._measure_flip()
        if actions.read:
            place = self._places[actions.read]
            self.message = f"{actions.read} is explained in {place.spoken}; its place is in the clipboard."
            self.window.copy_text(f"{place.path}:{place.line}")
        if actions.settings is not None:
            self._change_settings(actions.settings)
        if self._graph.apply(self.renderer, actions):
            self._panel_due = True
            self._clock.tick()  # the time that this took is none of the scene's
        elif actions.stop_after is not None:
            before, self._panel_due = bool(self.stop.after), True
            self.stop.choose(actions.stop_after)
            if before != bool(actions.stop_after):
                self._change_settings(self.renderer.settings, inspect=not before)

    def _change_settings(self, settings: Any, **options: Any) -> None:
        """Go on with a renderer that has other settings; camera and time stay."""
        if self._reopen is None:
            return
        if not options and set_live(self.renderer.settings, settings):
            self.message, self._panel_due = "", True
            return
        self._unread.clear()
        self._warm = False
        self.message = ""
        off = self._graph.off(self.renderer)
        try:
            self.renderer = self._reopen(settings, **options)
        except Refused as error:
            self.renderer, self.message = error.renderer, str(error)
            if options:
                self.stop.choose("")
        self._graph.restore(self.renderer, off)
        self._clock.tick()  # the time that this took is none of the scene's

    def _follow_shaders(self) -> None:
        """Let the renderer have the shaders that were saved."""
        live = self._live
        if live is None or not live.follow(self.renderer):
            return
        self._graph.refused = ""
        if live.renderer is not self.renderer:
            self.renderer, self._warm = live.renderer, False
            self._unread.clear()
        self.message, self._panel_due = live.message, True
        self._clock.tick()  # as little the scene's time as that of other settings

    def _picture(self) -> np.ndarray:
        """Return what is shown of the scene, (H, W, 3) uint8, without the panel."""
        stopped = self.stop.picture
        shown = self.screen.picture(self.renderer)[..., :3] if stopped is None else stopped
        return np.asarray(shown)

    def _freeze(self) -> None:
        """Keep the picture that is shown, to compare with."""
        self.reference.freeze(self._picture(), self.time)
        self._show_reference()

    def _measure_flip(self) -> None:
        self.reference.measure(self._picture(), flip=True)
        state = self.reference.state
        self.message = state.said or f"FLIP {state.flip:.4f}, largest difference {state.largest} of 255"
        self._show_reference()

    def _show_reference(self) -> None:
        """Have what is known of the frozen picture shown: by the panel, else in the terminal."""
        self._panel_due = self.window.damaged = True
        if self.panel is None or not self.panel.visible:
            self._lay(None)
            if self.message:
                say(f"strata: {self.message}")
        self._clock.tick()  # the time that this took is none of the scene's

    # --- the picture ---

    def _lay(self, drawn: DrawList | None) -> None:
        size = self.window.size
        self.screen.lay(self.stop.under(self.reference.under(drawn, size), size))

    def _show(self) -> None:
        # Cleared before, so that an event that comes meanwhile is not lost.
        self.window.damaged = False
        if self.screen.show(self.renderer):
            self.figures.shown += 1
        else:
            self.window.damaged = True

    def _sleep(self, seconds: float) -> None:
        self.window.wait(seconds)
        self._clock.tick()  # neither the camera nor the scene moves on while nobody looks
        self._since, self._frames_since = 0.0, 0

    def _measure(self, frame: Frame, passed: float) -> None:
        self._since += passed
        self._frames_since += 1
        if self._since >= TITLE_EVERY_S:
            gpu_ms = sum(frame.timings.values())  # waits for the frame, but not for every one
            self._rate = self._frames_since / self._since
            self._tell(f"{self._rate:.0f} frames/s, GPU {gpu_ms:.1f} ms, CPU {frame.cpu_ms:.1f} ms")
            self._since, self._frames_since = 0.0, 0

    def _tell(self, state: str) -> None:
        width, height = self.renderer.size
        parts = [self._title, f"{width}x{height}", state, "time stands still" if self.paused else ""]
        told = " | ".join(part for part in parts if part)
        if told != self._told:
            # Not every time: a new title is an event, and events end the sleep of a window in which nothing moves.
            self.window.set_title(told)
            self._told = told


def run_window(
    open_renderer: Callable[..., Renderer],
    *,
    size: tuple[int, int],
    title: str,
    camera: str | None = None,
    validate: bool = False,
    without: Collection[str] = (),
    vsync: bool = True,
    time: float = 0.0,
    frames: int | None = None,
    on_frame: Callable[[Renderer, Frame], None] | None = None,
    backend: str = "vulkan",
    display: Any = None,
    panel: bool = False,
    name: str = "strata",
    quality: str = "",
    places: Mapping[str, Place] | None = None,
    **options: Any,
) -> Figures:
    """Open a window of (width, height) pixels, show what a renderer draws in it, and return when it is closed.

    `open_renderer(size=, device=, presents=True, **options)` opens the renderer on the window's device: for example
    `partial(chapters.open, 1, scene=scene)`; for other settings it is called again, with `settings=`. `camera` names
    the view to begin with, `time` the seconds; `frames` ends the run by itself; `on_frame(renderer, frame)` is called
    after each frame. `backend` is the renderer's, "vulkan" or "gl"; `display` is for `open_screen`. With `panel` the
    panel is shown where it can be; `name` begins the names of screenshots, `quality` says how the preset was chosen,
    `places` where the lessons explain each knob. Shaders that are saved meanwhile are taken over (`tools.run.live`).
    Raises UnsupportedError where there is no display, or none that the backend can draw to. Everything is closed.
    """
    options.setdefault("outputs", ())
    with open_window(backend, size, title) as window:
        screen = open_screen(backend, window, display, validate=validate, without=without, vsync=vsync)
        sink = screen.device.sink
        # The desktop may have given another size than was asked for; a window opened minimised has none yet.
        given = size if window.minimised else window.size
        with screen, Live() as live, ExitStack() as stack:
            opened = Opened(open_renderer, given, {"device": screen.device, "presents": True, **options})
            stack.callback(opened.close)
            live.renew = opened.renew
            drawn_panel = open_panel(window.scale) if panel and screen.takes_lists else None
            if drawn_panel is not None:
                stack.callback(drawn_panel.close)
            loop = Loop(
                window,
                screen,
                opened.renderer,
                open_camera(opened.renderer, camera, time),
                title,
                time=time,
                on_frame=on_frame,
                panel=drawn_panel,
                reopen=opened.reopen,
                name=name,
                quality=quality,
                live=live,
                places=places,
            )
            try:
                figures = loop.run(frames)
            except StrataError:
                window.check()  # a lost surface is what follows from a lost window
                raise
    figures.messages = sink.report()
    return figures
