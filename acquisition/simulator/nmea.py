"""NMEA 0183 as the simulated devices print it."""

from __future__ import annotations

from functools import reduce
from operator import xor


def sentence(body: str) -> bytes:
    """`body` (without the dollar) as a sentence with its checksum, without line ending."""
    octets = body.encode("ascii")
    return b"$%b*%02X" % (octets, reduce(xor, octets))


def angle_field(degrees: float, degree_digits: int) -> str:
    """The size of a latitude (2 degree digits) or longitude (3) as degrees and minutes with five decimals."""
    whole, rest = divmod(round(abs(degrees) * 6_000_000), 6_000_000)
    minutes, fraction = divmod(rest, 100_000)
    return f"{whole:0{degree_digits}d}{minutes:02d}.{fraction:05d}"
