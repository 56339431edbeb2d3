"""GPU timestamps: one pair per pass, in order, positive, and read without waiting for anything but the frame."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.frames.vulkan_profiler import Profiler
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.scene import Light, Material
from tests.support.chapter import as_modelled, of_backend, on_path, record_anew
from tests.support.scenes import facing, quad_scene

SUN = Light("directional", node=0, intensity=math.pi)


@pytest.mark.feature("device/gpu-timestamps")
def test_stamps_rise_through_the_frame_and_every_pass_takes_time(vulkan_device):
    """The raw ticks: begin <= end within a pass, and no pass begins before the one before it ended."""
    scene = quad_scene(Material(metallic=0.0), lights=(SUN,))
    settings, outputs = as_modelled(on_path(Settings()), 1), {"color", "instance_id"}
    with Renderer(scene, (256, 256), settings, outputs=outputs, device=vulkan_device) as made:
        made.render(facing())
        record_anew(made)
        log: list = []
        vulkan_device.fn.trace(log)
        frame = made.render(facing())
        timings = frame.timings
        vulkan_device.fn.trace(None)
        ticks = np.zeros(6, np.uint64)
        code = vulkan_device.fn.vkGetQueryPoolResults(
            vulkan_device.handle,
            of_backend(made, "profiler")._pools[1],
            0,
            6,
            48,
            vk.ffi.from_buffer(ticks),
            8,
            vk.VK_QUERY_RESULT_64_BIT,
        )
    assert code == vk.VK_SUCCESS
    assert (np.diff(ticks.astype(np.int64)) >= 0).all()
    period = float(vulkan_device.limits.timestampPeriod) * 1e-6
    lengths = (ticks[1::2] - ticks[0::2]).astype(np.float64) * period
    assert list(timings) == ["forward", "instance_id", "tonemap"]
    assert list(timings.values()) == lengths.tolist(), "milliseconds are ticks times the device's period"
    assert (lengths > 0).all()
    stamps = [arguments[3] for name, arguments in log if name == "vkCmdWriteTimestamp2"]
    assert stamps == list(range(6))
    names = [name for name, _ in log]
    assert names.index("vkCmdResetQueryPool") < names.index("vkCmdWriteTimestamp2")


def test_more_pixels_take_longer(vulkan_device):
    """64 times the pixels: whatever else the machine does, the best of five is slower than the best of five."""
    scene = quad_scene(Material(metallic=0.0), lights=(SUN,))
    best = {}
    with Renderer(scene, (64, 64), on_path(Settings()), device=vulkan_device) as made:
        for size in ((64, 64), (512, 512)):
            made.resize(size)
            best[size] = min(made.render(facing()).timings["forward"] for _ in range(5))
    assert best[512, 512] > best[64, 64]


class FakeDevice:
    """Stands in for a device whose counter has few bits, and hands out the stamps that it is given."""

    def __init__(self, bits: int, period: float, stamps: list[int], ready: bool = True) -> None:
        self.limits = SimpleNamespace(timestampPeriod=period)
        self.queue = SimpleNamespace(family=0)
        self.physical = SimpleNamespace(families=[SimpleNamespace(timestamp_bits=bits)])
        self.handle, self.calls = None, []
        self._stamps, self._ready = stamps, ready
        self.fn = self

    def create(self, call, info, name):
        self.calls.append(call)
        return name

    def destroy(self, kind, handle):
        self.calls.append(("destroy", handle))

    def vkCmdResetQueryPool(self, *arguments):
        self.calls.append("reset")

    def vkCmdWriteTimestamp2(self, *arguments):
        self.calls.append("stamp")

    def vkGetQueryPoolResults(self, device, pool, first, count, size, data, stride, flags):
        assert flags & vk.VK_QUERY_RESULT_WAIT_BIT == 0, "reading never waits"
        if not self._ready:
            return vk.VK_NOT_READY
        np.frombuffer(vk.ffi.buffer(data), np.uint64)[:count] = self._stamps
        return vk.VK_SUCCESS


def one_frame(device):
    profiler, slot = Profiler(device), SimpleNamespace(index=0, commands=None)
    profiler.begin_frame(slot)
    for name in ("a", "b"):
        profiler.begin(slot, name)
        profiler.end(slot)
    return profiler, profiler.read(slot)


def test_a_counter_that_wraps_around_still_gives_lengths():
    """36 bits at 2 ns: from 10 ticks before the end to 20 after it are 30 ticks, 60 ns."""
    top = 1 << 36
    _, timings = one_frame(FakeDevice(36, 2.0, [top - 10, 20, 20, 520]))
    assert timings == pytest.approx({"a": 30 * 2e-6, "b": 500 * 2e-6})


def test_results_that_are_not_ready_are_no_times():
    assert one_frame(FakeDevice(64, 1.0, [], ready=False))[1] == {}


@pytest.mark.feature("device/gpu-timestamps")
def test_a_queue_without_timestamps_is_asked_for_none():
    device = FakeDevice(0, 1.0, [])
    profiler, timings = one_frame(device)
    profiler.close()
    assert timings == {}
    assert device.calls == []
