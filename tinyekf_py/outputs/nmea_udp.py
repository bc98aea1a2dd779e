"""NMEA 0183 in datagrams, to one listener or to a whole network: one datagram holds the sentences of one moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tinyekf_py.outputs.broadcast import DatagramSender
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.nmea_stream import chunks


async def serve(feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve [outputs.nmea_udp] until the program ends; OSError when the host has no address."""
    with DatagramSender(settings["host"], settings["port"]) as datagrams:
        async for chunk in chunks(feed, settings):
            datagrams.send(chunk.everywhere)
            datagrams.send(chunk.here, local_only=True)
