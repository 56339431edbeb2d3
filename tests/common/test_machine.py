"""Free memory, as Linux, containers and batch systems tell it."""

from __future__ import annotations

import pytest

from common import machine

GIB = 1 << 30


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Return a function that writes a file of the system, by its name there."""
    monkeypatch.setattr(machine, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(machine, "OWN_GROUPS", tmp_path / "own")
    monkeypatch.setattr(machine, "GROUPS", tmp_path / "groups")

    def write(name, text):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)

    return write


def group(system, folder, limit, used, idle=0, version=2):
    names = ("max", "current", "inactive_file")
    if version == 1:
        names = ("limit_in_bytes", "usage_in_bytes", "total_inactive_file")
    system(f"{folder}/memory.{names[0]}", f"{limit}\n")
    system(f"{folder}/memory.{names[1]}", f"{used}\n")
    system(f"{folder}/memory.stat", f"anon 5\n{names[2]} {idle}\nother 7\n")


@pytest.mark.parametrize(
    ("told", "free"),
    [
        ("MemTotal:       24000000 kB\nMemAvailable:   20000000 kB\n", 20_000_000 << 10),
        ("MemAvailable:\n", None),
        ("MemAvailable: many kB\n", None),
        (None, None),
    ],
)
def test_what_the_machine_has(system, told, free):
    if told is not None:
        system("meminfo", told)
    assert machine.free_memory() == free


def test_a_group_has_its_limit_less_what_it_takes(system):
    system("meminfo", f"MemAvailable: {20 * GIB >> 10} kB\n")
    system("own", "0::/job/step\n")
    group(system, "groups/job/step", "max", 3 * GIB)
    assert machine.free_memory() == 20 * GIB
    group(system, "groups/job", 8 * GIB, 7 * GIB, idle=2 * GIB)  # of the group around it
    assert machine.free_memory() == 3 * GIB
    group(system, "groups/job/step", 4 * GIB, 5 * GIB)
    assert machine.free_memory() == 0
    system("own", "0::/elsewhere\n")  # the container sees its own group as the root of all
    assert machine.free_memory() == 20 * GIB
    group(system, "groups", 6 * GIB, GIB)
    assert machine.free_memory() == 5 * GIB


def test_groups_of_the_first_version_have_files_of_other_names(system):
    system("own", "3:cpu,cpuacct:/a\n9:memory:/docker/b\n0::/system\n")
    group(system, "groups/memory/docker/b", 2 * GIB, GIB, idle=GIB // 2, version=1)
    group(system, "groups/cpu,cpuacct/a", 1, 1)
    assert machine.free_memory() == 3 * GIB // 2


@pytest.mark.parametrize("own", ["", "9\n", "no line of groups", "0::\n", "9:memory\n"])
def test_lines_that_say_nothing_are_no_limit(system, own):
    system("own", own)
    assert machine.free_memory() is None
