"""What control groups leave a process is what it takes the machine to have: in a container, and in a batch job."""

from pathlib import Path

import pytest

from volsplat.program import machine_limits
from volsplat.program.machine_limits import UNLIMITED, available_memory, core_limit, memory_left
from volsplat.program.this_machine import usable_cores

MIB = 1 << 20


class Groups:
    """What this process takes for the system's word of its control groups."""

    def __init__(self, folder: Path) -> None:
        self.own, self.mounted = folder / "own", folder / "mounted"

    def be_in(self, *lines: str) -> None:
        self.own.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def say(self, group: str, **files: str) -> None:
        folder = self.mounted / group
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name.replace("__", ".")).write_text(f"{text}\n", encoding="utf-8")


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Groups:
    made = Groups(tmp_path)
    monkeypatch.setattr(machine_limits, "OWN", made.own)
    monkeypatch.setattr(machine_limits, "MOUNTED", made.mounted)
    return made


def test_a_system_without_control_groups_limits_nothing(groups: Groups) -> None:
    assert memory_left() == core_limit() == UNLIMITED


def test_a_container_sees_its_own_group_as_the_outermost(groups: Groups) -> None:
    groups.be_in("0::/")
    groups.say(
        "", memory__max=str(100 * MIB), memory__current=str(70 * MIB), memory__stat="anon 1", cpu__max="150000 100000"
    )
    assert memory_left() == available_memory() == 30 * MIB
    assert core_limit() == 2


def test_a_job_has_the_least_that_a_group_around_it_leaves(groups: Groups) -> None:
    groups.be_in("0::/slurm/job_7/step_0")
    no_limit = {"memory__max": "max", "memory__current": str(90 * MIB), "memory__stat": "anon 1"}
    groups.say(
        "slurm", memory__max=str(900 * MIB), memory__current=str(90 * MIB), memory__stat="anon 1", cpu__max="max 100000"
    )
    groups.say("slurm/job_7", memory__max=str(200 * MIB), memory__current=str(90 * MIB), memory__stat="anon 1")
    groups.say("slurm/job_7/step_0", **no_limit, cpu__max="50000 100000")
    assert memory_left() == 110 * MIB
    assert core_limit() == usable_cores() == 1


def test_files_that_were_read_leave_room(groups: Groups) -> None:
    groups.be_in("0::/job")
    groups.say(
        "job",
        memory__max=str(100 * MIB),
        memory__current=str(99 * MIB),
        memory__stat=f"anon {9 * MIB}\nfile {90 * MIB}\ninactive_file {50 * MIB}\nactive_file {30 * MIB}",
    )
    assert memory_left() == 81 * MIB


@pytest.mark.parametrize(("high", "left"), [("max", 60), (str(80 * MIB), 40), (str(400 * MIB), 60)])
def test_a_group_that_slows_its_processes_down_gives_no_more(groups: Groups, high: str, left: int) -> None:
    """As systemd's MemoryHigh= does, long before any is killed."""
    groups.be_in("0::/user.slice")
    groups.say(
        "user.slice",
        memory__max=str(100 * MIB),
        memory__high=high,
        memory__current=str(40 * MIB),
        memory__stat="anon 1",
    )
    assert memory_left() == left * MIB


def test_version_1_is_understood(groups: Groups) -> None:
    groups.be_in("9:memory:/docker/c0ffee", "4:cpu,cpuacct:/docker/c0ffee", "1:name=systemd:/", "0::/")
    groups.say(
        "memory",
        memory__limit_in_bytes=str(100 * MIB),
        memory__usage_in_bytes=str(90 * MIB),
        memory__stat=f"total_inactive_file {2 * MIB}\ntotal_active_file {MIB}\nactive_file 5",
    )
    groups.say("cpu/docker/c0ffee", cpu__cfs_quota_us="-1", cpu__cfs_period_us="100000")
    assert memory_left() == 13 * MIB
    assert core_limit() == UNLIMITED
    groups.say("cpu", cpu__cfs_quota_us="300000", cpu__cfs_period_us="100000")
    assert core_limit() == 3


@pytest.mark.parametrize("files", [{"memory__stat": "", "cpu__max": ""}, {"memory__stat": "odd", "cpu__max": "max"}])
def test_what_a_system_leaves_out_is_done_without(groups: Groups, files: dict[str, str]) -> None:
    groups.be_in("0::/")
    groups.say("", memory__max=str(100 * MIB), memory__current=str(70 * MIB), **files)
    assert memory_left() == 30 * MIB and core_limit() == UNLIMITED
