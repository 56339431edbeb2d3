"""Pictures in a window: what is chosen, what is on the screen, and what happens when the display refuses."""

from __future__ import annotations

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from backends.vulkan.window.display import HDR_METADATA, Display, Mastering, choose_format
from backends.vulkan.window.screen import Screen, choose_presenting, loader_address
from backends.vulkan.window.swapchain import (
    choose_extent,
    choose_image_count,
    choose_present_mode,
)
from backends.window import Window
from chapters.ch01.renderer import Renderer
from common.errors import StaleFrameError, UnsupportedError, UserError
from common.scene import Light, Material
from tests.support.devices import described
from tests.support.display import seen, shows, virtual_display
from tests.support.scenes import facing, quad_scene

SIZE = (160, 100)
OPEN = 2**32 - 1
FIFO, MAILBOX, IMMEDIATE = (
    vk.VK_PRESENT_MODE_FIFO_KHR,
    vk.VK_PRESENT_MODE_MAILBOX_KHR,
    vk.VK_PRESENT_MODE_IMMEDIATE_KHR,
)

# --- what is chosen ---------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/swapchain")
def test_the_number_of_images_follows_the_table():
    table = {(2, 2): 2, (2, 0): 3, (1, 0): 2, (3, 8): 4, (2, 3): 3, (1, 1): 1, (4, 4): 4}
    assert {key: choose_image_count(*key) for key in table} == table


@pytest.mark.feature("device/swapchain")
def test_the_present_mode_follows_the_table():
    every = [IMMEDIATE, MAILBOX, FIFO]
    assert choose_present_mode(every) == FIFO
    assert choose_present_mode(every, vsync=False) == MAILBOX
    assert choose_present_mode([FIFO, IMMEDIATE], vsync=False) == IMMEDIATE
    assert choose_present_mode([FIFO], vsync=False) == FIFO


def test_a_format_that_would_code_colours_again_is_never_chosen():
    srgb = vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR
    again, plain = (vk.VK_FORMAT_B8G8R8A8_SRGB, srgb), (vk.VK_FORMAT_B8G8R8A8_UNORM, srgb)
    wide = (vk.VK_FORMAT_R8G8B8A8_UNORM, vk.VK_COLOR_SPACE_DISPLAY_P3_NONLINEAR_EXT)
    assert choose_format([again, wide, plain]) == plain
    with pytest.raises(UnsupportedError, match="--headless"):
        choose_format([again, wide])


def test_the_size_is_the_surfaces_own_or_within_its_bounds():
    assert choose_extent((30, 20), (1, 1), (99, 99), (50, 50)) == (30, 20)
    assert choose_extent((OPEN, OPEN), (10, 10), (99, 60), (50, 50)) == (50, 50)
    assert choose_extent((OPEN, OPEN), (10, 10), (99, 60), (5, 500)) == (10, 60)
    assert choose_extent((0, 0), (0, 0), (0, 0), (50, 50)) == (0, 0)


@pytest.mark.feature("device/bring-up")
def test_a_device_is_chosen_among_those_that_reach_the_display(monkeypatch):
    monkeypatch.delenv("STRATA_DEVICE", raising=False)
    compute, old, software, laptop = (
        described("compute card"),
        described("old card", version=(1, 1, 0)),
        described("pipe", "software"),
        described("laptop", "integrated"),
    )
    machine = [software, compute, old, laptop]
    assert choose_presenting(machine, [True, True, False, True]) is compute
    assert choose_presenting(machine, [True, False, True, True]) is laptop
    assert choose_presenting(machine, [True, False, True, False]) is software
    assert choose_presenting(machine, [True, True, True, True], "pipe") is software
    with pytest.raises(UnsupportedError, match="'compute card' cannot show pictures"):
        choose_presenting(machine, [True, False, True, True], "compute")
    with pytest.raises(UnsupportedError, match="'compute card' cannot show pictures"):
        choose_presenting(machine, [False, False, True, False])
    monkeypatch.setenv("STRATA_DEVICE", "pipe")
    with pytest.raises(UserError, match="'pipe' cannot show pictures"):
        choose_presenting(machine, [False, True, True, True])


# --- what is on the screen --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def display():
    with virtual_display() as name:
        try:
            with Instance() as instance:
                fit = [found for found in instance.devices() if found.unfit() is None]
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        if not fit:
            pytest.skip("no Vulkan 1.3 device")
        yield name


@pytest.fixture
def window(display):
    with Window(SIZE, "a test", loader=loader_address()) as made:
        yield made


@pytest.fixture
def screen(window):
    """A validated screen; every message of the layers fails the test, and so does whatever is left alive."""
    with Instance() as plain:
        validate = VALIDATION_LAYER in plain.layers
    with Screen(window, validate=validate) as made:
        sink = made.device.sink
        yield made
    assert sink.report() == []


def scene():
    """A square of one colour with light from one side: no two rows of the picture are the same, nor columns."""
    colors = np.array([(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 0, 1)], np.float32)
    sun = Light("directional", node=0, intensity=np.pi)
    return quad_scene(Material(metallic=0.0, roughness=1.0), lights=(sun,), colors=colors)


def open_renderer(screen, size=SIZE, outputs=("color",), **more):
    return Renderer(scene(), size, outputs=outputs, device=screen.device, presents=True, **more)


@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("device/swapchain")
@pytest.mark.feature("device/screenshot")
def test_thirty_frames_are_shown_pixel_for_pixel(display, screen):
    with open_renderer(screen) as renderer:
        for number in range(30):
            frame = renderer.render(facing(ymag=1.0 + 0.02 * number))
            assert screen.show(renderer)
        picture = frame.image("color")
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 1000
        assert shows(display, picture)
    assert screen.swapchain.shown == 30
    assert screen.swapchain.made == 1


@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("device/swapchain")
def test_a_picture_that_nobody_reads_back_is_shown_too(display, screen):
    with open_renderer(screen, outputs=()) as renderer:
        frame = renderer.render(facing())
        assert screen.show(renderer)
        assert screen.show(renderer), "the same picture can be shown again"
        with pytest.raises(StaleFrameError):
            frame.image("color")
        with Renderer(scene(), SIZE, device=screen.device) as headless:
            assert shows(display, headless.render(facing()).image("color"))


def test_copy_and_next_frame_wait_for_each_other(screen):
    """What the layers of 1.3.239 do not see, since it is in two submissions: each barrier waits for the right stage."""
    transfer = vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT
    with open_renderer(screen, outputs=()) as renderer:
        log = []
        screen.device.fn.trace(log)
        for _ in range(2):
            renderer.render(facing())
            assert screen.show(renderer)
        screen.device.fn.trace(None)
        picture = renderer.present_source.handle
        recorded = [arguments[1] for name, arguments in log if name == "vkCmdPipelineBarrier2"]
        images = [
            made.pImageMemoryBarriers[i] for made in recorded for i in range(made.imageMemoryBarrierCount)
        ]
        drawn = [
            one for one in images if one.image == picture and one.oldLayout == vk.VK_IMAGE_LAYOUT_UNDEFINED
        ]
        handed_on = [one for one in images if one.image == picture and one not in drawn]
        assert [one.srcStageMask for one in drawn] == [transfer] * 2
        assert [one.dstStageMask for one in handed_on] == [transfer] * 2
        submits = [arguments[2] for name, arguments in log if name == "vkQueueSubmit2"]
        waited = [one.pWaitSemaphoreInfos[0].stageMask for one in submits if one.waitSemaphoreInfoCount]
        shown = {int(vk.ffi.cast("uintptr_t", target.handle)) for target in screen.swapchain.targets}
        filled = [
            one
            for one in images
            if int(vk.ffi.cast("uintptr_t", one.image)) in shown
            and one.newLayout == vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
        ]
        assert waited == [one.srcStageMask for one in filled] == [transfer] * 2


@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("device/screenshot")
def test_a_renderer_without_a_picture_says_how_to_get_one(screen):
    with (
        Renderer(scene(), SIZE, outputs={"depth"}, device=screen.device) as renderer,
        pytest.raises(StaleFrameError, match="presents=True"),
    ):
        screen.show(renderer)


def resized(window, size):
    window.resize(size)
    for _ in range(100):
        window.wait(0.02)
        if window.size == size:
            return
    pytest.fail(f"the window does not become {size}")


@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("device/swapchain")
@pytest.mark.feature("device/viewport-resize")
def test_every_new_size_shows_its_own_picture(display, window, screen):
    with open_renderer(screen) as renderer:
        sizes = [(200, 150), (64, 48), (301, 97), (31, 211), SIZE]
        for size in sizes:
            resized(window, size)
            renderer.resize(size)
            frame = renderer.render(facing())
            assert screen.show(renderer)
            assert shows(display, frame.image("color"))
            assert screen.swapchain.extent == size
        assert screen.swapchain.made == len(sizes)


def test_a_picture_of_the_old_size_fills_the_new_window(display, window, screen):
    with open_renderer(screen, size=(80, 50)) as renderer:
        frame = renderer.render(facing(ymag=0.5))
        small = frame.image("color").astype(float)
        for times in (2, 3):
            resized(window, (80 * times, 50 * times))
            assert screen.show(renderer)

            def stretched(pixels, times=times):
                # Linear weights: the mean over a texel is near the texel, and neighbours within it are not all equal.
                blocks = pixels.astype(float).reshape(50, times, 80, times, 3)
                smooth = (blocks[:, 0] != blocks[:, 1]).mean() > 0.2
                return smooth and np.abs(blocks.mean(axis=(1, 3)) - small).max() <= 4.0

            assert seen(display, window.size, stretched)


# --- other displays ---------------------------------------------------------------------------------------------------

TOLD = Mastering((0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329), peak=800.0, brightest=800.0)


class Other(Display):
    """Remembers what it was asked, shows an image of its own, and has something to tell."""

    instance_extensions = ("VK_EXT_swapchain_colorspace", "VK_EXT_of_nobody")
    device_extensions = (HDR_METADATA, "VK_KHR_swapchain_mutable_format", "VK_EXT_of_nobody")
    told = TOLD

    def choose(self, offered, extensions):
        self.offered, self.extensions = offered, extensions
        return choose_format(offered)

    def source(self, renderer):
        self.shown = renderer
        return renderer.present_source

    def mastering(self, renderer):
        return self.told


def test_a_display_chooses_shows_and_tells(window):
    """Extensions that are not offered are no error. What is told is told again to each new chain, and to no other."""
    display, calls = Other(), []
    with Screen(window, display=display) as screen:
        device, chain = screen.device, screen.swapchain
        assert (
            device.display is display and display.offered and (chain.format, chain.space) in display.offered
        )
        assert (
            display.extensions == device.instance.extensions and "VK_EXT_of_nobody" not in display.extensions
        )
        assert screen.takes_lists
        assert device.physical.extensions & {*display.device_extensions} <= device.extensions
        assert "VK_EXT_of_nobody" not in device.extensions
        device.fn.__dict__["vkSetHdrMetadataEXT"] = lambda handle, count, chains, info: calls.append(
            (chains[0], info.maxLuminance, info.displayPrimaryRed.x)
        )
        with open_renderer(screen) as renderer:
            renderer.render(facing())
            if HDR_METADATA not in device.extensions:
                assert screen.show(renderer) and calls == []
                device.extensions |= {HDR_METADATA}
                chain.tell(None)
            for _ in range(2):
                assert screen.show(renderer) and display.shown is renderer
            assert calls == [(chain.handle, 800.0, pytest.approx(0.64))]
            resized(window, (70, 60))
            assert screen.show(renderer) and chain.made == 2
            assert len(calls) == 2 and calls[1][0] == chain.handle
            display.told = None
            assert screen.show(renderer) and len(calls) == 2
        chain.space = vk.VK_COLOR_SPACE_HDR10_ST2084_EXT
        assert not screen.takes_lists


def test_a_window_by_itself_has_a_display_of_8_bits(screen):
    assert type(screen.device.display) is Display
    assert screen.swapchain.space == vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR
    assert "VK_EXT_swapchain_colorspace" not in screen.device.instance.extensions


@pytest.mark.feature("device/lifetime-and-leaks")
def test_screens_follow_each_other_and_leave_nothing(display):
    for _ in range(2):
        with Window(SIZE, "a test", loader=loader_address()) as window:
            screen = Screen(window)
            device = screen.device
            with open_renderer(screen) as renderer:
                renderer.render(facing())
                assert screen.show(renderer)
            screen.close()
            screen.close()
            assert device.alive == {}


# --- what the display may refuse --------------------------------------------------------------------------------------


def answers(functions, name, *codes):
    """Let calls of `name` give `codes` first, then what the driver says. Return the list of codes still to come."""
    real, left = getattr(functions, name), list(codes)

    def call(*arguments):
        return left.pop(0) if left else real(*arguments)

    functions.__dict__[name] = call
    return left


@pytest.mark.feature("device/frames-in-flight")
@pytest.mark.parametrize("code", [vk.VK_NOT_READY, vk.VK_TIMEOUT])
def test_an_image_that_is_not_ready_counts_as_nothing(screen, code):
    with open_renderer(screen) as renderer:
        renderer.render(facing())
        left = answers(screen.device.fn, "vkAcquireNextImageKHR", code)
        assert not screen.show(renderer)
        assert screen.swapchain.shown == 0
        assert screen.show(renderer)
        assert (screen.swapchain.shown, screen.swapchain.made, left) == (1, 1, [])


def test_an_outdated_swapchain_is_made_anew_within_the_call(screen):
    with open_renderer(screen) as renderer:
        renderer.render(facing())
        answers(screen.device.fn, "vkAcquireNextImageKHR", vk.VK_ERROR_OUT_OF_DATE_KHR)
        assert screen.show(renderer)
        assert screen.swapchain.made == 2
        answers(screen.device.fn, "vkAcquireNextImageKHR", *[vk.VK_ERROR_OUT_OF_DATE_KHR] * 2)
        assert not screen.show(renderer), "a window that changes all the time is left for the next frame"
        assert screen.show(renderer)


@pytest.mark.parametrize(
    ("code", "shown"), [(vk.VK_SUBOPTIMAL_KHR, True), (vk.VK_ERROR_OUT_OF_DATE_KHR, False)]
)
def test_what_presenting_answers_decides_the_next_frame(screen, code, shown):
    fn = screen.device.fn
    real = fn.vkQueuePresentKHR

    def present(queue, info):
        real(queue, info)  # it takes the semaphore, whatever it answers
        return code

    with open_renderer(screen) as renderer:
        renderer.render(facing())
        fn.__dict__["vkQueuePresentKHR"] = present
        assert screen.show(renderer) is shown
        fn.__dict__["vkQueuePresentKHR"] = real
        assert screen.show(renderer)
        assert screen.swapchain.made == 2


def test_a_suboptimal_image_is_shown_and_then_replaced(screen):
    fn = screen.device.fn
    real = fn.vkAcquireNextImageKHR

    def acquire(*arguments):
        assert real(*arguments) == vk.VK_SUCCESS
        return vk.VK_SUBOPTIMAL_KHR

    with open_renderer(screen) as renderer:
        renderer.render(facing())
        fn.__dict__["vkAcquireNextImageKHR"] = acquire
        assert screen.show(renderer)
        fn.__dict__["vkAcquireNextImageKHR"] = real
        assert screen.show(renderer)
        assert (screen.swapchain.shown, screen.swapchain.made) == (2, 2)


@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("device/swapchain")
def test_an_error_of_the_display_is_raised_with_its_name(screen):
    with open_renderer(screen) as renderer:
        renderer.render(facing())
        answers(screen.device.fn, "vkAcquireNextImageKHR", vk.VK_ERROR_SURFACE_LOST_KHR)
        with pytest.raises(vk.VulkanError, match="VK_ERROR_SURFACE_LOST_KHR"):
            screen.show(renderer)


def test_a_surface_without_area_shows_nothing(screen):
    ask = screen.device.instance.fn
    real = ask.vkGetPhysicalDeviceSurfaceCapabilitiesKHR

    def nothing(physical, surface, found):
        code = real(physical, surface, found)
        found.currentExtent.width = found.currentExtent.height = 0
        return code

    with open_renderer(screen) as renderer:
        renderer.render(facing())
        ask.__dict__["vkGetPhysicalDeviceSurfaceCapabilitiesKHR"] = nothing
        assert not screen.show(renderer)
        assert screen.swapchain.targets == []
        ask.__dict__["vkGetPhysicalDeviceSurfaceCapabilitiesKHR"] = real
        assert screen.show(renderer)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_a_lost_device_is_closed_all_the_same(window):
    screen = Screen(window)
    device = screen.device
    with open_renderer(screen) as renderer:
        renderer.render(facing())
        assert screen.show(renderer)
    device.wait_idle()
    device.fn.__dict__["vkDeviceWaitIdle"] = lambda *_: vk.VK_ERROR_DEVICE_LOST
    screen.close()
    assert device.alive == {}


def test_without_a_device_for_the_display_everything_is_closed_again(window, monkeypatch):
    monkeypatch.setattr(Screen, "_presents", lambda screen, physical: False)
    with pytest.raises(UnsupportedError, match="cannot show pictures on this display"):
        Screen(window)
