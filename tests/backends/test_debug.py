"""Messages of the validation layers: each once, with the pass, the objects and the Python line that caused it.

These tests do wrong on purpose, on an instance of their own: on the shared one every message fails the test.
"""

from __future__ import annotations

import inspect
from collections import Counter
from pathlib import Path

import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.driver.debug import ALLOWED, ValidationSink
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from backends.vulkan.once import submit_once
from backends.vulkan.resources import create_buffer, destroy_buffer
from common.errors import UnsupportedError

pytestmark = pytest.mark.runs_on("vulkan")
HERE = f"tests/backends/{Path(__file__).name}"
COPIES = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT


@pytest.fixture(scope="module")
def device():
    try:
        with Instance() as plain:
            if VALIDATION_LAYER not in plain.layers:
                pytest.skip("the Vulkan validation layers are not installed")
            if not any(found.unfit() is None for found in plain.devices()):
                pytest.skip("no Vulkan 1.3 device")
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")
    with Instance(validate=True) as instance, Device(instance) as made:
        yield made


@pytest.fixture(autouse=True)
def _fresh(device):
    sink = device.sink
    sink.messages.clear()
    sink.callbacks.clear()
    sink.failure = None


@pytest.fixture
def buffers(device):
    made = [
        create_buffer(device, 64, COPIES, "device", name) for name in ("cloth positions", "cloth normals")
    ]
    yield made
    for buffer in made:
        destroy_buffer(device, buffer)


def too_far(device, commands, buffers):
    """Copy past the end of both buffers; return the line of the call."""
    region = vk.new("VkBufferCopy", srcOffset=48, dstOffset=0, size=32)
    line = inspect.currentframe().f_lineno + 1
    device.fn.vkCmdCopyBuffer(commands, buffers[0].handle, buffers[1].handle, 1, region)
    return line


@pytest.mark.feature("device/validation-log")
@pytest.mark.feature("device/debug-names-and-markers")
def test_a_wrong_call_is_told_with_pass_object_and_line(device, buffers):
    with submit_once(device) as commands:
        device.fn.vkCmdBeginDebugUtilsLabelEXT(commands, vk.new("VkDebugUtilsLabelEXT", pLabelName="frame"))
        device.fn.vkCmdBeginDebugUtilsLabelEXT(commands, vk.new("VkDebugUtilsLabelEXT", pLabelName="cloth"))
        line = too_far(device, commands, buffers)
        device.fn.vkCmdEndDebugUtilsLabelEXT(commands)
        device.fn.vkCmdEndDebugUtilsLabelEXT(commands)
    wrong = [message for message in device.sink.messages if "vkCmdCopyBuffer" in message.id]
    assert wrong
    for message in wrong:
        assert message.severity == "error"
        assert message.labels == ("frame", "cloth")
        assert message.line == f"{HERE}:{line}"
        text = str(message)
        assert {"cloth positions", "cloth normals"} & set(message.objects)
        assert text.startswith(f"called from {HERE}:{line} in pass frame > cloth: error: ")


@pytest.mark.feature("device/validation-log")
def test_every_message_reaches_every_callback_and_is_kept_once_with_its_count(device, buffers):
    first, second = [], []
    device.sink.callbacks += [first.append, second.append]
    with submit_once(device) as commands:  # one buffer of commands: a message names it by its address
        for _ in range(3):
            too_far(device, commands, buffers)
    assert first == second
    assert device.sink.messages == Counter(first)
    assert max(device.sink.messages.values()) == 3
    assert any(text.endswith("(3 times)") for text in device.sink.report())


@pytest.mark.feature("device/validation-log")
def test_two_instances_hear_each_their_own(device, buffers):
    with Instance(validate=True) as instance, Device(instance) as other:
        with submit_once(device) as commands:
            too_far(device, commands, buffers)
        assert device.sink.messages
        assert other.sink.report() == []


@pytest.mark.feature("device/validation-log")
def test_hazards_between_commands_are_found(device, buffers):
    """Synchronization validation is on: two writes of the same bytes with nothing between them."""
    region = vk.new("VkBufferCopy", size=64)
    with submit_once(device) as commands:
        for _ in range(2):
            device.fn.vkCmdCopyBuffer(commands, buffers[0].handle, buffers[1].handle, 1, region)
    assert any("SYNC-HAZARD-WRITE-AFTER-WRITE" in message.id for message in device.sink.messages)
    assert any("cloth normals" in text for text in device.sink.report())


@pytest.mark.feature("device/validation-log")
def test_right_calls_say_nothing(device, buffers):
    region = vk.new("VkBufferCopy", size=64)
    with submit_once(device) as commands:
        device.fn.vkCmdCopyBuffer(commands, buffers[0].handle, buffers[1].handle, 1, region)
    assert device.sink.report() == []


def test_an_exception_in_a_callback_is_shown_and_kept_and_breaks_nothing(device, buffers, capsys):
    def fail(message):
        raise RuntimeError("the listener is broken")

    device.sink.callbacks.append(fail)
    with submit_once(device) as commands:
        too_far(device, commands, buffers)
    assert isinstance(device.sink.failure, RuntimeError)
    assert "the listener is broken" in capsys.readouterr().err
    assert device.sink.messages, "the message itself is kept"


def test_objects_without_a_name_are_shown_by_their_type(device, buffers):
    nameless = create_buffer(device, 64, COPIES, "device", "")
    with submit_once(device) as commands:
        too_far(device, commands, [buffers[0], nameless])
    destroy_buffer(device, nameless)
    shown = [name for message in device.sink.messages for name in message.objects]
    assert f"object {vk.VK_OBJECT_TYPE_BUFFER} 0x{int(vk.ffi.cast('uintptr_t', nameless.handle)):x}" in shown


@pytest.mark.feature("device/validation-log")
def test_the_line_is_that_of_the_caller_not_of_the_device_layer(device):
    line = inspect.currentframe().f_lineno + 1
    wrong = create_buffer(device, 64, 0, "device", "of no use")
    destroy_buffer(device, wrong)
    said = [message for message in device.sink.messages if "VkBufferCreateInfo" in message.id]
    assert [message.line for message in said] == [f"{HERE}:{line}"]


def test_only_what_an_old_layer_cannot_know_is_let_through():
    sink = ValidationSink()
    for identifier, text, counted in (
        ("WARNING", "Device Extension VK_KHR_new is not supported by this layer.", False),
        ("", "WARNING: lavapipe is not a conformant Vulkan implementation, testing use only.", False),
        ("VUID-vkCmdDraw-None-08600", "The call is wrong.", True),
    ):
        kept = [vk.ffi.new("char[]", some.encode()) for some in (identifier, text)]
        data = vk.ffi.new("VkDebugUtilsMessengerCallbackDataEXT *")
        data.pMessageIdName, data.pMessage = kept
        sink._receive(vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT, 0, data, None)
        assert bool(sink.messages) is counted
    assert all(part for _, part in ALLOWED), "an entry without text would let everything through"


def test_without_the_layers_the_error_says_what_to_do(monkeypatch):
    real = vk.listed

    def nothing(function, call, item, *arguments):
        return [] if item == "VkLayerProperties" else real(function, call, item, *arguments)

    monkeypatch.setattr(vk, "listed", nothing)
    with pytest.raises(UnsupportedError, match="validation layers are not installed"):
        Instance(validate=True)
