"""The launcher `slurm`: each server is a batch job, which Slurm queues, places, and runs again if its node fails."""

import os
import re
import shlex
import stat
import subprocess
import uuid
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.home_path import home_path
from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.deploy.launchers.log_files import file_name, last_line, last_lines
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE

SLURM_SECONDS = 60.0  # for one command: a controller that is busy lets them wait
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
OWN_CORES = '--threads "$SLURM_CPUS_ON_NODE"'  # of the job, wherever it runs
# A job that Slurm will run again is completing until it has left its node.
WAITING = {"PENDING", "CONFIGURING", "COMPLETING", "REQUEUED", "REQUEUE_FED", "REQUEUE_HOLD", "RESV_DEL_HOLD"}
WAITING |= {"SPECIAL_EXIT", "STAGE_OUT", "STOPPED", "SUSPENDED"}
# What sbatch says of jobs that other options would get through; never what it says of its controller, or munge.
OPTIONS_CURE = re.compile(
    r"--[a-z]|partition|\baccount\b|\bqos\b|memory specification|time limit|node (configuration|name|count)"
    r"|cpu count|processors|\bgres\b|feature|constraint|reservation|licen[cs]e|wckey",
    re.IGNORECASE,
)
AT_WORK = {"RUNNING", "RESIZING", "SIGNALING"}


class Job(NamedTuple):
    """What Slurm says of one."""

    state: str
    node: str
    reason: str


class SlurmLauncher:
    def __init__(self, machine: Machine, folder: Path) -> None:
        self._machine = machine
        shared = home_path(machine.slurm.folder) / folder.name if machine.slurm.folder else folder
        self._folder = shared / "slurm"

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        report(f"{self._machine.title}: giving {len(orders)} jobs to Slurm")
        self._make_folder()
        self._write_token(secrets)
        started: list[StartedServer] = []
        try:
            for order in orders:
                started.append(self._submit(order))
        except BaseException:
            _cancel(started)
            raise
        return started

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        try:
            jobs = _known_jobs([server.handle["job"] for server in servers])
        except BadInput as error:
            return {server.name: Said(ServerState.UNKNOWN, str(error)) for server in servers}
        return {server.name: _said(server, jobs.get(server.handle["job"])) for server in servers}

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        _cancel(servers)
        self._token_file.unlink(missing_ok=True)

    def logs(self, server: StartedServer, lines: int) -> str:
        return last_lines(Path(server.handle["log"]), lines)

    @property
    def _token_file(self) -> Path:
        return self._folder / "token"

    def _make_folder(self) -> None:
        """The folder, and the one that it lies in: whoever could put files there would have the token."""
        for folder in (self._folder.parent, self._folder):
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                found = folder.lstat()
                if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & OTHERS_WRITE:
                    raise BadInput(f"{folder} is not a folder that you alone may write to; remove it or chmod 700 it")
                folder.chmod(0o700)
            except OSError as error:
                raise BadInput(
                    f"{folder} cannot be made: {error.strerror}; give slurm.folder, which the nodes see as well"
                ) from error

    def _write_token(self, secrets: Secrets) -> None:
        """All at once: another machine of the cluster may share the folder."""
        fresh = self._folder / f"token-{uuid.uuid4().hex}"
        secrets.token.write(fresh)
        fresh.replace(self._token_file)

    def _submit(self, order: ServerOrder) -> StartedServer:
        log = str(self._folder / file_name(order.name))  # a requeued job appends to it
        output = log.replace("%", "%%") + "-%j.log"
        options = [f"--job-name=volsplat {order.name}", f"--output={output}", "--open-mode=append", "--requeue"]
        options += ["--nodes=1", "--ntasks=1", *self._placement(), *self._machine.slurm.options]
        said = _asked(["sbatch", "--parsable", *options], self._script(order)).strip()
        job = said.partition(";")[0]
        if not job.isdecimal():
            raise BadInput(f"sbatch has not said a job's number but {one_line(said)[:100]!r}; see slurm.options")
        return StartedServer(order.name, f"Slurm's job {job}", {"job": job, "log": f"{log}-{job}.log"})

    def _placement(self) -> list[str]:
        machine = self._machine
        cores = [] if machine.threads is None else [f"--cpus-per-task={machine.threads}"]
        return cores + ([] if machine.host is None else [f"--nodelist={machine.host}"])

    def _script(self, order: ServerOrder) -> str:
        words = [order.program.command, *order.arguments, "--token-file", str(self._token_file)]
        threads = [] if "--threads" in order.arguments else [OWN_CORES]
        return " ".join(["#!/bin/sh\nexec", self._machine.command, shlex.join(words), *threads]) + "\n"


def host_name(machine: Machine) -> str:
    """The node if the file names one, else the controller, which is on the nodes' network."""
    if machine.host is not None:
        return machine.host
    config = _asked(["scontrol", "show", "config"])
    hosts = re.findall(r"^SlurmctldHost\S*\s*=\s*([^\s(]+)(?:\(([^)]+)\))?", config, re.MULTILINE)
    if not hosts:
        raise BadInput('Slurm does not say where its controller is; add client = "HOST:PORT" to the cluster file')
    name, address = hosts[0]
    return str(address or name)


def cancelling(machine: Machine, servers: Sequence[StartedServer]) -> str:
    """The command by which a person ends those that wait in a queue, once it answers."""
    return shlex.join(["scancel", *(server.handle["job"] for server in servers)])


def _known_jobs(numbers: Sequence[str]) -> dict[str, Job]:
    """Of these, those that Slurm remembers: the controller for minutes, its accounting, if it keeps any, for long."""
    told = _asked(["squeue", "--me", "--states=all", "--noheader", "--format=%A|%T|%N|%r"])
    jobs = {number: Job(*fields) for number, *fields in _rows(told, 4)}
    forgotten = [number for number in numbers if number not in jobs]
    return {**(_accounted(forgotten) if forgotten else {}), **jobs}


def _accounted(numbers: Iterable[str]) -> dict[str, Job]:
    command = ["sacct", "--allocations", "--noheader", "--parsable2", "--format=JobID,State,NodeList,ExitCode"]
    try:
        told = _asked([*command, f"--jobs={','.join(numbers)}"])
    except BadInput:  # most small clusters keep none
        return {}
    return {number: Job(*fields) for number, *fields in _rows(told, 4)}


def _rows(table: str, columns: int) -> list[list[str]]:
    rows = [line.split("|") for line in table.split("\n")]
    return [row for row in rows if len(row) == columns]


def _said(server: StartedServer, job: Job | None) -> Said:
    word = job.state.partition(" ")[0] if job is not None else ""  # sacct says "CANCELLED by 1000"
    if job is not None and word in WAITING:
        return Said(ServerState.QUEUED, f"{job.reason} ({word.lower()})")
    if job is not None and word in AT_WORK:
        return Said(ServerState.RUNNING, f"on {job.node}")
    how = f"{server.place} is {word.lower() or 'not known to it any more'}"
    last = last_line(Path(server.handle["log"]))
    return Said(ServerState.ENDED, f"{how}: {last}" if last else how)


def _cancel(servers: Sequence[StartedServer]) -> None:
    """Slurm ends what runs by SIGTERM, and by SIGKILL if that does not do."""
    jobs = _known_jobs([server.handle["job"] for server in servers]) if servers else {}
    still = [server.handle["job"] for server in servers if _may_run(jobs.get(server.handle["job"]))]
    if still:
        _asked(["scancel", "--quiet", *still])


def _may_run(job: Job | None) -> bool:
    return job is not None and job.state in WAITING | AT_WORK


def _asked(command: Sequence[str], given: str = "") -> str:
    """What one of Slurm's commands prints. Raises BadInput with its reason."""
    environment = {name: value for name, value in os.environ.items() if name != TOKEN_VARIABLE}  # jobs inherit it
    try:
        ran = subprocess.run(
            command,
            input=given,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=SLURM_SECONDS,
            env=environment,
            start_new_session=True,
        )
    except FileNotFoundError as error:
        raise BadInput(
            f"{command[0]} is not installed here; run this where jobs are submitted (Debian: slurm-client)"
        ) from error
    except subprocess.TimeoutExpired as error:
        raise BadInput(f"{command[0]} has not answered for {SLURM_SECONDS:g} s; try: scontrol ping") from error
    if ran.returncode:
        reason = one_line(ran.stderr.strip()) or f"{command[0]} failed without a word"
        raise BadInput(f"{reason}; {_cure(command[0], reason)}")
    return ran.stdout


def _cure(command: str, reason: str) -> str:
    """Its options change a job that the controller turns down; of anything else `scontrol ping` tells more."""
    if command == "sbatch" and OPTIONS_CURE.search(reason):
        return "see slurm.options in the cluster file"
    return "try: scontrol ping"
