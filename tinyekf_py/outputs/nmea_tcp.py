"""NMEA 0183 to everybody who connects by TCP, as chart plotters and gpsd do."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from tinyekf_py.outputs.address import address_text
from tinyekf_py.outputs.broadcast import listening
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.nmea_stream import chunks

_log = logging.getLogger(__name__)


async def serve(feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve [outputs.nmea_tcp] until the program ends; OSError when the port cannot be had."""
    async with listening(settings["host"], settings["port"]) as server:
        _log.info("NMEA 0183 at %s", address_text("tcp", settings))
        async for chunk in chunks(feed, settings):
            server.send(chunk.everywhere)
            server.send(chunk.here, local_only=True)
