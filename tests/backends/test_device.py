"""The choice of a device, what is negotiated with it, and the count of what lives on it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from backends.contract import check_without, resolve
from backends.features import FEATURES
from backends.vulkan import api as vk
from backends.vulkan import instance, resources
from backends.vulkan.device import Device, capabilities
from backends.vulkan.driver import features as vf
from backends.vulkan.instance import Instance, choose, find_family
from common.errors import DeviceError, UnsupportedError, UserError
from tests.support.devices import (
    ALL_BITS,
    ALL_EXTENSIONS,
    COMPUTE,
    GRAPHICS,
    SPARSE,
    TRANSFER,
    described,
    families,
)

# --- the choice -------------------------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def _no_wish(monkeypatch):
    monkeypatch.delenv("STRATA_DEVICE", raising=False)


@pytest.mark.feature("device/bring-up")
def test_the_strongest_kind_is_chosen_in_any_order():
    order = ["discrete", "integrated", "virtual", "other", "software"]
    devices = [described(kind, kind) for kind in order]
    for start in range(len(order)):
        for direction in (1, -1):
            assert choose(devices[start:][::direction]).name == order[start]


@pytest.mark.feature("device/bring-up")
def test_a_named_device_is_taken_or_refused_never_replaced(monkeypatch):
    big, small, old = (
        described("Big Card"),
        described("small", "software"),
        described("old", version=(1, 2, 0)),
    )
    machine = [big, small, old]
    assert choose(machine, "SMALL") is small
    assert choose(machine, "1") is small
    monkeypatch.setenv("STRATA_DEVICE", "small")
    assert choose(machine) is small
    assert choose(machine, "big") is big, "what is asked for here counts more than the environment"
    with pytest.raises(
        UserError, match="No Vulkan device matches 'tiny'; the devices are: 0: Big Card, 1: small"
    ):
        choose(machine, "tiny")
    with pytest.raises(UserError, match=r"'old' cannot be used: it offers Vulkan 1\.2\.0"):
        choose(machine, "old")
    with pytest.raises(UserError, match="matches '3'"):
        choose(machine, "3")


@pytest.mark.feature("device/bring-up")
def test_a_device_that_does_not_fit_is_passed_over_and_named_with_its_reason():
    old = described("old", version=(1, 2, 0))
    bare = described("bare", bits=ALL_BITS - {(vf.V13, "synchronization2")})
    blind = described("blind", families=families(COMPUTE, TRANSFER))
    software = described("pipe", "software")
    assert choose([old, bare, blind, software]) is software
    with pytest.raises(UnsupportedError) as caught:
        choose([old, bare, blind])
    text = str(caught.value)
    assert "old: it offers Vulkan 1.2.0, and 1.3 is needed" in text
    assert "bare: the driver lacks the feature synchronization2" in text
    assert "blind: it has no queue for graphics and compute" in text
    with pytest.raises(UnsupportedError, match="the loader found no driver"):
        choose([])


@pytest.mark.feature("tasks/queue-family-selection")
@pytest.mark.feature("device/bring-up")
def test_family_0_is_an_answer_and_none_is_an_error():
    found = families(GRAPHICS | COMPUTE, COMPUTE, TRANSFER)
    assert find_family(found, GRAPHICS | COMPUTE) == 0
    assert find_family(found, COMPUTE, GRAPHICS) == 1
    assert find_family(found, TRANSFER, GRAPHICS | COMPUTE) == 2
    assert find_family(found[:1], TRANSFER) == 0, "a graphics family can copy, whether it says so or not"
    with pytest.raises(LookupError):
        find_family(found, SPARSE)
    with pytest.raises(LookupError):
        find_family(found[:1], COMPUTE, GRAPHICS)


EXAMPLE = (GRAPHICS | COMPUTE | TRANSFER | SPARSE, COMPUTE | TRANSFER | SPARSE, TRANSFER | SPARSE)


@pytest.mark.feature("tasks/queue-family-selection")
@pytest.mark.parametrize(
    ("flags", "main", "compute", "transfer"),
    [
        (EXAMPLE, 0, 1, 2),
        (EXAMPLE[::-1], 2, 1, 0),
        ((*EXAMPLE, *EXAMPLE), 0, 1, 2),  # the first, not the last
        ((GRAPHICS, *EXAMPLE), 1, 2, 3),  # graphics alone is not enough: flags are compared as a whole
        (EXAMPLE[:2], 0, 1, None),  # a family that computes is no engine for copies
        (EXAMPLE[:1], 0, None, None),
        ((GRAPHICS | COMPUTE,), 0, None, None),
        ((GRAPHICS | COMPUTE, GRAPHICS | TRANSFER), 0, None, None),
    ],
)
def test_queues_are_chosen_by_what_their_families_can_do(flags, main, compute, transfer):
    """Where there is no family for copies alone, the main queue is the only one that is made, and uploads take it."""
    physical = described(families=families(*flags))
    device = SimpleNamespace(physical=physical, features=capabilities(physical).features)
    made = Device._pick_families(device)
    assert (device._graphics, device._compute, device._transfer) == (main, compute, transfer)
    assert made == {main, compute, transfer} - {None}


@pytest.mark.feature("tasks/queue-family-selection")
def test_a_family_without_queues_is_passed_over():
    empty = replace(families(TRANSFER)[0], count=0)
    assert find_family([empty, *families(GRAPHICS, TRANSFER)[1:]], TRANSFER) == 1


@pytest.mark.feature("device/bring-up")
def test_a_missing_layer_or_extension_is_named_before_anything_is_made(vulkan_instance):
    with pytest.raises(UnsupportedError, match="instance extension VK_KHR_not_there"):
        Instance(extensions={"VK_KHR_not_there"})
    with pytest.raises(DeviceError, match="lacks the extension VK_KHR_not_there"):
        Device(vulkan_instance, extensions={"VK_KHR_not_there"})


# --- what it can do ---------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/capability-report")
def test_a_device_with_everything_has_every_feature():
    whole = described(families=families(GRAPHICS | COMPUTE | SPARSE, COMPUTE, TRANSFER))
    assert capabilities(whole, believe=True).features == FEATURES.keys()


@pytest.mark.feature("device/capability-report")
@pytest.mark.parametrize("feature", sorted(vf.OPTIONAL))
def test_each_bit_and_extension_of_a_feature_is_needed_and_named_when_missing(feature):
    requirement = vf.OPTIONAL[feature]
    without_one = [(described(bits=ALL_BITS - {bit}), bit[1]) for bit in requirement.bits]
    without_one += [(described(extensions=ALL_EXTENSIONS - {name}), name) for name in requirement.extensions]
    for device, name in without_one:
        found = capabilities(device, believe=True)
        assert feature not in found.features
        assert found.why_not[feature].endswith(name)


@pytest.mark.feature("device/capability-report")
def test_queues_of_their_own_are_features_of_the_families():
    one = capabilities(described(families=families(GRAPHICS | COMPUTE)), believe=True)
    assert one.why_not["async-compute"] == one.why_not["async-transfer"]
    assert one.why_not["sparse"] == "no queue can bind sparse memory"
    two = capabilities(described(families=families(GRAPHICS | COMPUTE, COMPUTE | TRANSFER)), believe=True)
    assert "async-compute" in two.features
    assert "async-transfer" not in two.features, "a compute family that can copy is no transfer queue"


# --- what is negotiated -----------------------------------------------------------------------------------------------


@pytest.mark.feature("device/capability-report")
def test_a_feature_that_is_switched_off_is_off_on_the_device_too(vulkan_instance):
    with Device(vulkan_instance) as whole:
        offered = whole.features
        extensions = whole.extensions
    assert offered == whole.capabilities.features
    for feature in sorted(offered & {"mesh-shader", "ray-tracing", "anisotropy"}):
        with Device(vulkan_instance, without={feature}) as device:
            assert not device.has(feature)
            assert device.features == offered - {feature}
            assert device.capabilities.features == offered, "what the device can do does not change"
            kept = {e for name in device.features & vf.OPTIONAL.keys() for e in vf.OPTIONAL[name].extensions}
            extra = {e for e, needed in vf.EXTRA_EXTENSIONS.items() if feature in needed}
            gone = (set(vf.OPTIONAL[feature].extensions) | extra) - kept
            assert device.extensions == extensions - gone
    with Device(vulkan_instance, without={"all"}) as bare:
        assert bare.features == frozenset()
        assert bare.extensions <= {"VK_KHR_portability_subset"}
        assert (bare.compute_queue, bare.transfer_queue) == (None, None)


@pytest.mark.feature("device/capability-report")
def test_without_takes_the_path_of_a_device_that_lacks_it():
    has = capabilities(described(), believe=True)
    lacks = capabilities(described(extensions=frozenset()), believe=True)
    off = resolve((), {"mesh-shader"}, has, {"mesh-shader"}).choices[0]
    missing = resolve((), {"mesh-shader"}, lacks).choices[0]
    assert (off.native, off.path) == (missing.native, missing.path)
    assert off.reason == "switched off by --without"
    assert missing.reason == "the driver lacks VK_EXT_mesh_shader"
    with pytest.raises(UnsupportedError, match=r"\(mesh-shader\)"):
        resolve({"mesh-shader"}, (), has, {"mesh-shader"})
    with pytest.raises(UserError, match=r"'mesh-shaders'.*mesh-shader"):
        check_without({"mesh-shaders"})


@pytest.mark.feature("tasks/queue-family-selection")
def test_every_queue_is_of_the_family_that_was_chosen(vulkan_device):
    queues = [vulkan_device.queue, vulkan_device.compute_queue, vulkan_device.transfer_queue]
    for queue in filter(None, queues):
        assert queue.flags == vulkan_device.physical.families[queue.family].flags
    assert vulkan_device.queue.flags & (GRAPHICS | COMPUTE) == GRAPHICS | COMPUTE


# --- what lives -------------------------------------------------------------------------------------------------------


def fence(device, name=""):
    return device.create("vkCreateFence", vk.new("VkFenceCreateInfo"), name)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_what_outlives_its_device_is_named(vulkan_instance):
    device = Device(vulkan_instance)
    handle, destroy, destroy_fence = device.handle, device.fn.vkDestroyDevice, device.fn.vkDestroyFence
    left = [(kind, fence(device, kind)) for kind in ("shadow map ready", "")]
    with pytest.raises(
        DeviceError, match="2 objects outlived their device: VkFence 'shadow map ready', VkFence"
    ):
        device.close()
    for _, one in left:
        destroy_fence(handle, one, vk.NULL)
    destroy(handle, vk.NULL)
    device.close()  # a second time does nothing


@pytest.mark.parametrize(("count", "more"), [(8, False), (9, True)])
def test_of_many_that_outlive_their_device_eight_are_named(vulkan_instance, count, more):
    device = Device(vulkan_instance)
    handle, destroy, destroy_fence = device.handle, device.fn.vkDestroyDevice, device.fn.vkDestroyFence
    left = [fence(device, f"fence {i}") for i in range(count)]
    with pytest.raises(DeviceError) as caught:
        device.close()
    said = str(caught.value)
    assert said.startswith(f"{count} objects outlived") and said.count("VkFence 'fence ") == 8
    assert said.endswith(", ....") == more
    for one in left:
        destroy_fence(handle, one, vk.NULL)
    destroy(handle, vk.NULL)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_ctrl_c_stays_ctrl_c_where_it_left_something_alive(vulkan_instance):
    """It may come between the making of an object and the note of who has it: that is no fault of the code."""
    device = Device(vulkan_instance)
    handle, destroy, destroy_fence = device.handle, device.fn.vkDestroyDevice, device.fn.vkDestroyFence
    left = []

    def interrupted():
        with device:
            left.append(fence(device, "forgotten"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert device.handle is None
    destroy_fence(handle, left[0], vk.NULL)
    destroy(handle, vk.NULL)


def test_an_image_whose_view_cannot_be_made_is_given_back(vulkan_device, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(resources, "create_view", interrupted)
    before = dict(vulkan_device.alive)
    with pytest.raises(KeyboardInterrupt):
        resources.create_image(vulkan_device, "rgba8", (4, 4), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "lost")
    left = {key: name for key, name in vulkan_device.alive.items() if key not in before}
    assert not [key for key in left if key[0] == "VkImage"], "memory stays, for others"


@pytest.mark.feature("device/lifetime-and-leaks")
def test_an_object_is_destroyed_once(vulkan_device):
    made = fence(vulkan_device, "once")
    assert "once" in vulkan_device.alive.values()
    vulkan_device.destroy("VkFence", made)
    assert "once" not in vulkan_device.alive.values()
    with pytest.raises(DeviceError, match="VkFence was destroyed twice"):
        vulkan_device.destroy("VkFence", made)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_what_lives_as_long_as_the_device_goes_in_reverse_order_before_it(vulkan_instance):
    order = []
    with Device(vulkan_instance) as device:
        made = fence(device, "kept")
        device.at_close(lambda: (order.append("first"), device.destroy("VkFence", made)))
        device.at_close(lambda: order.append("second"))
    assert order == ["second", "first"]


@pytest.mark.feature("device/checked-calls")
def test_a_refused_creation_raises_with_its_call_and_leaves_nothing(vulkan_device):
    before = dict(vulkan_device.alive)
    real = vulkan_device.fn.vkCreateFence
    vulkan_device.fn.__dict__["vkCreateFence"] = lambda *_: vk.VK_ERROR_OUT_OF_DEVICE_MEMORY
    try:
        with pytest.raises(vk.VulkanError, match=r"vkCreateFence\(.*VK_ERROR_OUT_OF_DEVICE_MEMORY.*smaller"):
            fence(vulkan_device, "refused")
    finally:
        vulkan_device.fn.__dict__["vkCreateFence"] = real
    assert vulkan_device.alive == before


@pytest.mark.parametrize("version", [(1, 3, 204), (1, 0, 0), (0, 1023, 4095), (127, 0, 1)])
def test_a_version_is_taken_apart_at_its_bits(version):
    """As VK_MAKE_API_VERSION of the specification packs it: 7, 10 and 12 bits, with the variant above them."""
    major, minor, patch = version
    assert instance._version(5 << 29 | major << 22 | minor << 12 | patch) == version
