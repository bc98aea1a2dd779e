"""What a device says: opens a port, when told to, and listens who it is."""

from __future__ import annotations

import re
import select
import time
from collections.abc import Sequence
from itertools import pairwise

from acquisition.devices import COMPASS, GPS, IMU
from acquisition.port import open_port
from acquisition.port_error import PortError

#: Speeds in the order in which they are tried; a USB device and a pty ignore them.
BAUDS = (115200, 9600, 4800, 38400)
LISTEN_S = 1.5
_WANTED = 2  # sentences that make a certain case

_GPS_SENTENCE = re.compile(rb"\$[A-Z]{2}(GGA|RMC|VTG|GSA|GLL|GNS)[^*\n]*\*[0-9A-Fa-f]{2}")
_COMPASS_SENTENCE = re.compile(rb"\$[A-Z]{2}(HDM|HDG|HDT|THS)[^*\n]*\*[0-9A-Fa-f]{2}")
_IMU_LINE = re.compile(rb"\*-?\d+(\.\d+)?(,-?\d+(\.\d+)?){2,14}\r?\n")


def kind_of(said: bytes) -> str:
    """gps, compass or imu, of what a device said; empty when it is not clear."""
    counts = {
        GPS: len(_GPS_SENTENCE.findall(said)),
        COMPASS: len(_COMPASS_SENTENCE.findall(said)),
        IMU: max(len(_IMU_LINE.findall(said)), _hex_frames(said)),
    }
    kind = max(counts, key=lambda name: counts[name])
    return kind if counts[kind] >= _WANTED else ""


def _hex_frames(said: bytes) -> int:
    """Frames of the EBIMU's binary format: 55 55 at equal distances."""
    starts = [match.start() for match in re.finditer(rb"\x55\x55", said)]
    gaps = [after - before for before, after in pairwise(starts)]
    return len(starts) if len(gaps) >= 3 and len(set(gaps)) == 1 and 10 <= gaps[0] <= 64 else 0


def probe(path: str, bauds: Sequence[int] = BAUDS, listen_s: float = LISTEN_S) -> tuple[str, int]:
    """Listen at `path` at each speed: (kind, baud) of who speaks, ("", 0) when nobody does or it is not clear.

    PortError when the port cannot be opened. The device is not written to and its modem lines are not touched.
    """
    for baud in bauds:
        port = open_port(path, baud)
        try:
            said = b""
            end = time.monotonic() + listen_s
            while (left := end - time.monotonic()) > 0:
                if select.select([port.fileno()], [], [], left)[0]:
                    said += port.read()
                    if kind := kind_of(said):
                        return kind, baud
        finally:
            port.close()
    return "", 0


__all__ = ["BAUDS", "PortError", "kind_of", "probe"]
