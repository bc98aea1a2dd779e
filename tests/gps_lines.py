"""Sentences as a GPS receiver sends them, and decoders fed with them."""

from __future__ import annotations

from collections.abc import Iterable

from acquisition.gps import GpsDecoder
from acquisition.sample import GpsSample

LAT, LON = "3557.60156,N", "12631.19962,E"


def nmea(body: str) -> bytes:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}".encode()


def gga(
    utc: str, *, lat: str = LAT, quality: str = "1", hdop: str = "1.04", talker: str = "GP", used: str = "08"
) -> bytes:
    return nmea(f"{talker}GGA,{utc},{lat},{LON},{quality},{used},{hdop},12.3,M,25.1,M,,")


def rmc(
    utc: str, *, status: str = "A", course: str = "27.39", date: str = "241126", end: str = ",,,A", lat: str = LAT
) -> bytes:
    return nmea(f"GPRMC,{utc},{status},{lat},{LON},7.379,{course},{date}{end}")


def gsa(hdop: str = "0.95") -> bytes:
    return nmea(f"GPGSA,A,3,02,04,07,,,,,,,,,,1.71,{hdop},1.38")


def vtg(knots: str = "5.20", course: str = "77.5") -> bytes:
    return nmea(f"GPVTG,{course},T,,M,{knots},N,9.7,K,A")


def feed(decoder: GpsDecoder, lines: Iterable[bytes], start_us: int = 0, step_us: int = 1000) -> list[GpsSample]:
    """Feeds the lines `step_us` apart; the first is stamped `start_us` + `step_us`."""
    samples: list[GpsSample] = []
    for i, line in enumerate(lines, 1):
        samples += decoder.decode(start_us + i * step_us, line)
    return samples


def started(*lines: bytes, rhythm: Iterable[bytes] | None = None) -> tuple[GpsDecoder, list[GpsSample]]:
    """A decoder that has learned the rhythm GGA, RMC from two epochs before 03:00:00, and what `lines` give then."""
    decoder = GpsDecoder(0)
    feed(decoder, rhythm or [gga("025959.80"), rmc("025959.80"), gga("025959.90"), rmc("025959.90")])
    return decoder, feed(decoder, lines, start_us=100_000)
