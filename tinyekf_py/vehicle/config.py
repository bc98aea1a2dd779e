"""The configuration of a drive: which column of which file is which channel, in what unit, and how good.

A **channel** is one axis of one sensor. `value = scale * raw + offset`, in `unit`; `raw` may be the voltage of an A/D
converter, a count of impulses, or already the unit. What belongs to a sensor rather than to a recording (scale, offset,
unit, latency) may stand in a calibration file of its own, `[channels.NAME]` tables, which is laid over the
configuration. Without a configuration the columns are those that `simulate` writes in units.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from acquisition.toml_value import toml_value
from tinyekf_py.config_key import ConfigError, choice, key, keys_of, nearest_of, nonempty_text, number, numbers, text
from tinyekf_py.vehicle.noise import Noise

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Section = TypeVar("Section", bound="DataclassInstance")

#: Unit -> (quantity, size in SI units).
UNITS: dict[str, tuple[str, float]] = {
    "deg": ("angle", 1.0),
    "m": ("distance", 1.0),
    "km": ("distance", 1000.0),
    "m/s": ("speed", 1.0),
    "km/h": ("speed", 1 / 3.6),
    "kn": ("speed", 1852 / 3600),
    "rad/s": ("rotation rate", 1.0),
    "deg/s": ("rotation rate", 0.017453292519943295),
    "m/s2": ("acceleration", 1.0),
    "g": ("acceleration", 9.80665),
}

#: Channel -> quantities it may have, standard unit. A distance is cumulative (a counter).
CHANNELS: dict[str, tuple[tuple[str, ...], str]] = {
    "gps_lat": (("angle",), "deg"),
    "gps_lon": (("angle",), "deg"),
    "gps_x": (("distance",), "m"),
    "gps_y": (("distance",), "m"),
    "gps_sigma": (("distance",), "m"),
    "odo_left": (("distance", "speed"), "m"),
    "odo_right": (("distance", "speed"), "m"),
    "odo": (("distance", "speed"), "m"),
    "bosch_yaw_rate": (("rotation rate",), "deg/s"),
    "xsens_yaw_rate": (("rotation rate",), "deg/s"),
    "silicon_yaw_rate": (("rotation rate",), "deg/s"),
    "bosch_accel": (("acceleration",), "m/s2"),
    "xsens_accel": (("acceleration",), "m/s2"),
    "oss": (("distance", "speed"), "m/s"),
}


def _columns(value: object) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or not names or not all(isinstance(n, str) and n.strip() for n in names):
        raise ValueError("must be a column's name in quotes, or a list of them")
    return tuple(names)


def _axis(value: object) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or not 1 <= len(value) <= 3:
        raise ValueError("must be one to three numbers, one for each column")
    return numbers([str(i + 1) for i in range(len(value))], -1, 1)(value)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeConfig:
    """[time]: the time stamps."""

    column: str = key("t_s", "Column of the time stamps.", nonempty_text)
    unit: str = key("s", "Unit of the time stamps: s, ms or us.", choice("s", "ms", "us"))


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveConfig:
    """[drive]: the vehicle and its epochs."""

    epoch_s: float = key(
        0.1, "Longest time between epochs; every GPS position is one in any case.", number(0.001, 10), unit="s"
    )
    track_width_m: float = key(1.5, "Distance between the odometer's two wheels.", number(0.1, 10), unit="m")
    standstill_mps: float = key(0.1, "Below this speed the vehicle stands.", number(0, 10), unit="m/s")
    start_azimuth_deg: float | str = key(
        "auto", "Azimuth at the first position; auto: from the first metres.", number(-360, 360, or_word="auto"),
        unit="degrees",
    )  # fmt: skip
    max_gap_s: float = key(
        0.5, "A sensor silent for longer has measured nothing meanwhile.", number(0.001, 60), unit="s"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsConfig:
    """[gps]: the receiver."""

    latency_s: float = key(0.0, "How late its positions are stamped.", number(-10, 10), unit="s")
    lever_m: tuple[float, ...] = key(
        (0.0, 0.0), "Where the antenna is: forward and to starboard of the reference point.",
        numbers(("forward", "starboard"), -50, 50), unit="m",
    )  # fmt: skip
    change_column: str = key(
        "", "Column whose change tells a new position, where rows repeat the last; else a changed position does.", text
    )
    sigma_scale: float = key(1.0, "The column of gps_sigma times this is one standard deviation.", number(0.001, 1000))


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelConfig:
    """[channels.NAME]: one axis of one sensor."""

    column: tuple[str, ...] = key((), "Its column; several with axis.", _columns)
    axis: tuple[float, ...] = key(
        (1.0,), "The vehicle's axis in the sensor's frame: columns are summed with these weights.", _axis
    )
    file: str = key("", "File that holds it, beside DATA.csv; empty is DATA.csv itself.", text)
    time_column: str = key("", "Column of its time stamps there; empty is that of [time].", text)
    raw: str = key(
        "unit", "What the column holds: unit, V (A/D converter) or impulses.", choice("unit", "V", "impulses")
    )
    scale: float = key(1.0, "Value = scale * raw + offset.", number(-1e9, 1e9))
    offset: float = key(0.0, "Value = scale * raw + offset.", number(-1e9, 1e9))
    unit: str = key("", "Unit of the value; empty is the channel's standard.", choice("", *UNITS))
    latency_s: float = key(0.0, "How late it is stamped.", number(-10, 10), unit="s")
    position_m: tuple[float, ...] = key(
        (0.0, 0.0), "Where the sensor is: forward and to starboard of the reference point.",
        numbers(("forward", "starboard"), -50, 50), unit="m",
    )  # fmt: skip


#: What a calibration file may say of a channel.
CALIBRATION_KEYS = ("scale", "offset", "unit", "raw", "latency_s")


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """A whole configuration."""

    time: TimeConfig = field(default_factory=TimeConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    gps: GpsConfig = field(default_factory=GpsConfig)
    noise: Noise = field(default_factory=Noise)
    channels: Mapping[str, ChannelConfig] = field(default_factory=dict)
    is_default: bool = True  #: no file named channels: take those that the data has


def default_config() -> VehicleConfig:
    """Every channel in the column of its own name and standard unit, as `simulate` writes them."""
    channels = {name: ChannelConfig(column=(standard_column(name),)) for name in CHANNELS}
    return VehicleConfig(channels=channels)


def standard_column(channel: str) -> str:
    """The column that holds a channel by default, as gps_x_m."""
    unit = CHANNELS[channel][1]
    word = {"m/s": "mps", "m/s2": "mps2", "deg/s": "dps"}.get(unit, unit)
    return f"{channel}_{word}"


def load_config(path: Path | None, calibration: Path | None = None) -> VehicleConfig:
    """The configuration in `path` (None: the default one) with the calibration file laid over it."""
    config = _configured(_toml(path), str(path)) if path else default_config()
    if calibration is None:
        return config
    tables = _toml(calibration)
    channels = dict(config.channels)
    gps = config.gps
    for name, table in tables.items():
        if name == "gps":
            gps = _section(gps, "gps", table, str(calibration), ("latency_s",))
        elif name != "channels":
            raise ConfigError(f"{calibration}: {name} is not a key; there are [channels.NAME] and [gps]")
    for name, table in _subtables(tables, str(calibration)).items():
        if name not in channels:
            there = f"did you mean {nearest_of(name, channels)}?" if channels else "the configuration has none"
            raise ConfigError(f"{calibration}: channels.{name} is not a channel of this drive; {there}")
        channels[name] = _section(channels[name], f"channels.{name}", table, str(calibration), CALIBRATION_KEYS)
    config = dataclasses.replace(config, gps=gps, channels=channels)
    _check(config, str(calibration))
    return config


def _configured(tables: Mapping[str, Any], where: str) -> VehicleConfig:
    sections = ("time", "drive", "gps", "noise", "channels")
    for name in tables:
        if name not in sections:
            raise ConfigError(f"{where}: {name} is not a key; did you mean {nearest_of(name, sections)}?")
    channels = {}
    for name, table in _subtables(tables, where).items():
        if name not in CHANNELS:
            raise ConfigError(
                f"{where}: channels.{name} is not a channel; did you mean {nearest_of(name, CHANNELS)}? "
                f"There are {', '.join(CHANNELS)}"
            )
        channels[name] = _section(ChannelConfig(), f"channels.{name}", table, where)
        if not channels[name].column:
            raise ConfigError(f"{where}: channels.{name} needs its column")
        if len(channels[name].axis) != len(channels[name].column):
            raise ConfigError(
                f"{where}: channels.{name} has {len(channels[name].column)} columns; give axis as many numbers"
            )
    config = VehicleConfig(
        time=_section(TimeConfig(), "time", tables.get("time", {}), where),
        drive=_section(DriveConfig(), "drive", tables.get("drive", {}), where),
        gps=_section(GpsConfig(), "gps", tables.get("gps", {}), where),
        noise=_section(Noise(), "noise", tables.get("noise", {}), where),
        channels=channels or default_config().channels,
        is_default=not channels,
    )
    _check(config, where)
    return config


def _check(config: VehicleConfig, where: str) -> None:
    for name, channel in config.channels.items():
        quantities, standard = CHANNELS[name]
        unit = channel.unit or standard
        if UNITS[unit][0] not in quantities:
            allowed = ", ".join(known for known, (quantity, _) in UNITS.items() if quantity in quantities)
            raise ConfigError(
                f"{where}: channels.{name}.unit = {toml_value(unit)} is no unit of a {quantities[0]}: {allowed}"
            )


def _subtables(tables: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    channels = tables.get("channels", {})
    if not isinstance(channels, Mapping):
        raise ConfigError(f"{where}: channels must be tables, [channels.NAME]")
    return channels


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from error


def _section(section: Section, name: str, table: object, where: str, allowed: tuple[str, ...] = ()) -> Section:
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: {name} must be a table, [{name}]")
    declared = keys_of(section)
    known = allowed or tuple(declared)
    changes = {}
    for key_name, value in table.items():
        if key_name not in known:
            raise ConfigError(f"{where}: {name}.{key_name} is not a key; did you mean {nearest_of(key_name, known)}?")
        try:
            changes[key_name] = declared[key_name].check(value)
        except ValueError as error:
            raise ConfigError(f"{where}: {name}.{key_name} {error}") from error
    return dataclasses.replace(section, **changes)


def config_text() -> str:
    """The default configuration as TOML that documents every key."""
    config = VehicleConfig()
    sections: list[tuple[str, object]] = [("time", config.time), ("drive", config.drive), ("gps", config.gps)]
    sections += [("noise", config.noise), ("channels.NAME", ChannelConfig())]
    lines = []
    for name, section in sections:
        lines.append(f"[{name}]")
        if name.startswith("channels"):
            lines.append(f"# NAME is one of {', '.join(CHANNELS)}.")
        for key_name, declared in keys_of(section).items():
            unit = f" ({declared.unit})" if declared.unit else ""
            value = getattr(section, key_name)
            lines.append(f"# {declared.doc}{unit}")
            lines.append(f"{key_name} = {toml_value(list(value) if isinstance(value, tuple) else value)}")
        lines.append("")
    return "\n".join(lines)
