"""A volume with its servers, as Python sees it.

    from volsplat.client import Session

    with Session("head.nrrd", workers=2) as session:
        image = session.render(scene)

Threads: one receives from each server and one sends to it, one runs the coordinator; all end with the session.
Importing this module does not import torch, nor does the session until a tensor is asked for.
"""

from __future__ import annotations

import atexit
import logging
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from volsplat.client.caller.arguments import (
    checked_bytes,
    checked_index,
    checked_number,
    checked_scene,
    checked_step,
    checked_volume,
)
from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.caller.own_process import OwnProcess
from volsplat.client.coordinator.events.events import FileVoxelAsked, FolderAsked, Question, VolumeAsked
from volsplat.client.coordinator.events.instructions import Found
from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.memory.array_volume import SAVE_FIRST, volume_in_memory
from volsplat.client.session.asked_images import AskedImages, DrawingTurn
from volsplat.client.session.coordination import Coordination
from volsplat.client.session.kept_cluster import KeptCluster
from volsplat.client.session.links.server_links import ServerLinks
from volsplat.client.session.renderer import FILE_SECONDS, Refinement, Renderer
from volsplat.client.session.session_servers import asked_servers
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.counts import Counts
from volsplat.program.extras import need
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.description.volume_name import check_name
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.levels import Thinning
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.tokens import Token

if TYPE_CHECKING:
    from torch import Tensor

    from volsplat.client.ui.notebook_widget import VolumeWidget

log = logging.getLogger(__name__)


class Session(Renderer):
    """A volume held by map/shade servers, and drawn by splat servers that share out the image.

    `volume` is a path as the servers see it, or an array or image in memory, which servers of this machine share. With
    None there is nothing to draw, and the servers tell what lies in folders. With `spawn` the servers are started on
    this machine, and share out its cores or as many `threads`; without it they are started by hand and join at
    `listen`. `memory` is how many bytes each map/shade server may hold of a prepared volume; by default half of what
    its machine has left, shared with the others there. With the path of a `cluster` file its servers are used, brought
    up for this session alone if they are not yet. A volume that is not `held` is surveyed a few sheets at a time, and
    only read when something is drawn of it. A server that says nothing for `silence` seconds counts as lost: others
    take over what it held. Links between machines are encrypted, with `tls` those of this one as well, with False none;
    servers that are started by hand must be told the same. Of each finished frame what every process did when goes into
    the file `trace`, as JSON that chrome://tracing and Perfetto load. Servers that are started here read nothing
    outside of the folder `data_root`, if given; Linux alone can hold them to it. `on_progress` gets one line for each
    thing that takes time, `on_loss` one for each server that the session goes on without, on threads of the session:
    what would have to wait for it there raises BadInput. Both may close it, but `on_progress` of a session by `cluster`
    should leave that to another thread.

    Numbers may be numpy's and torch's, here and in scenes, steps letters, `listen` HOST:PORT, `memory` a text as "2G".
    Raises BadInput for what is none, as all methods do, and the session goes on; also for what would have no effect, as
    `threads` of servers started by hand or `workers` of a cluster. A session that nobody closes ends with the script.
    """

    def __init__(
        self,
        volume: str | Path | Any | None,
        *,
        workers: int | None = None,
        splat_servers: int | None = None,
        threads: int | None = None,
        listen: Address | str | None = None,
        spawn: bool = True,
        token: Token | None = None,
        memory: int | str | None = None,
        held: bool = True,
        silence: float | None = None,
        tls: bool | None = None,
        cluster: str | Path | KeptCluster | None = None,
        trace: str | Path | None = None,
        data_root: str | Path | None = None,
        on_progress: Callable[[str], None] = log.info,
        on_loss: Callable[[str], None] = log.warning,
    ) -> None:
        self._in_memory = volume_in_memory(volume)  # given back when nobody holds it
        if self._in_memory is not None and (cluster is not None or not spawn):
            raise BadInput(SAVE_FIRST)
        name = None if volume is None else checked_volume(volume if self._in_memory is None else self._in_memory.place)
        self._shown = (name or "no volume") if self._in_memory is None else self._in_memory.description.name
        if trace is not None and name is not None:
            check_written_apart(name, records=[Path(trace)])
        memory = None if memory is None else checked_bytes(memory, "memory")
        self._servers = asked_servers(
            workers=workers,
            splat_servers=splat_servers,
            threads=threads,
            listen=listen,
            spawn=spawn,
            token=token,
            silence=silence,
            tls=tls,
            cluster=cluster,
            data_root=data_root,
            report=on_progress,
            tell_missing=on_loss,
        )
        try:
            self._tracer = None if trace is None else FrameTracer(Path(trace))
            self._coordination = Coordination(self._tracer, on_progress, on_loss, self._servers.close)
        except BaseException:
            self._servers.release()  # or no other session of this process may use the cluster
            raise
        self.counts = Counts()  # what was done, and lost
        self._has_volume = name is not None
        self._opened_by = OwnProcess()
        self._closed = False
        self._closing = threading.RLock()  # guards _closed, until nothing is left

        with self._servers.beginning():
            self._links = ServerLinks(
                self._servers.listens_at,
                self._servers.token,
                self._coordination.tell,
                newest_frame=lambda: self._coordination.frames.newest,
                silence=self._servers.silence,
                encryption=self._servers.encryption,
                replaces=self._servers.replaced,
                tracer=self._tracer,
                counts=self.counts,
            )
        self._coordination.begin(self._links)
        self._images = AskedImages(self._coordination, self._links.session, self.counts, self._tracer)
        atexit.register(self.close)  # a script may forget to
        self.path: str | None = None  # of the volume, if it has one that holds here and not only where its servers are
        try:
            self._servers.join(self._links)
            if name is not None:
                seen = self._servers.volume(name)
                if self._in_memory is None and (self._servers.here or Path(seen).is_absolute()):
                    self.path = seen
                workers, splat_servers = self._servers.workers, self._servers.splat_servers
                self._coordination.tell(VolumeAsked(seen, workers, splat_servers, memory or self._servers.memory, held))
        except BaseException:
            self.close()
            raise

    # -- what a person calls

    @property
    def address(self) -> Address:
        """Where servers join."""
        return self._links.address

    @property
    def token(self) -> Token:
        """What they must know for it."""
        return self._links.token

    @property
    def server_processes(self) -> list[int]:
        """Process ids of the servers that this session started."""
        return self._links.process_ids

    @property
    def servers(self) -> list[ServerState]:
        """Every server that has joined, as it stands, those that were lost included."""
        return self._coordination.servers

    @property
    def failure(self) -> VolsplatError | None:
        """What ended the session, None as long as it goes on."""
        return self._coordination.failure

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume; waits until every server has read its sub-cube."""
        self._check_has_volume()
        return self._coordination.volume

    def default_scene(self) -> Scene:
        """A scene chosen from the data."""
        return self.volume.default_scene()

    def finish(self, scene: Scene, step: Step | str = Step.F) -> Refinement:
        """As `render`, with what it took."""
        self._check_has_volume()
        return self._images.finish(checked_scene(scene), checked_step(step))

    def _refined(
        self, scene: Scene, first: Step, last: Step, interval: float, exact: Collection[Step], thinning: Thinning
    ) -> Iterator[Refinement]:
        self._check_has_volume()
        return self._opened_by.checked(self._images.refine(scene, first, last, interval, exact, thinning))

    def slice(self, axis: str, index: int) -> Tensor:
        """The densities of a slice across "i", "j" or "k", float32 in the data's units; NaN where there are none.

        The earlier of the other two axes runs along a row: across "k" it is (j, i). Values are those that pictures are
        drawn with, of 256 steps between the ends of the density window: the one that was drawn with last, or else the
        default scene's. Those of a prepared volume are of the level held.
        Raises BadInput if the volume has no such slice or torch is not installed, PeerLost if a part of it is gone.
        """
        return self._slice(self.default_scene(), axis, index, MOST_SAMPLES, as_packed=True).tensor

    def file_voxel(self, index: Index, within: float = FILE_SECONDS) -> FileVoxel | None:
        """The voxel (i, j, k) as the volume's file has it, not as the 8 bits that it is drawn with.

        None if that is not known `within` so many seconds, if more than 64 MiB would have to be read for it, and of a
        prepared volume, which has nothing but packets. Frames that run go on.
        Raises BadInput if there is no such voxel or the file cannot be read, and PeerLost if the session has ended.
        """
        index, within = checked_index(index), checked_number(within, "within", least=0.0)
        if (in_memory := self._in_memory) is not None:
            in_memory.check_open()
        answer = self._ask_about(lambda number: FileVoxelAsked(number, index))
        try:
            found = answer.result(min(within, threading.TIMEOUT_MAX))
        except TimeoutError:
            return None
        assert found is None or isinstance(found, FileVoxel), "nothing else was asked for"
        return found

    def list_folder(self, root: str | Path, folder: str = "", words: str = "") -> messages.FolderListed:
        """The volumes and folders in a `folder` below `root`, as the servers see them; of names those with `words`.

        What does not lie below the root, links followed, is not told. Frames that run go on.
        Raises BadInput if there is no such folder, or it cannot be read, or names are too long to be asked for, and
        PeerLost if no server is there to look.
        """
        self._opened_by.check()
        seen = self._servers.volume(checked_volume(root))
        for name in (folder, words):
            check_name(name)
        if self._has_volume:
            self.volume  # noqa: B018  until it is known there may be no server
        found = self._coordination.ask(lambda number: FolderAsked(number, seen, folder, words)).result()
        assert isinstance(found, messages.FolderListed), "it is listed, or an error says why not"
        return found

    def _found(self, asked: Callable[[int], Question]) -> Found:
        return self._ask_about(asked).result()

    def _ask_about(self, question: Callable[[int], Question]) -> Future[Found]:
        """Where the answer will be to a question, given its number."""
        self.volume  # noqa: B018  until it is known there is nothing to be told
        return self._coordination.ask(question)

    def widget(self, scene: Scene | None = None, controls: bool = False) -> VolumeWidget:
        """A viewport for a notebook, with the scene as its trait, and with `controls` steps and tables beside it.

        Raises BadInput without the extra [notebook], and where no event loop runs: a notebook has one.
        """
        need("anywidget", "a widget", "notebook")
        from volsplat.client.ui.notebook_widget import VolumeWidget

        return VolumeWidget(self, scene, controls)

    def turn(self) -> DrawingTurn:
        """For viewers, which give way to scripts and to one another, and go first while a hand moves the scene."""
        self._check_has_volume()
        return self._images.turn()

    def abort(self) -> None:
        """Abort what runs; whoever waits for it gets FrameGivenUp once every server has acknowledged."""
        self._coordination.abort()

    def close(self, another: bool = False) -> None:
        """End the session and every server that it started, within two seconds. Safe to call twice.

        With `another` those started by hand look for one more session at the same address.
        Ctrl-C meanwhile waits for that: nothing may be left of the servers.
        Does nothing in a process that was forked from the session's, which goes on.
        """
        if not self._opened_by.is_here:
            return
        with interrupts_held(on_signal=lambda: None):
            if not self._closing.acquire(blocking=not self._coordination.is_here):
                return  # whoever closes it waits for this thread
            try:
                if not self._closed:
                    self._closed = True
                    self._close(another)
            finally:
                self._closing.release()

    def _check_has_volume(self) -> None:
        self._opened_by.check()
        if not self._has_volume:
            raise BadInput("this session has no volume, of which it could tell or draw; open one that has")

    def _close(self, another: bool) -> None:
        atexit.unregister(self.close)
        self._servers.close()
        self._links.take_no_more()  # resident servers look for the next client at once
        self._coordination.end(another)
        self._links.close()
        self._servers.release()
        self._coordination.fail(PeerLost("the session is closed"))
        self._in_memory = None
        if self._tracer is not None:
            self._tracer.close()

    def __repr__(self) -> str:
        return f"<volsplat session of {self._shown}{', closed' * self._closed}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a session belongs to the process that opened it and cannot be copied or pickled; open another")
