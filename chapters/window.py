"""The window of `strata run N`: a loop that moves the camera, draws when something changed, and shows the picture."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import chapters
from backends.window import Window
from common.camera import Camera, Positioner
from common.clock import FrameClock
from common.inputs import KEYS, Action, Inputs
from common.positioners import FirstPerson, Orbit

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.scene import Scene

HELP = (
    "Drag to look, W A S D 1 2 to move, shift to be faster, U to level, wheel to come nearer, "
    "C to change between flying and orbiting, space to stop and go on with time, Esc to close."
)
"""The keys and what they do."""

BINDINGS = {**{key: action for key, action in KEYS.items() if key != "SPACE"}, "U": Action.RESET_UP}
"""The camera's keys. Space, which levels the camera elsewhere, is what stops time in every player."""

LONGEST_STEP_S = 0.1
"""The most that a camera moves in one frame, in seconds of its motion: a frame that took long is no reason to jump."""

IDLE_WAIT_S = 0.1
"""How long to sleep where nothing changed; an event ends it at once, a change of the scene by program waits for it."""

MINIMISED_WAIT_S = 0.5

TITLE_EVERY_S = 0.5


class Shows(Protocol):
    """What brings a renderer's picture into the window, on either backend."""

    def show(self, renderer: Renderer) -> bool:
        """Show the last picture; return whether that happened."""


@dataclass
class Figures:
    """What a window did: frames drawn, pictures shown, looks at the clock at which nothing had changed."""

    drawn: int = 0
    shown: int = 0
    idle: int = 0
    messages: list[str] = field(default_factory=list)  # of the validation layers, each distinct one once


def first_person(world_from_view: np.ndarray, scene: Scene) -> FirstPerson:
    """Return free flight from a pose (4, 4); at full speed the scene's radius takes one second."""
    flight = FirstPerson.at(world_from_view)
    flight.unit = scene.length_scale / flight.max_speed
    return flight


def orbit(world_from_view: np.ndarray, scene: Scene) -> Orbit:
    """Return an orbit from a pose (4, 4), around the point straight ahead that is as far away as the scene's centre."""
    to_centre = scene.bounds.mean(axis=0) - world_from_view[:3, 3]
    ahead = float(-world_from_view[:3, 2] @ to_centre)
    return Orbit.at(world_from_view, max(ahead, 0.1 * scene.length_scale))


def open_camera(renderer: Renderer, spec: str | None, time: float) -> Camera:
    """Return the camera to begin with, from the view that `spec` names (see `common.camera.view_of_scene`).

    A scene that brings a camera is a place to fly through; one without is a thing to turn in the hand.
    """
    view = chapters.view_of(renderer, spec, time)
    scene = renderer.scene
    flies = bool(scene.cameras) or spec is not None
    positioner: Positioner = (first_person if flies else orbit)(view.world_from_view, scene)
    return Camera(positioner, view.projection, view.ev100)


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
    ) -> None:
        self.window, self.screen, self.renderer, self.camera = window, screen, renderer, camera
        self.time, self.paused = time, False
        self.figures = Figures()
        self._title, self._told, self._on_frame = title, "", on_frame
        self._clock = FrameClock(timer_ns)
        self._since, self._frames_since = 0.0, 0

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
        elif key == "C":
            now, scene = self.camera.positioner, self.renderer.scene
            self.camera.positioner = (first_person if isinstance(now, Orbit) else orbit)(
                now.world_from_view, scene
            )

    def step(self, always: bool = False) -> None:
        """Draw and show one frame, or sleep where it would show nothing new; `always` draws it in any case."""
        passed = self._clock.tick().delta.s
        if self.window.minimised:
            self._sleep(MINIMISED_WAIT_S)
            return
        renderer, window = self.renderer, self.window
        if window.size != renderer.size:
            renderer.resize(window.size)
        if not self.paused:
            self.time += passed
        view = self.camera.advance(min(passed, LONGEST_STEP_S), window.inputs)
        if not always and renderer.idle(view, self.time):
            self.figures.idle += 1
            if window.damaged:
                self._show()
            else:
                self._tell("nothing moves")
                self._sleep(IDLE_WAIT_S)
            return
        frame = renderer.render(view, self.time)
        self._show()
        self.figures.drawn += 1
        self._measure(frame, passed)
        if self._on_frame is not None:
            self._on_frame(renderer, frame)

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
            rate = self._frames_since / self._since
            self._tell(f"{rate:.0f} frames/s, GPU {gpu_ms:.1f} ms, CPU {frame.cpu_ms:.1f} ms")
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
    **options: Any,
) -> Figures:
    """Open a window of (width, height) pixels, show what a renderer draws in it, and return when it is closed.

    `open_renderer(size=, device=, presents=True, **options)` opens the renderer on the window's device: for example
    `partial(chapters.open, 1, scene=scene)`. `camera` names the view to begin with, `time` the seconds; `frames` ends
    the run by itself; `on_frame(renderer, frame)` is called after each frame. Raises UnsupportedError where there is no
    display, or none that Vulkan can draw to. Everything is closed in any case.
    """
    from backends.vulkan.screen import Screen, loader_address

    options.setdefault("outputs", ())
    inputs = Inputs(bindings=BINDINGS)
    with Window(size, title, "vulkan", inputs=inputs, loader=loader_address()) as window:
        screen = Screen(window, validate=validate, without=without, vsync=vsync)
        sink = screen.device.sink
        # The desktop may have given another size than was asked for; a window opened minimised has none yet.
        given = size if window.minimised else window.size
        with screen, open_renderer(size=given, device=screen.device, presents=True, **options) as renderer:
            loop = Loop(
                window,
                screen,
                renderer,
                open_camera(renderer, camera, time),
                title,
                time=time,
                on_frame=on_frame,
            )
            figures = loop.run(frames)
    figures.messages = sink.report()
    return figures
