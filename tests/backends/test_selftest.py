"""Self-tests of drivers: crashes, hangs and wrong numbers become verdicts, verdicts are kept, features go missing."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.contract import Capabilities, resolve
from backends.features import FEATURES, MAIN_USES, OTHER_USES, REQUIRED_USES
from backends.selftest import run as selftest
from backends.selftest import verdicts
from backends.selftest.verdicts import OK, UNCHECKED, Identity
from backends.vulkan.device import Device, capabilities
from backends.vulkan.instance import choose
from backends.vulkan.selftests import pages, triangles
from backends.vulkan.selftests.bench import Bench, differ
from common.errors import UnsupportedError, UserError
from common.paths import ROOT
from tests.support.drivers import needs_whole_quads

CHILD = """
import json, os, signal, sys, time
from pathlib import Path
uses = sys.argv[3:]
with open({log!r}, "a") as log:
    log.write(" ".join(uses) + "\\n")
orders = json.loads(Path({orders!r}).read_text())
if orders.get("open") == "crash":
    os.kill(os.getpid(), signal.SIGSEGV)
signal.signal(signal.SIGINT, signal.SIG_DFL)
if orders.get("open", "").startswith("stopped by "):
    os.kill(os.getpid(), getattr(signal, orders["open"][11:]))
    time.sleep(1)
print(json.dumps({{"use": "open", "verdict": orders.get("open", "ok")}}), flush=True)
for place, use in enumerate(uses):
    what = orders.get(use, "ok")
    if what == "crash" or what == "crash behind others" and place:
        os.kill(os.getpid(), signal.SIGSEGV)
    if what == "hang":
        time.sleep(60)
    if what.startswith("exit "):
        sys.exit(int(what[5:]))
    if what.startswith("stopped by "):
        os.kill(os.getpid(), getattr(signal, what[11:]))
    if what == "chatter":
        print("the driver prints this")
        print("[1, 2]")
    if what.startswith(("chatter", "crash")):
        what = "ok"
    print(json.dumps({{"use": use, "verdict": what}}), flush=True)
"""

DEVICE = Identity("Test GPU", "testdriver 1.2", "00ff")


class Fake:
    """A child process in place of the self-tests: `order` says what becomes of a use, `started` what was asked."""

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
        return lines


@pytest.fixture
def fake(tmp_path: Path) -> Fake:
    return Fake(tmp_path)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STRATA_VERDICTS", str(tmp_path / "verdicts"))
    monkeypatch.setattr(verdicts, "_unkept", {})
    return tmp_path / "verdicts"


def said(*features: str, driver: str = "testdriver 1.2") -> Capabilities:
    return Capabilities("vulkan", "Test GPU", driver, (1, 3, 0), "discrete", frozenset(features))


# --- verdicts of children -----------------------------------------------------------------------------------

THREE = ["a/first", "a/second", "b/third"]


def judged(fake: Fake, *, timeout_s: float = 20.0) -> dict[str, str]:
    """Return the verdicts on three uses."""
    found = selftest.judge_all("vulkan", 0, THREE, timeout_s=timeout_s, child=fake.command)
    return {f"{feature}/{use}": verdict for feature, uses in found.items() for use, verdict in uses.items()}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("end", "verdict", "children"),
    [
        ("ok", "ok", 1),
        ("wrong: 3 of 64 texels differ", "wrong: 3 of 64 texels differ", 1),
        ("chatter", "ok", 1),
        # Tried once more alone, and then the rest by a third child.
        ("crash", "crashed (signal 11, SIGSEGV)", 3),
        ("exit 3", "crashed (exit code 3)", 3),
        ("exit 0", "crashed (exit code 0)", 3),  # without a word on this use
        ("crash behind others", "ok", 3),
    ],
)
def test_one_child_tries_all_and_another_goes_on_behind_a_crash(
    fake: Fake, end: str, verdict: str, children: int
) -> None:
    fake.order(a__second=end)
    assert judged(fake) == {"a/first": "ok", "a/second": verdict, "b/third": "ok"}
    assert len(fake.started()) == children


def test_a_use_that_hangs_is_stopped_and_the_next_child_begins_behind_it(fake: Fake) -> None:
    fake.order(a__second="hang")
    assert judged(fake, timeout_s=2.0) == {
        "a/first": "ok",
        "a/second": "hung (stopped after 2 s)",
        "b/third": "ok",
    }
    assert fake.started() == ["a/first a/second b/third", "b/third"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
def test_a_device_that_crashes_whenever_it_is_opened_fails_every_use(fake: Fake) -> None:
    fake.order(open="crash")
    assert set(judged(fake).values()) == {"crashed (signal 11, SIGSEGV)"}
    assert len(fake.started()) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
@pytest.mark.parametrize("use", ["open", "a__second"])
def test_a_child_that_was_stopped_says_nothing_about_the_driver(fake: Fake, use: str, name: str) -> None:
    """Ctrl-C, a time limit and a system without memory end processes, too."""
    fake.order(**{use: f"stopped by {name}"})
    found = judged(fake)
    assert found["a/second"].startswith(f"{UNCHECKED}: the process that tried it was stopped")
    assert set(found.values()) <= {OK, found["a/second"]}
    assert verdicts.broken("testdriver", {"a": {"second": found["a/second"]}}) == {}


def test_a_device_that_refuses_says_why_and_is_asked_again_next_time(fake: Fake) -> None:
    fake.order(open=f"{UNCHECKED}: no driver")
    assert set(judged(fake).values()) == {f"{UNCHECKED}: no driver"}


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked at in /proc")
def test_a_child_that_hangs_ends_with_its_parent(tmp_path: Path) -> None:
    """The parent is killed, as by a time limit of its own; the child hangs in a call that lets other threads run."""
    hung = tmp_path / "hung"
    child = f"""
import os, sys, time
from pathlib import Path
from backends.selftest import run as selftest
selftest.begin_child()
selftest.tell(selftest.OPENED, "ok")
Path({str(hung)!r}).write_text(str(os.getpid()))
time.sleep(60)
"""
    parent = f"""
import sys
from backends.selftest import run as selftest
selftest.judge_all("vulkan", 0, ["a/b"], timeout_s=60.0, child=[sys.executable, "-P", "-c", {child!r}])
"""
    with subprocess.Popen([sys.executable, "-P", "-c", parent], env=selftest.child_environment()) as process:
        wait_for(lambda: hung.exists() and hung.read_text() != "")
        process.kill()
    wait_for(lambda: not running(int(hung.read_text())))


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def running(number: int) -> bool:
    """Whether a process is there that has not ended; one that has waits for its parent to take note."""
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_codes_of_windows_read_as_windows_writes_them() -> None:
    assert selftest.crash(0xC0000005) == "crashed (exit code 0xc0000005)"


def test_a_child_that_cannot_start_says_nothing_about_the_driver() -> None:
    found = selftest.judge_all("vulkan", 0, ["a/b"], timeout_s=1.0, child=["/nonexistent/python"])
    assert found["a"]["b"].startswith(UNCHECKED)
    assert verdicts.broken("testdriver", found) == {}


# --- the cache ----------------------------------------------------------------------------------------------


def judge(fake: Fake, device: Identity = DEVICE, **more: object) -> verdicts.Verdicts:
    return selftest.judge_device(
        "vulkan",
        device,
        0,
        ["fp64"],
        child=fake.command,
        timeout_s=20.0,
        **more,  # type: ignore[arg-type]
    )


USES = selftest.uses_of("vulkan", ["fp64"])


def test_verdicts_are_kept_and_nothing_is_tried_again(fake: Fake, cache: Path) -> None:
    fake.order(fp64__arithmetic="wrong: half the digits")
    found = judge(fake)
    assert found.pop("fp64") == {"arithmetic": "wrong: half the digits"}
    assert {verdict for uses in found.values() for verdict in uses.values()} == {OK}
    found = judge(fake)
    assert fake.started() == [" ".join(USES)]
    fake.order()
    assert judge(fake) == found
    assert fake.started() == []
    assert [path.name for path in cache.iterdir()] == [DEVICE.file]
    assert judge(fake, again=True)["fp64"]["arithmetic"] == OK
    assert fake.started() == [" ".join(USES)]


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
    assert fake.started() == [" ".join(USES)]
    assert verdicts.read(DEVICE) == verdicts.read(other)


def test_other_self_tests_make_verdicts_void(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    judge(fake)
    assert verdicts.read(DEVICE) is not None
    monkeypatch.setattr(verdicts, "sources_hash", lambda: "another")
    assert verdicts.read(DEVICE) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"sources": 1}', "HASH", "\xff"])
def test_a_damaged_file_is_no_verdict(cache: Path, content: str) -> None:
    cache.mkdir(parents=True)
    if content == "HASH":
        content = json.dumps({"sources": verdicts.sources_hash(), "verdicts": {"fp64": "ok"}})
    (cache / DEVICE.file).write_bytes(content.encode("latin-1"))
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
        found = selftest.judge_device("vulkan", DEVICE, 0, ["ray-query"], child=fake.command, timeout_s=20.0)
        return found["ray-query"]

    fake.order(**{"ray-query__compute": "wrong: all", "ray-query__fragment": f"{UNCHECKED}: no compiler"})
    again()
    fake.order()
    assert again() == {"compute": "wrong: all", "fragment": OK}
    assert verdicts.read(DEVICE)["ray-query"] == {"compute": "wrong: all", "fragment": OK}


def test_without_a_cache_verdicts_are_still_given(fake: Fake, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STRATA_VERDICTS", str(tmp_path / "file" / "folder"))
    fake.order(fp64__arithmetic="wrong: half the digits")
    assert judge(fake)["fp64"]["arithmetic"] == "wrong: half the digits"
    assert verdicts.read(DEVICE)["fp64"]["arithmetic"] == "wrong: half the digits"  # in this process
    monkeypatch.setattr(verdicts, "_unkept", {})
    assert verdicts.read(DEVICE) is None


def test_progress_hears_of_every_use(fake: Fake) -> None:
    heard: list[tuple[str, str]] = []
    judge(fake, told=lambda use, verdict: heard.append((use, verdict)))
    assert heard == [pair for use in USES for pair in ((use, ""), (use, OK))]


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


def test_a_required_use_that_failed_makes_the_device_unfit() -> None:
    assert verdicts.unfit({"sparse/attachment": "crashed", "texturing/edges": "wrong: seams"}) is None
    for feature, uses in REQUIRED_USES.items():
        for use in uses:
            found = verdicts.broken("testdriver", {feature: {use: "crashed (signal 11)"}})
            assert verdicts.unfit(found) == (
                f"its self-test failed ({feature}/{use}): crashed (signal 11); {verdicts.AGAIN}"
            )


def test_a_vulkan_device_whose_required_use_failed_is_not_chosen(vulkan_instance) -> None:
    """The next device is; a device that is asked for by name is refused with the reason."""
    devices = vulkan_instance.devices()
    physical = choose(devices, "0")
    other = replace(physical, name="another", kind="other", cache_uuid="00")
    assert choose([replace(physical, kind="discrete"), other]).kind == "discrete"
    verdicts.write(physical.identity, {"drawing": {"pulled": "hung (stopped after 20 s)"}})
    assert choose([replace(physical, kind="discrete"), other]) is other
    with pytest.raises(UserError, match=r"cannot be used: its self-test failed \(drawing/pulled\): hung"):
        choose([physical, other], "0")
    with pytest.raises(UnsupportedError, match="hung"):
        choose([physical])


def test_a_device_believes_its_cached_verdicts(vulkan_instance) -> None:
    """The device does without what failed; only the self-tests themselves still see it."""
    physical = choose(vulkan_instance.devices())
    if "wireframe" not in capabilities(physical).features:
        pytest.skip("the device has no wireframe, which is taken away here")
    bit = ("VkPhysicalDeviceFeatures2", "fillModeNonSolid")
    verdicts.write(physical.identity, {"wireframe": {"draw": "wrong: no lines"}})
    assert capabilities(physical).why_not["wireframe"].endswith("wrong: no lines")
    assert "wireframe" in capabilities(physical, believe=True).features
    with Device(vulkan_instance, physical) as device:
        assert not device.has("wireframe")
        assert bit not in device._negotiate(set())[1]
    with Device(vulkan_instance, physical, believe=True) as device:
        assert device.has("wireframe")
        assert bit in device._negotiate(set())[1]
    verdicts.write(physical.identity, {"wireframe": {"draw": OK}})
    assert "wireframe" in capabilities(physical).features


# --- the workloads ------------------------------------------------------------------------------------------

ALL = [
    f"{feature}/{use}"
    for uses in (REQUIRED_USES, MAIN_USES, OTHER_USES)
    for feature in uses
    for use in uses[feature]
]


def test_every_feature_has_a_use_and_every_use_a_workload() -> None:
    assert MAIN_USES.keys() == FEATURES.keys()
    assert set(selftest.uses_of("vulkan", FEATURES)) == set(ALL)
    for use in ALL:
        assert importlib.util.find_spec(selftest.module_of("vulkan", use)), use


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
    if use == "texturing/edges":
        needs_whole_quads(vulkan_device)
    # A handing-over also works from a queue to itself; that is all that one queue can try.
    own = vulkan_device.compute_queue, vulkan_device.transfer_queue
    vulkan_device.compute_queue = own[0] or vulkan_device.queue
    vulkan_device.transfer_queue = own[1] or vulkan_device.queue
    run = importlib.import_module(selftest.module_of("vulkan", use)).run
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


def judge_real(uses: list[str], instance) -> verdicts.Verdicts:
    return selftest.judge_all("vulkan", number_of(instance), uses)


@pytest.mark.parametrize("use", ["int64/arithmetic", "timeline-semaphore/order", "sparse/plain-image"])
def test_real_children_give_verdicts(use: str, vulkan_instance, monkeypatch) -> None:
    """Two that work and one that crashes the software driver; this process lives on."""
    physical = choose(vulkan_instance.devices())
    feature = use.partition("/")[0]
    if feature in FEATURES and feature not in capabilities(physical, believe=True).features:
        pytest.skip(f"the device has no {feature}")
    verdict = judge_real([use], vulkan_instance)[feature][use.partition("/")[2]]
    if use == "sparse/plain-image" and physical.driver.startswith("llvmpipe"):
        assert verdict == OK or verdict.startswith("crashed (signal 11")  # a later Mesa may have it right
    else:
        assert verdict == OK


def test_a_use_that_does_not_exist_is_not_the_driver_s_fault(vulkan_instance) -> None:
    verdict = judge_real(["sparse/nothing"], vulkan_instance)["sparse"]["nothing"]
    assert verdict.startswith(f"{UNCHECKED}: the self-test has an error, ModuleNotFoundError")


@pytest.mark.long
def test_all_self_tests_of_this_device(vulkan_instance) -> None:
    """What fails is what this driver is known to get wrong; on any other driver, nothing does."""
    physical = choose(vulkan_instance.devices())
    advertised = capabilities(physical, believe=True).features
    found = judge_real(selftest.uses_of("vulkan", advertised), vulkan_instance)
    failed = {f"{feature}/{use}" for feature in found for use in found[feature] if found[feature][use] != OK}
    assert failed <= verdicts.broken(physical.driver, None).keys(), found


def test_the_self_tests_are_hashed_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the helpers: on another bench a verdict has to be found anew."""
    folder = tmp_path / "backends"
    for api in ("vulkan", "gl"):
        shutil.copytree(ROOT / "backends" / api / "selftests", folder / api / "selftests")
    shutil.copytree(ROOT / "backends" / "selftest", folder / "selftest")
    monkeypatch.setattr(verdicts, "ROOT", tmp_path)
    fresh = verdicts.sources_hash.__wrapped__
    before = fresh()
    assert before == verdicts.sources_hash()
    for name in (
        "selftest/run.py",
        "vulkan/selftests/bench.py",
        "gl/selftests/bench.py",
        "gl/selftests/new.py",
    ):
        with (folder / name).open("a") as file:
            file.write("# changed\n")
        after = fresh()
        assert after != before
        before = after
