"""Answers about files, given by a thread of its own: a slow disk delays nothing but them."""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from queue import SimpleQueue

from volsplat.mapshade_server.answers.file_voxels import FileVoxels
from volsplat.mapshade_server.answers.volume_answers import Answer
from volsplat.mapshade_server.readers.reading.data_root import DataRoot
from volsplat.protocol.messages.folder_messages import ListFolder
from volsplat.protocol.messages.refusals import refusal
from volsplat.protocol.messages.value_messages import ReadVoxel
from volsplat.protocol.text.errors import VolsplatError

OfFiles = ReadVoxel | ListFolder


class FileAnswers:
    """One after the other. Nobody waits for the thread at the end: it may be in a read that does not return."""

    def __init__(
        self,
        data_root: DataRoot | None,
        at_work: Callable[[], AbstractContextManager[None]],
        give: Callable[[Answer], None],
    ) -> None:
        """Volumes lie below `data_root`, if given. A library that reads may hold the interpreter while `at_work`.

        Both functions may raise VolsplatError if nobody takes answers any more.
        """
        self._data_root = data_root
        self._at_work = at_work
        self._give = give
        self._asked: SimpleQueue[OfFiles | None] = SimpleQueue()  # the exchanges bound it
        self._thread: threading.Thread | None = None

    def ask(self, request: OfFiles) -> None:
        """Have it answered. One thread asks."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._answer_all, name="look at files", daemon=True)
            self._thread.start()
        self._asked.put(request)

    def end(self) -> None:
        self._asked.put(None)

    def _answer_all(self) -> None:
        voxels = FileVoxels()
        with suppress(VolsplatError):  # the client is lost, which others notice
            while (request := self._asked.get()) is not None:
                with self._at_work():
                    answer = self._answer(voxels, request)
                self._give(answer)

    def _answer(self, voxels: FileVoxels, request: OfFiles) -> Answer:
        try:
            if self._data_root is not None:
                self._data_root.check(request.path)
            if isinstance(request, ReadVoxel):
                return voxels.read(request)
            from volsplat.mapshade_server.readers.folder_listing import listed  # brings readers, and few ask for it

            return Answer(listed(request))
        except Exception as error:  # whatever it is: the client must hear of it
            return Answer(refusal(request, error))
