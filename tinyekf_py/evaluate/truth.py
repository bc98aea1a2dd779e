"""The truth: what a better instrument, or the simulator, says that the heading was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Between rows of the truth further apart than this nothing is judged.
MAX_GAP_S = 1.0


class TruthError(ValueError):
    """A truth CSV that cannot be used: one line saying which, where and why."""


@dataclass(frozen=True, slots=True)
class Truth:
    """True headings over time; latitude and longitude are NaN where nobody knows them. All of shape (rows,)."""

    t_s: Floats  #: seconds since the recording's start, rising
    heading_deg: Floats  #: true
    lat_deg: Floats
    lon_deg: Floats

    def heading_at(self, t_s: Floats) -> Floats:
        """True heading at each moment, degrees [0, 360); NaN outside the truth's span and in its gaps."""
        if len(self.t_s) < 2:
            return np.full(len(t_s), np.nan)
        smooth_deg = np.degrees(np.unwrap(np.radians(self.heading_deg)))
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        known = (
            (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1] + 1e-9) & (self.t_s[after] - self.t_s[after - 1] < MAX_GAP_S)
        )
        return np.where(known, np.interp(t_s, self.t_s, smooth_deg) % 360.0, np.nan)


def wrap_deg(angle_deg: Floats) -> Floats:
    """Angles moved to (-180, 180]; NaN stays."""
    return 180.0 - (180.0 - angle_deg) % 360.0


def read_truth(path: str | Path, *, offset_deg: float = 0.0) -> Truth:
    """The truth CSV `path` (t_s,heading_deg[,lat_deg,lon_deg]); `offset_deg` is added to its headings."""
    try:
        lines = Path(path).read_text("utf-8").splitlines()
    except OSError as error:
        raise TruthError(f"cannot read truth {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise TruthError(f"{path} is not a truth CSV: it is not text") from error
    columns = lines[0].split(",") if lines else []
    if columns[:2] != ["t_s", "heading_deg"]:
        raise TruthError(f"{path} is not a truth CSV: its first line is not t_s,heading_deg[,lat_deg,lon_deg]")
    has_place = columns[2:4] == ["lat_deg", "lon_deg"]
    rows = []
    for number, line in enumerate(lines[1:], 2):
        try:
            fields = [float(field) if field else np.nan for field in line.split(",")]
        except ValueError as error:
            raise TruthError(f"{path}, line {number}: {error}") from error
        if len(fields) != len(columns):
            raise TruthError(f"{path}, line {number}: {len(fields)} fields where the first line has {len(columns)}")
        rows.append(fields[:4] if has_place else [*fields[:2], np.nan, np.nan])
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    table = table[np.isfinite(table[:, 0]) & np.isfinite(table[:, 1])]
    if np.any(np.diff(table[:, 0]) <= 0):
        raise TruthError(f"{path}: its times do not rise")
    return Truth(table[:, 0], (table[:, 1] + offset_deg) % 360.0, table[:, 2], table[:, 3])
