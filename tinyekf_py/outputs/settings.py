"""The configuration's tables [outputs.*]: what each output is told."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from tinyekf_py.config_key import boolean, integer, key, nonempty_text, number, text, texts, words

#: The sentences that can be sent, by their formatter.
SENTENCES = ("HDT", "THS", "HDG", "HDM", "ROT", "XDR", "GGA", "RMC", "ALR")


def _talker(value: object) -> str:
    if not isinstance(value, str) or len(value) != 2 or not (value.isascii() and value.isalpha() and value.isupper()):
        raise ValueError("must be two capital letters in quotes")
    return value


def _device(value: object) -> str:
    path = nonempty_text(value)
    if "://" in path:
        raise ValueError("must be a device, not a URL; outputs.nmea_tcp and outputs.nmea_udp serve networks")
    return path


_port = integer(1, 65535)
_enabled = "Whether this output is on."
_host = "Address to listen on; 127.0.0.1 is this machine alone, 0.0.0.0 everybody who can reach it."


@dataclass(frozen=True, slots=True, kw_only=True)
class NmeaConfig:
    """NMEA 0183, over whichever of the three ways below are on."""

    talker: str = key("GP", "Talker of every sentence, two letters; gpsd takes a heading only from GP.", _talker)
    sentences: tuple[str, ...] = key(SENTENCES, "Which sentences are sent.", words(*SENTENCES))
    rate_hz: float = key(10.0, "How often they are sent.", number(1, 10), unit="Hz")
    send_deviation: bool = key(
        False,
        "Whether HDG says the compass' deviation, which is applied already and which its listeners add again.",
        boolean,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NmeaTcpConfig:
    """NMEA 0183 to everybody who connects."""

    enabled: bool = key(False, _enabled, boolean)
    host: str = key("127.0.0.1", _host, nonempty_text)
    port: int = key(10110, "TCP port; 10110 is registered for NMEA 0183.", _port)


@dataclass(frozen=True, slots=True, kw_only=True)
class NmeaUdpConfig:
    """NMEA 0183 in datagrams."""

    enabled: bool = key(False, _enabled, boolean)
    host: str = key("127.0.0.1", "Where to; 255.255.255.255 or a network's last address is everybody.", nonempty_text)
    port: int = key(10110, "UDP port; 10110 is registered for NMEA 0183.", _port)


@dataclass(frozen=True, slots=True, kw_only=True)
class NmeaSerialConfig:
    """NMEA 0183 over a serial line or a pty."""

    enabled: bool = key(False, _enabled, boolean)
    port: str = key("/dev/fjNMEA", "The device.", _device)
    baud: int = key(38400, "Its speed; 4800 is the standard's own and takes few sentences.", integer(1200, 4_000_000))


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalKConfig:
    """Signal K deltas as lines of JSON over TCP and UDP; over WebSocket they come from [outputs.web]."""

    enabled: bool = key(False, _enabled, boolean)
    host: str = key("127.0.0.1", _host, nonempty_text)
    port: int = key(8377, "TCP port; 0 for UDP alone. A signalk-server listens on 8375.", integer(0, 65535))
    udp_host: str = key("", "Where datagrams go; empty for nowhere.", text)
    udp_port: int = key(8376, "Their UDP port.", _port)
    rate_hz: float = key(5.0, "How often deltas are sent.", number(1, 10), unit="Hz")


@dataclass(frozen=True, slots=True, kw_only=True)
class WebConfig:
    """The live page, its API, metrics, and Signal K over WebSocket."""

    enabled: bool = key(False, _enabled, boolean)
    host: str = key("127.0.0.1", _host, nonempty_text)
    port: int = key(8080, "TCP port.", _port)
    rate_hz: float = key(10.0, "How often a page is sent what is new.", number(1, 10), unit="Hz")
    names: tuple[str, ...] = key((), "Host names it goes by beside localhost, as in an address bar: boat.local.", texts)
    read_token: bool = key(False, "Whether reading needs the token too, which control needs anyway.", boolean)
    token_file: str = key(
        "", "Where the token is kept; empty for $STATE_DIRECTORY/web-token or ~/.config/tinyekf/token.", text
    )


def switched_on(outputs: Any) -> dict[str, dict[str, Any]]:
    """The settings of each output that is on in the configuration's [outputs], as the output process takes them.

    Those of NMEA 0183 come with what [outputs.nmea] and [outputs] itself say.
    """
    served = {}
    for name in ("nmea_tcp", "nmea_udp", "nmea_serial", "signalk", "web"):
        table = getattr(outputs, name)
        if table.enabled:
            served[name] = {
                **(dataclasses.asdict(outputs.nmea) if name.startswith("nmea") else {}),
                **dataclasses.asdict(table),
                "allow_simulated": outputs.allow_simulated,
            }
    return served
