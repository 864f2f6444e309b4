"""Looks at a whole cluster: ways into its machines, its servers, their volume and the links between them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

from volsplat.deploy.cluster.cluster_use import ClusterUse
from volsplat.deploy.cluster.running import MOST_AT_ONCE, RunningCluster
from volsplat.deploy.cluster.state import ClusterBusy, ClusterState, KnownServer
from volsplat.deploy.doctor import servers
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.forecast import Drawer, Size, drawn_level, forecast
from volsplat.deploy.doctor.link_speed import link_speed
from volsplat.deploy.doctor.meeting import Meeting
from volsplat.deploy.doctor.packet_links import packet_links
from volsplat.deploy.doctor.way_in import way_in
from volsplat.deploy.launchers.launcher import Report
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.tunnel import OPEN_SECONDS
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError
from volsplat.protocol.wire.connection import Connection

There = dict[str, tuple[KnownServer, Connection]]  # by name


class Doctor:
    """One examination. Servers of a cluster that is not up are started for it, and ended after it."""

    def __init__(
        self, path: Path, volume: str | None, size: Size, tell: Callable[[Finding], None], doing: Report
    ) -> None:
        """`size` is that of the images to come.

        `tell` gets each finding as it is made, `doing` a line on what is waited for. Raises BadInput.
        """
        self._running = RunningCluster(path)
        self._volume = None if volume is None else self._running.volume(volume)
        self._size = size
        self._tell, self._doing = tell, doing
        self._drawers: list[Drawer] = []
        self.findings: list[Finding] = []

    def examine(self) -> None:
        """Raises BadInput where another client has the servers."""
        self._ways_in()
        use = ClusterUse(self._running.folder)
        use.take(self._doing)
        try:
            self._examine_servers()
        finally:
            use.end()

    def _examine_servers(self) -> None:
        state = self._running.state()
        if state is not None:
            for title, line in self._running.never_started(state):
                self._find(Finding(title, "start", right=False, line=line))
            self._of_servers(state)
            return
        with ExitStack() as ended:
            ended.callback(self._running.down, self._doing)
            try:
                self._start()
            except ClusterBusy:  # by somebody else, who has it then
                ended.pop_all()
                raise
            if (state := self._running.state()) is not None:
                self._of_servers(state)

    def _find(self, finding: Finding) -> None:
        self.findings.append(finding)
        self._tell(finding)

    def _ways_in(self) -> None:
        machines = list({machine.title: machine for machine in self._running.cluster.machines}.values())
        self._doing(f"looking at the ways into {len(machines)} machine{'s' if len(machines) > 1 else ''}")
        with ThreadPoolExecutor(MOST_AT_ONCE, "way in") as pool:
            for found in pool.map(way_in, machines):
                for finding in found:
                    self._find(finding)

    def _start(self) -> None:
        try:
            self._running.up(self._doing)
        except ClusterBusy:
            raise
        except BadInput as error:
            self._find(Finding(self._running.cluster.name, "start", right=False, line=str(error)))

    def _of_servers(self, state: ClusterState) -> None:
        meeting = Meeting(self._running, state)
        try:
            self._tunnels(meeting.tunnels)
            there = self._there(state, meeting)
            seen = self._volumes(there, meeting)
            self._doing("having map/shade servers reach the splat servers")
            for finding in packet_links(there, meeting):
                self._find(finding)
            if seen is not None:
                self._forecast(seen)
        finally:
            meeting.close()

    def _tunnels(self, tunnels: Tunnels) -> None:
        for tunnel in tunnels.all:
            self._doing(f"opening the tunnel to {tunnel.host}")
            failure = tunnel.failure(OPEN_SECONDS)
            self._find(Finding(tunnel.host, "tunnel", not failure, failure or f"carries {tunnel.way}"))

    def _there(self, state: ClusterState, meeting: Meeting) -> There:
        there: There = {}
        for one in state.servers:
            name = one.started.name
            self._doing(f"waiting for {name}")
            try:
                if failure := meeting.tunnels.failure(one.machine):
                    raise PeerLost(failure)
                there[name] = one, meeting.server(one)
            except VolsplatError as error:
                self._find(Finding(name, "link", right=False, line=str(error)))
                continue
            self._find(servers.joined(*there[name]))
            finding, threads = servers.machine(*there[name], meeting)
            self._find(finding)
            self._doing(f"measuring the link to {name}")
            finding, bits = link_speed(*there[name], meeting)
            self._find(finding)
            if threads is not None:
                near = there[name][1].may_share_memory
                self._drawers.append(Drawer(one.program, threads, None if near else bits))
        return there

    def _forecast(self, seen: servers.Seen) -> None:
        """Of the volume that was seen, where all is right."""
        if all(finding.right for finding in self.findings):
            drawn = drawn_level(seen.levels, self._size)
            self._find(forecast(self._running.cluster.name, self._drawers, drawn, self._size))

    def _volumes(self, there: There, meeting: Meeting) -> servers.Seen | None:
        """The volume as the first server sees it."""
        if self._volume is None:
            return None
        seen: servers.Seen | None = None
        for one, server in there.values():
            if one.program is Program.MAPSHADE_SERVER:
                self._doing(f"having {one.started.name} look at {self._volume}")
                finding, seen = servers.volume(one, server, meeting, self._volume, seen)
                self._find(finding)
        return seen
