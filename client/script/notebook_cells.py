"""What cells of a notebook show: it ends when they run again or are deleted, since nobody sees it any longer."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from typing import Any

NOTEBOOK_SHELL = "ZMQInteractiveShell"  # IPython's, of a kernel; a terminal's cannot show pictures
CELL = "cellId"  # by which JupyterLab, Jupyter Notebook and VS Code name the cell when they ask to run it
DELETED = "deletedCells"  # by which the first two name those that were deleted since they last asked
LOOK_SECONDS = 0.5  # marimo tells nobody that a cell runs again or is deleted; a thread of the cell can ask


class ShownByCells:
    """What the last run of each cell of a Jupyter notebook shows, and how that is closed."""

    def __init__(self) -> None:
        self._by_cell: dict[str, ExitStack] = {}

    def add(self, shown: ExitStack) -> None:
        """Of the cell that runs; where cells have no names it is the kernel's end that closes it."""
        if (cell := _request_data().get(CELL)) is None:
            return
        if not self._by_cell:
            _ipython().events.register("pre_run_cell", self._before_run)
        self._by_cell.setdefault(cell, ExitStack()).push(shown)

    def _before_run(self, run: Any) -> None:
        """Before anything is opened anew, and takes memory.

        The cell is that of the run, not of the request: a cell's magic may run another one within it.
        """
        due = (getattr(run, "cell_id", None), *_request_data().get(DELETED, ()))  # none before IPython 8.3
        with ExitStack() as ending:
            for cell in due:
                if cell in self._by_cell:
                    ending.push(self._by_cell.pop(cell))


_SHOWN = ShownByCells()


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this, or marimo."""
    return _in_jupyter() or _in_marimo()


def close_when_cell_runs_again(shown: ExitStack) -> None:
    """Close what the cell that runs shows once it runs again or is deleted."""
    if _in_jupyter():
        _SHOWN.add(shown)
    elif _in_marimo():
        _close_at_cells_end(shown)


def _close_at_cells_end(shown: ExitStack) -> None:
    marimo = sys.modules["marimo"]
    if not hasattr(marimo, "current_thread"):  # older ones have none
        return

    def look() -> None:
        with shown:
            while not marimo.current_thread().should_exit:
                time.sleep(LOOK_SECONDS)

    marimo.Thread(target=look, daemon=True).start()


def _in_jupyter() -> bool:
    return type(_ipython()).__name__ == NOTEBOOK_SHELL


def _in_marimo() -> bool:
    marimo = sys.modules.get("marimo")
    return marimo is not None and bool(marimo.running_in_notebook())


def _request_data() -> dict[str, Any]:
    """What the notebook said about the cell that it asked to run."""
    told: dict[str, Any] = _ipython().get_parent().get("metadata", {})
    return told


def _ipython() -> Any:
    """Its shell; None outside of it."""
    ipython = sys.modules.get("IPython")
    return None if ipython is None else ipython.get_ipython()
