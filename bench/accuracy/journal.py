"""Runs that are done, kept on the disk, so that a benchmark of hours can be interrupted."""

from __future__ import annotations

import pickle
from collections.abc import Collection
from pathlib import Path

from tinyekf_py.evaluate.job import Evaluation


class Journal:
    """The file `path` of pickled evaluations; begun anew unless `resume`."""

    def __init__(self, path: Path, *, resume: bool) -> None:
        self._path = path
        self.runs: list[Evaluation] = _read(path) if resume and path.exists() else []
        with path.open("wb") as file:  # without what an interruption left half written
            for run in self.runs:
                pickle.dump(run, file)

    def note(self, run: Evaluation) -> None:
        """One more is done."""
        self.runs.append(run)
        with self._path.open("ab") as file:
            pickle.dump(run, file)

    def done(self, name: str, methods: Collection[str]) -> bool:
        """Whether the run of that name is there, with all those methods."""
        return any(run.name == name and set(methods) <= run.measures.keys() for run in self.runs)


def _read(path: Path) -> list[Evaluation]:
    runs = []
    with path.open("rb") as file:
        while True:
            try:
                runs.append(pickle.load(file))
            except (EOFError, pickle.UnpicklingError):
                return runs
