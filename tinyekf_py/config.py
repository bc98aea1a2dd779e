"""The configuration: a TOML file laid over defaults that suit the reference boat.

`load_config` reads a file, `config_text` writes one that documents every key, `result_config` gives the keys that
shape the result for a recording's `#config` lines, and `apply_flat` lays such lines (or a command line's options) over
a configuration. Whatever is unknown or not allowed is a `ConfigError` of one line.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from acquisition.decoder import DecoderConfigError, make_decoder
from acquisition.sample import MAX_GPS, SOURCES
from acquisition.toml_value import toml_value
from tinyekf_py.config_key import (
    ConfigError,
    boolean,
    integer,
    key,
    keys_of,
    nearest_of,
    number,
    places,
    table,
    tables_of,
    text,
    words,
)
from tinyekf_py.fusion_config import METHODS, PAPER_METHODS, PAPER_Q, PAPER_R, FusionConfig
from tinyekf_py.outputs.settings import (
    NmeaConfig,
    NmeaSerialConfig,
    NmeaTcpConfig,
    NmeaUdpConfig,
    SignalKConfig,
    WebConfig,
)
from tinyekf_py.sensor_config import SensorConfig, default_sensor
from tinyekf_py.tasks import task_names

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = [
    "METHODS",
    "PAPER_METHODS",
    "PAPER_Q",
    "PAPER_R",
    "Config",
    "ConfigError",
    "apply_flat",
    "config_text",
    "load_config",
    "result_config",
]

TASKS = task_names(tuple(SOURCES), MAX_GPS)
Section = TypeVar("Section", bound="DataclassInstance")

DEFAULT_GPS = ("gps1", "gps2", "gps3")


@dataclass(frozen=True, slots=True, kw_only=True)
class VesselConfig:
    """The boat."""

    variation_deg: float | str = key(
        "auto",
        "Magnetic variation; auto takes it from the World Magnetic Model, else from the GPS or the compass.",
        number(-180, 180, or_word="auto"),
        unit="degrees, east positive",
        shapes_result=True,
    )
    antennas_m: tuple[tuple[float, ...], ...] = key(
        (),
        "GPS antennas: [ahead, to starboard] of gps1, of gps2, ..., from the reference point; for method adaptive.",
        places(MAX_GPS, 200),
        unit="m",
        shapes_result=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TasksConfig:
    """The tasks, each of which can be started and stopped while the program runs (docs/tasks.md)."""

    stopped: tuple[str, ...] = key((), "Tasks that are stopped when the program starts, or all.", words(*TASKS, "all"))


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputsConfig:
    """What a live run gives; an old heading CSV is replaced, an old recording set aside."""

    csv: str = key("", "The heading CSV, ten rows a second; empty for none.", text)
    recording: str = key("", "The recording of every line received, for replays; empty for none.", text)
    allow_simulated: bool = key(
        False,
        "Whether simulated and replayed data, which some sentences cannot mark, may leave this machine.",
        boolean,
    )
    nmea: NmeaConfig = table(NmeaConfig())
    nmea_tcp: NmeaTcpConfig = table(NmeaTcpConfig())
    nmea_udp: NmeaUdpConfig = table(NmeaUdpConfig())
    nmea_serial: NmeaSerialConfig = table(NmeaSerialConfig())
    signalk: SignalKConfig = table(SignalKConfig())
    web: WebConfig = table(WebConfig())


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingConfig:
    """How a recording is cut into pieces, REC, REC.0001 and so on; a replay is given all of them."""

    max_mb: float = key(0.0, "Size at which a piece ends; 0 for no limit.", number(0, 1e6), unit="MB (1,000,000 bytes)")
    max_hours: float = key(0.0, "Age at which a piece ends; 0 for no limit.", number(0, 1e5), unit="hours")
    keep: int = key(0, "Pieces kept, the oldest being removed; 0 keeps all.", integer(0, 1_000_000))


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """All of it. `sensors` has the three default receivers, the compass and the IMU, and what a file added."""

    vessel: VesselConfig = VesselConfig()
    sensors: Mapping[str, SensorConfig] = field(
        default_factory=lambda: {name: default_sensor(name) for name in (*DEFAULT_GPS, "compass", "imu")}
    )
    fusion: FusionConfig = field(default=FusionConfig())
    tasks: TasksConfig = TasksConfig()
    outputs: OutputsConfig = OutputsConfig()
    recording: RecordingConfig = RecordingConfig()

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the enabled sensors, GPS first, in the order of their numbers."""
        return tuple(name for name in SOURCES if name in self.sensors and self.sensors[name].enabled)

    @property
    def n_gps(self) -> int:
        """The highest number of an enabled GPS; 0 without one."""
        return max((SOURCES[name] + 1 for name in self.sources if name.startswith("gps")), default=0)

    def decoder_options(self, name: str) -> dict[str, object]:
        """The options with which `acquisition.decoder.make_decoder` makes the decoder of sensor `name`."""
        sensor = self.sensors[name]
        return {option: getattr(sensor, option) for option in sensor.decoder_options}


def load_config(path: str | Path) -> Config:
    """The configuration in the TOML file `path`, laid over the defaults."""
    try:
        with open(path, "rb") as file:
            tables = tomllib.load(file)
    except OSError as error:
        raise ConfigError(f"cannot read configuration {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not TOML: it is not UTF-8 text") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from error
    return _lay_over(Config(), tables, str(path))


def apply_flat(config: Config, flat: Mapping[str, object], where: str) -> Config:
    """`config` with the dotted keys of `flat` in place of its own; `where` names their origin in errors."""
    tables: dict[str, Any] = {}
    for dotted, value in flat.items():
        *sections, name = dotted.split(".")
        values = tables
        for section in sections:
            values = values.setdefault(section, {})
            if not isinstance(values, dict):
                raise ConfigError(f"{where}: {dotted} is not a key")
        values[name] = value
    return _lay_over(config, tables, where)


def flat_config(config: Config) -> dict[str, object]:
    """Every key and its value, dotted: what `apply_flat` takes."""
    return {dotted: value for dotted, value, _ in _entries(config)}


def result_config(config: Config) -> dict[str, object]:
    """The dotted keys that shape the result, for a recording: method, vessel, which sensors, how they are read."""
    absent = tuple(f"sensors.{name}." for name, sensor in config.sensors.items() if not sensor.enabled)
    return {
        dotted: value
        for dotted, value, shapes_result in _entries(config)
        if shapes_result and (not dotted.startswith(absent) or dotted.endswith(".enabled"))
    }


def _entries(config: Config) -> Iterator[tuple[str, object, bool]]:
    for name, section in _sections(config):
        for key_name, declared in keys_of(section).items():
            yield f"{name}.{key_name}", getattr(section, key_name), declared.shapes_result


def _sections(config: Config) -> Iterator[tuple[str, object]]:
    yield "vessel", config.vessel
    for name in SOURCES:
        if name in config.sensors:
            yield f"sensors.{name}", config.sensors[name]
    for name in ("fusion", "tasks", "outputs", "recording"):
        section = getattr(config, name)
        yield name, section
        for inner, field_name in tables_of(section).items():
            yield f"{name}.{inner}", getattr(section, field_name)


def _lay_over(config: Config, tables: Mapping[str, Any], where: str) -> Config:
    for name in tables:
        if name not in ("vessel", "sensors", "fusion", "tasks", "outputs", "recording"):
            raise _unknown(name, where, ["vessel", "sensors", "fusion", "tasks", "outputs", "recording"])
    sensors = dict(config.sensors)
    for name, values in _table(tables, "sensors", where).items():
        if name not in SOURCES:
            raise _unknown(f"sensors.{name}", where, [f"sensors.{source}" for source in SOURCES])
        sensors[name] = _section(sensors.get(name) or default_sensor(name), f"sensors.{name}", values, where)
    changed = Config(
        vessel=_section(config.vessel, "vessel", tables.get("vessel", {}), where),
        sensors=sensors,
        fusion=_section(config.fusion, "fusion", tables.get("fusion", {}), where),
        tasks=_section(config.tasks, "tasks", tables.get("tasks", {}), where),
        outputs=_section(config.outputs, "outputs", tables.get("outputs", {}), where),
        recording=_section(config.recording, "recording", tables.get("recording", {}), where),
    )
    _check_whole(changed, where)
    return changed


def _table(tables: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any]:
    values = tables.get(name, {})
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: {name} must be a table, [{name}], not {_shown(values)}")
    return values


def _section(section: Section, name: str, values: object, where: str) -> Section:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: {name} must be a table, [{name}], not {_shown(values)}")
    declared, inner = keys_of(section), tables_of(section)
    changes: dict[str, Any] = {}
    for key_name, value in values.items():
        if key_name in inner:
            changes[inner[key_name]] = _section(getattr(section, inner[key_name]), f"{name}.{key_name}", value, where)
            continue
        if key_name not in declared:
            raise _unknown(f"{name}.{key_name}", where, [f"{name}.{known}" for known in (*declared, *inner)])
        try:
            changes[key_name] = declared[key_name].check(value)
        except ValueError as error:
            raise ConfigError(f"{where}: {name}.{key_name} = {_shown(value)} {error}") from error
    return dataclasses.replace(section, **changes)


def _check_whole(config: Config, where: str) -> None:
    """What no key can tell alone."""
    for name in config.sources:
        try:
            make_decoder(name, config.sensors[name].driver, config.decoder_options(name))
        except DecoderConfigError as error:
            raise ConfigError(f"{where}: sensors.{error}") from error
    tasks = task_names(config.sources, config.n_gps)
    for name in config.tasks.stopped:
        if name not in (*tasks, "all"):
            raise ConfigError(f"{where}: tasks.stopped names {name}, which this boat does not have: {', '.join(tasks)}")
    signalk = config.outputs.signalk
    if signalk.enabled and not signalk.port and not signalk.udp_host:
        raise ConfigError(
            f"{where}: outputs.signalk.port = 0 serves nobody without udp_host; give a port from 1 to 65535"
        )
    chosen = f"gps{config.fusion.cnw_ekf.gps}"
    if config.fusion.method == "cnw-ekf" and config.n_gps and chosen not in config.sources:
        present = ", ".join(name.removeprefix("gps") for name in config.sources if name.startswith("gps"))
        raise ConfigError(
            f"{where}: fusion.cnw-ekf.gps = {config.fusion.cnw_ekf.gps} is not an enabled receiver; there is {present}"
        )


def _unknown(dotted: str, where: str, here: list[str]) -> ConfigError:
    everywhere = [*flat_config(Config()), *here]
    elsewhere = [known for known in everywhere if known.rpartition(".")[2] == dotted.rpartition(".")[2]]
    close_here = get_close_matches(dotted.rpartition(".")[2], [known.rpartition(".")[2] for known in here], 1, 0.6)
    nearest = nearest_of(dotted, elsewhere if elsewhere and not close_here else here)
    return ConfigError(f"{where}: {dotted} is not a key; did you mean {nearest}?")


def _shown(value: object) -> str:
    try:
        return toml_value(value)
    except TypeError:  # a table or a date where neither can stand
        return "a table" if isinstance(value, Mapping) else str(value)


def config_text(config: Config | None = None) -> str:
    """A complete TOML file that says what `config` (the defaults without one) says and documents every key."""
    config = config or Config()
    defaults = Config()
    lines = [
        "# Configuration of tinyekf. Every key is optional: what is left out has the default given here.",
        "# Sensors are gps1 to gps8, compass and imu; a table [sensors.gps4] adds a fourth receiver.",
    ]
    documented: set[type] = set()
    for name, section in _sections(config):
        lines += ["", f"[{name}]"]
        repeated = type(section) in documented
        documented.add(type(section))
        lines.append("# The keys are those of the first receiver." if repeated else f"# {_first_line(section)}")
        default = _default_section(name, defaults)
        for key_name, declared in keys_of(section).items():
            if not repeated:
                unit = f"Unit: {declared.unit}. " if declared.unit else ""
                lines += [f"# {declared.doc}", f"# {unit}Default: {toml_value(getattr(default, key_name))}"]
            lines.append(f"{key_name} = {toml_value(getattr(section, key_name))}")
    return "\n".join(lines) + "\n"


def _first_line(section: object) -> str:
    return (type(section).__doc__ or "").partition("\n")[0]


def _default_section(name: str, defaults: Config) -> object:
    known = dict(_sections(defaults))
    return known[name] if name in known else default_sensor(name.removeprefix("sensors."))
