"""Self-tests of drivers: crashes, hangs and wrong numbers become verdicts, verdicts are kept, features go missing."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends import verdicts
from backends.contract import FEATURES, MAIN_USES, OTHER_USES, Capabilities, resolve
from backends.verdicts import OK, UNCHECKED, Identity
from backends.vulkan import selftest
from backends.vulkan.device import Device, capabilities, identity
from backends.vulkan.instance import choose
from backends.vulkan.selftests import pages, triangles
from backends.vulkan.selftests.bench import Bench, differ
from common.paths import ROOT

CHILD = """
import json, os, signal, sys, time
from pathlib import Path
use = sys.argv[1]
with open({log!r}, "a") as log:
    log.write(use + "\\n")
what = json.loads(Path({orders!r}).read_text()).get(use, "ok")
if what == "crash":
    print(json.dumps({{"use": use, "verdict": "ok"}}), flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)
if what == "hang":
    time.sleep(60)
if what == "exit":
    sys.exit(3)
if what == "chatter":
    print("the driver prints this")
    what = "ok"
if what != "silent":
    print(json.dumps({{"use": use, "verdict": what}}))
"""

DEVICE = Identity("Test GPU", "testdriver 1.2", "00ff")


class Fake:
    """A child process in place of the self-tests: `orders` says what becomes of a use, `started` what was asked."""

    def __init__(self, folder: Path) -> None:
        self._log, self._orders = folder / "log", folder / "orders"
        script = folder / "child.py"
        script.write_text(CHILD.format(log=str(self._log), orders=str(self._orders)))
        self.command = (sys.executable, "-S", str(script))
        self.order()

    def order(self, **what: str) -> None:
        self._orders.write_text(json.dumps({use.replace("__", "/"): end for use, end in what.items()}))

    def started(self) -> list[str]:
        lines = self._log.read_text().splitlines() if self._log.exists() else []
        self._log.unlink(missing_ok=True)
        return sorted(lines)


@pytest.fixture
def fake(tmp_path: Path) -> Fake:
    return Fake(tmp_path)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def said(*features: str, driver: str = "testdriver 1.2") -> Capabilities:
    return Capabilities("vulkan", "Test GPU", driver, (1, 3, 0), "discrete", frozenset(features))


# --- verdicts of children -----------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("end", "verdict"),
    [
        ("ok", "ok"),
        ("wrong: 3 of 64 texels differ", "wrong: 3 of 64 texels differ"),
        ("crash", "crashed (signal 11, SIGSEGV)"),  # though it said ok before
        ("exit", "crashed (exit code 3)"),
        ("silent", "crashed (exit code 0)"),
        ("chatter", "ok"),
    ],
)
def test_the_end_of_a_child_is_the_verdict(fake: Fake, end: str, verdict: str) -> None:
    fake.order(a__b=end)
    assert selftest.judge("a/b", 0, 20.0, fake.command) == verdict


def test_a_child_that_hangs_is_stopped(fake: Fake) -> None:
    fake.order(a__b="hang")
    assert selftest.judge("a/b", 0, 0.4, fake.command) == "hung (stopped after 0.4 s)"


def test_codes_of_windows_read_as_windows_writes_them() -> None:
    assert selftest.crash(0xC0000005) == "crashed (exit code 0xc0000005)"


def test_a_child_that_cannot_start_says_nothing_about_the_driver() -> None:
    verdict = selftest.judge("a/b", 0, 1.0, ["/nonexistent/python"])
    assert verdict.startswith(UNCHECKED)
    assert verdicts.broken("testdriver", {"a": {"b": verdict}}) == {}


# --- the cache ----------------------------------------------------------------------------------------------


def judge(fake: Fake, device: Identity = DEVICE, **more: object) -> verdicts.Verdicts:
    return selftest.judge_device(device, 0, ["fp64"], True, child=fake.command, timeout_s=20.0, **more)  # type: ignore[arg-type]


USES = ["fp64/arithmetic", "timeline-semaphore/order"]


def test_verdicts_are_kept_and_nothing_is_tried_again(fake: Fake, cache: Path) -> None:
    fake.order(fp64__arithmetic="wrong: half the digits")
    found = judge(fake)
    assert found == {"fp64": {"arithmetic": "wrong: half the digits"}, "timeline-semaphore": {"order": OK}}
    assert fake.started() == USES
    fake.order()
    assert judge(fake) == found
    assert fake.started() == []
    assert [path.name for path in (cache / "selftest").iterdir()] == [DEVICE.file]
    assert judge(fake, again=True)["fp64"]["arithmetic"] == OK
    assert fake.started() == USES


@pytest.mark.parametrize(
    "other",
    [
        replace(DEVICE, driver="testdriver 1.3"),
        replace(DEVICE, device="Test GPU 2"),
        replace(DEVICE, build="0100"),
    ],
)
def test_another_driver_is_tried_anew(fake: Fake, other: Identity) -> None:
    judge(fake)
    fake.started()
    assert verdicts.read(other) is None
    judge(fake, other)
    assert fake.started() == USES
    assert verdicts.read(DEVICE) == verdicts.read(other)


def test_other_self_tests_make_verdicts_void(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    judge(fake)
    assert verdicts.read(DEVICE) is not None
    monkeypatch.setattr(verdicts, "sources_hash", lambda: "another")
    assert verdicts.read(DEVICE) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"sources": 1}', "HASH", "\xff"])
def test_a_damaged_file_is_no_verdict(cache: Path, content: str) -> None:
    (cache / "selftest").mkdir(parents=True)
    if content == "HASH":
        content = json.dumps({"sources": verdicts.sources_hash(), "verdicts": {"fp64": "ok"}})
    (cache / "selftest" / DEVICE.file).write_bytes(content.encode("latin-1"))
    assert verdicts.read(DEVICE) is None


def test_what_was_not_checked_is_tried_at_the_next_call(fake: Fake) -> None:
    fake.order(fp64__arithmetic=f"{UNCHECKED}: no compiler")
    judge(fake)
    fake.started()
    fake.order()
    assert judge(fake)["fp64"]["arithmetic"] == OK
    assert fake.started() == ["fp64/arithmetic"]


def test_verdicts_on_the_other_uses_of_a_feature_stay(fake: Fake) -> None:
    def again() -> dict[str, str]:
        found = selftest.judge_device(DEVICE, 0, ["ray-query"], True, child=fake.command, timeout_s=20.0)
        return found["ray-query"]

    fake.order(**{"ray-query__compute": "wrong: all", "ray-query__fragment": f"{UNCHECKED}: no compiler"})
    again()
    fake.order()
    assert again() == {"compute": "wrong: all", "fragment": OK}
    assert verdicts.read(DEVICE)["ray-query"] == {"compute": "wrong: all", "fragment": OK}


def test_without_a_cache_verdicts_are_still_given(fake: Fake, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file"))
    assert judge(fake)["fp64"]["arithmetic"] == OK
    assert verdicts.read(DEVICE) is None


def test_progress_hears_of_every_use(fake: Fake) -> None:
    heard: list[tuple[str, str]] = []
    judge(fake, progress=lambda use, verdict: heard.append((use, verdict)))
    assert heard == [(use, OK) for use in USES]


# --- what verdicts do to capabilities -----------------------------------------------------------------------


def test_a_feature_whose_main_use_failed_is_missing_for_that_reason() -> None:
    wrong = verdicts.broken("testdriver", {"mesh-shader": {"draw": OK, "task": "wrong: no squares"}})
    found = verdicts.apply(said("mesh-shader", "fp64"), wrong)
    assert found.features == {"fp64"}
    assert "wrong: no squares" in found.why_not["mesh-shader"]
    assert not found.use("mesh-shader", "draw")
    choice = resolve((), {"mesh-shader"}, found).choices[0]
    assert not choice.native
    assert choice.path == FEATURES["mesh-shader"][1]
    assert "wrong: no squares" in choice.reason


def test_another_use_that_failed_leaves_the_feature() -> None:
    wrong = verdicts.broken("testdriver", {"sparse": {"sampled": OK, "attachment": "crashed (signal 11)"}})
    found = verdicts.apply(said("sparse"), wrong)
    assert found.features == {"sparse"}
    assert found.use("sparse", "sampled")
    assert found.use("sparse", "cube-array")
    assert not found.use("sparse", "attachment")
    assert not found.use("fp64", "arithmetic")  # not there at all
    assert found.use("timeline-semaphore", "order")  # every device has it
    with pytest.raises(KeyError, match="sparse/attachments"):
        found.use("sparse", "attachments")


def test_known_liars_count_until_a_self_test_passes() -> None:
    driver = "llvmpipe Mesa 25.0.7 (LLVM 15.0.6)"
    known = verdicts.broken(driver, None)
    assert {
        "sparse/attachment",
        "sparse/cube-array",
        "pipeline-statistics/after-push-constants",
    } <= known.keys()
    found = verdicts.apply(said("sparse", "mesh-shader", driver=driver), known)
    assert found.features == {"sparse", "mesh-shader"}
    assert not found.use("sparse", "attachment")
    after = verdicts.broken(driver, {"sparse": {"attachment": OK, "cube-array": f"{UNCHECKED}: no compiler"}})
    assert "sparse/attachment" not in after
    assert after["sparse/cube-array"] == known["sparse/cube-array"]
    assert verdicts.broken("NVIDIA 580.1", None) == {}


def test_a_device_believes_its_cached_verdicts(vulkan_instance) -> None:
    """The device does without what failed; only the self-tests themselves still see it."""
    physical = choose(vulkan_instance.devices())
    if "wireframe" not in capabilities(physical).features:
        pytest.skip("the device has no wireframe, which is taken away here")
    bit = ("VkPhysicalDeviceFeatures2", "fillModeNonSolid")
    verdicts.write(identity(physical), {"wireframe": {"draw": "wrong: no lines"}})
    assert capabilities(physical).why_not["wireframe"].endswith("wrong: no lines")
    assert "wireframe" in capabilities(physical, believe=True).features
    with Device(vulkan_instance, physical) as device:
        assert not device.has("wireframe")
        assert bit not in device._negotiate(set())[1]
    with Device(vulkan_instance, physical, believe=True) as device:
        assert device.has("wireframe")
        assert bit in device._negotiate(set())[1]
    verdicts.write(identity(physical), {"wireframe": {"draw": OK}})
    assert "wireframe" in capabilities(physical).features


# --- the workloads ------------------------------------------------------------------------------------------

ALL = [f"{feature}/{use}" for uses in (MAIN_USES, OTHER_USES) for feature in uses for use in uses[feature]]


def test_every_feature_has_a_use_and_every_use_a_workload() -> None:
    assert MAIN_USES.keys() == FEATURES.keys()
    assert set(selftest.uses_of(FEATURES)) == set(ALL)
    for use in ALL:
        assert importlib.util.find_spec(selftest.module_of(use)), use


CRASHES = {"sparse/plain-image", "pipeline-statistics/after-push-constants"}
"""Not tried inside the tests' own process."""


class Spoiled(Bench):
    """A bench whose results have one bit turned over, as on a driver that is nearly right."""

    def read(self, buffer, dtype):
        words = super().read(buffer, np.uint32)
        if not (words == 0xCDCDCDCD).all():  # what nothing was written to is left alone
            words[len(words) // 2 & ~1] ^= 1 << 23
        return words.view(dtype)

    def render(self, program, size, record, rate=None):
        pixels = super().render(program, size, record, rate)
        for y, x in ((4, 4), (2, 16), (17, 8)):
            if y < size[1] and x < size[0]:
                pixels[y, x] ^= 1 << 14 | 1 << 30
        return pixels


@pytest.mark.parametrize("use", sorted(set(ALL) - CRASHES))
def test_a_workload_sees_a_wrong_number(use: str, vulkan_device) -> None:
    """Right as it is (save for what this driver is known to get wrong), and never right when one result is spoiled."""
    feature = use.partition("/")[0]
    if feature in FEATURES and not vulkan_device.has(feature) and not feature.startswith("async"):
        pytest.skip(f"the device has no {feature}")
    # A handing-over also works from a queue to itself; that is all that one queue can try.
    own = vulkan_device.compute_queue, vulkan_device.transfer_queue
    vulkan_device.compute_queue = own[0] or vulkan_device.queue
    vulkan_device.transfer_queue = own[1] or vulkan_device.queue
    run = importlib.import_module(selftest.module_of(use)).run
    try:
        with Bench(vulkan_device) as bench:
            wrong = run(bench)
        with Spoiled(vulkan_device) as bench:
            spoiled = run(bench)
    finally:
        vulkan_device.compute_queue, vulkan_device.transfer_queue = own
    known = verdicts.broken(vulkan_device.physical.driver, None)
    assert use in known or wrong == ""
    assert spoiled != ""


def test_differences_are_counted_and_the_first_is_shown() -> None:
    right = np.arange(6).reshape(2, 3)
    assert differ("texels", right, right.copy()) == ""
    found = right.copy()
    found[0, 2] = found[1, 1] = 9
    assert differ("texels", found, right) == "2 of 6 texels differ, the first (2) is 9 and should be 2"


def test_rays_of_the_self_test_hit_and_miss_and_their_answer_is_geometry() -> None:
    """Each hit point lies in its triangle's plane and bounds; the hits spread over all eight triangles."""
    rays = triangles.rays()
    hit, distance, sure = triangles.expected(rays)
    assert set(hit) == set(range(9))
    assert sure.mean() > 0.99
    points = rays[:, 0:3].astype(np.float64) + distance[:, None] * rays[:, 4:7]
    for number in range(8):
        corners = triangles.CORNERS[number % 4] + triangles.OFFSETS[number // 4]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        own = points[hit == number + 1]
        assert np.abs((own - corners[0]) @ normal).max() < 1e-6
        assert (own > corners.min(axis=0) - 1e-6).all()
        assert (own < corners.max(axis=0) + 1e-6).all()


def test_directions_of_the_cube_are_those_of_the_specification() -> None:
    """By the forward table: the major axis chooses the face, and s and t follow from the other two."""
    from backends.vulkan.selftests.sparse_cube_array import _direction

    face, y, x = (a.ravel() for a in np.mgrid[0:6, 0 : pages.SIZE : 37, 0 : pages.SIZE : 41])
    for number, direction, row, column in zip(face, _direction(face, x, y), y, x, strict=True):
        rx, ry, rz = direction
        axis = int(np.abs(direction).argmax())
        assert number == 2 * axis + (direction[axis] < 0)
        s, t = [(-rz, -ry), (rz, -ry), (rx, rz), (rx, -rz), (rx, -ry), (-rx, -ry)][number]
        assert (s + 1) / 2 * pages.SIZE == pytest.approx(column + 0.5)
        assert (t + 1) / 2 * pages.SIZE == pytest.approx(row + 0.5)


# --- the real children --------------------------------------------------------------------------------------


def number_of(instance) -> int:
    devices = instance.devices()
    chosen = choose(devices)
    return next(i for i, physical in enumerate(devices) if physical is chosen)


@pytest.mark.parametrize("use", ["int64/arithmetic", "timeline-semaphore/order", "sparse/plain-image"])
def test_real_children_give_verdicts(use: str, vulkan_instance, monkeypatch) -> None:
    """Two that work and one that crashes the software driver; this process lives on."""
    monkeypatch.delenv("STRATA_CACHE")  # compiled shaders are kept
    physical = choose(vulkan_instance.devices())
    feature = use.partition("/")[0]
    if feature in FEATURES and feature not in capabilities(physical, believe=True).features:
        pytest.skip(f"the device has no {feature}")
    verdict = selftest.judge(use, number_of(vulkan_instance))
    if use == "sparse/plain-image" and physical.driver.startswith("llvmpipe"):
        assert verdict == OK or verdict.startswith("crashed (signal 11")  # a later Mesa may have it right
    else:
        assert verdict == OK


def test_a_use_that_does_not_exist_is_not_the_driver_s_fault(vulkan_instance) -> None:
    verdict = selftest.judge("sparse/nothing", number_of(vulkan_instance))
    assert verdict.startswith(f"{UNCHECKED}: the self-test has an error, ModuleNotFoundError")


@pytest.mark.long
def test_all_self_tests_of_this_device(vulkan_instance, monkeypatch) -> None:
    """What fails is what this driver is known to get wrong; on any other driver, nothing does."""
    monkeypatch.delenv("STRATA_CACHE")
    physical = choose(vulkan_instance.devices())
    advertised = capabilities(physical, believe=True).features
    uses = selftest.uses_of(advertised)
    found = selftest.judge_all(
        uses, number_of(vulkan_instance), at_once=2 if physical.kind == "software" else 1
    )
    failed = {f"{feature}/{use}" for feature in found for use in found[feature] if found[feature][use] != OK}
    assert failed <= verdicts.broken(physical.driver, None).keys(), found


def test_the_self_tests_are_hashed_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the helpers: on another bench a verdict has to be found anew."""
    folder = tmp_path / "backends" / "vulkan"
    shutil.copytree(ROOT / "backends" / "vulkan" / "selftests", folder / "selftests")
    shutil.copy(ROOT / "backends" / "vulkan" / "selftest.py", folder)
    monkeypatch.setattr(verdicts, "ROOT", tmp_path)
    fresh = verdicts.sources_hash.__wrapped__
    before = fresh()
    assert before == verdicts.sources_hash()
    for path in (folder / "selftest.py", folder / "selftests" / "bench.py", folder / "selftests" / "new.py"):
        with path.open("a") as file:
            file.write("# changed\n")
        after = fresh()
        assert after != before
        before = after
