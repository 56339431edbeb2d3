"""A window on Vulkan: instance, surface, device and swapchain, opened in this order and closed in the other.

with Window((1280, 720), "title", loader=loader_address()) as window, Screen(window) as screen:
    with open_renderer(device=screen.device, presents=True) as renderer:
        renderer.render(view)
        screen.show(renderer)
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from backends.contract import Renderer
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.instance import Instance, PhysicalDevice, choose
from backends.vulkan.readback import read_image
from backends.vulkan.window.display import Display
from backends.vulkan.window.swapchain import Swapchain
from backends.window import Window
from common.errors import UnsupportedError
from common.view.draw_lists import DrawList


def loader_address() -> int:
    """Return the address of the loader's vkGetInstanceProcAddr, for `Window`."""
    return int(vk.ffi.cast("uintptr_t", vk.global_functions()[1]))


def choose_presenting(
    devices: Sequence[PhysicalDevice], presents: Sequence[bool], wanted: str | None = None
) -> PhysicalDevice:
    """Return the device for a window: like `choose`, among those that can show something on this display.

    A device that was named is taken or refused with UnsupportedError, never replaced by another.
    """
    wanted = wanted if wanted is not None else os.environ.get("STRATA_DEVICE") or None
    showing = [device for device, can in zip(devices, presents, strict=True) if can]
    picked = choose(devices, wanted)
    if any(picked is device for device in showing):
        return picked
    others = [device for device in showing if device.unfit() is None]
    if wanted is not None or not others:
        raise UnsupportedError(
            f"The Vulkan device '{picked.name}' cannot show pictures on this display: run with --headless."
        )
    return choose(others)


class Screen:
    """What stands between a window and a renderer on Vulkan.

    `device` is for the renderer, which must be closed before this is; `device.display` is the given `display`, or one
    of 8-bit sRGB. Raises UnsupportedError where Vulkan cannot draw to the display.
    """

    def __init__(
        self,
        window: Window,
        *,
        validate: bool = False,
        without: Iterable[str] = (),
        vsync: bool = True,
        display: Display | None = None,
    ) -> None:
        self._window, self._display = window, display or Display()
        self._surface: Any = None
        self._device: Device | None = None
        self._swapchain: Swapchain | None = None
        self._instance = Instance(validate, window.vulkan_extensions(), self._display.instance_extensions)
        try:
            address = int(vk.ffi.cast("uintptr_t", self._instance.handle))
            self._surface = vk.ffi.cast("VkSurfaceKHR", window.vulkan_surface(address))
            devices = self._instance.devices()
            picked = choose_presenting(devices, [self._presents(device) for device in devices])
            wished = picked.extensions.intersection(self._display.device_extensions)
            self._device = Device(self._instance, picked, without, {"VK_KHR_swapchain", *wished})
            self._device.display = self._display
            self._swapchain = Swapchain(self._device, self._surface, vsync=vsync, display=self._display)
        except BaseException:
            self.close()
            raise

    def _presents(self, physical: PhysicalDevice) -> bool:
        """Whether the family that `Device` draws on can present to the surface."""
        if physical.unfit() is not None or "VK_KHR_swapchain" not in physical.extensions:
            return False
        wanted = vk.VK_QUEUE_GRAPHICS_BIT | vk.VK_QUEUE_COMPUTE_BIT
        family = next(family.index for family in physical.families if family.has(wanted))
        supported = vk.ffi.new("VkBool32 *")
        code = self._instance.fn.vkGetPhysicalDeviceSurfaceSupportKHR(
            physical.handle, family, self._surface, supported
        )
        vk.check(code, "vkGetPhysicalDeviceSurfaceSupportKHR")
        return bool(supported[0])

    @property
    def device(self) -> Device:
        """The device that can show pictures in the window."""
        assert self._device is not None, "closed"
        return self._device

    @property
    def swapchain(self) -> Swapchain:
        """The images of the window."""
        assert self._swapchain is not None, "closed"
        return self._swapchain

    @property
    def takes_lists(self) -> bool:
        """Whether the surface takes the colours of a user interface, which are sRGB codes."""
        return self.swapchain.space == vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR

    def show(self, renderer: Renderer) -> bool:
        """Show the renderer's last picture in the window, again if need be; return whether that happened."""
        self.swapchain.tell(self._display.mastering(renderer))
        return self.swapchain.show(self._display.source(renderer), self._window.size)

    def lay(self, drawn: DrawList | None) -> None:
        """Draw a user interface over whatever is shown from now on; None takes it away. Each list is given once."""
        self.swapchain.lay(drawn)

    def picture(self, renderer: Renderer) -> np.ndarray:
        """Return the renderer's last picture, without what lies over it: (H, W, 4) uint8. Waits for it."""
        return read_image(self.device, renderer.present_source, "copy_source")

    def close(self) -> None:
        """Free everything, last made first; a second time does nothing."""
        try:
            if self._swapchain is not None:
                self._swapchain.close()
            if self._surface is not None:
                self._instance.fn.vkDestroySurfaceKHR(self._instance.handle, self._surface, vk.NULL)
            if self._device is not None:
                self._device.close()
        finally:
            self._swapchain = self._surface = self._device = None
            self._instance.close()

    def __enter__(self) -> Screen:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
