"""Files that are there when they are whole: written beside their place and moved there in the end."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

from tinyekf_py.export.tables import ExportError


class PartFiles:
    """A context manager: what `path_for` gave is moved into place when it is left, and removed if by an exception."""

    def __init__(self, never: Iterable[Path]) -> None:
        """`never` are files that must not be replaced: the recordings."""
        self._never = {path.resolve() for path in never}
        self._places: dict[Path, Path] = {}

    def path_for(self, place: Path) -> Path:
        """Where to write the file that is to stand at `place`; ExportError when a recording stands there."""
        if place.resolve() in self._never:
            raise ExportError(f"{place} is the recording that is exported; give another --output")
        part = place.with_name(f"{place.name}.part")
        self._places[part] = place
        return part

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if error is None:
                for part, place in self._places.items():
                    os.replace(part, place)
        finally:
            for part in self._places:
                part.unlink(missing_ok=True)
