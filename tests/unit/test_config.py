"""The configuration: its documentation is a valid file, and every mistake is one line naming the key."""

from __future__ import annotations

import tomllib
from datetime import UTC, datetime
from pathlib import Path

import pytest

from acquisition.decoder import make_decoder
from acquisition.recording import read_recording
from acquisition.recording_writer import RecordingWriter
from tinyekf_py.config import (
    METHODS,
    Config,
    ConfigError,
    apply_flat,
    config_text,
    flat_config,
    load_config,
    result_config,
)
from tinyekf_py.config_key import keys_of


def load(tmp_path: Path, content: str) -> Config:
    path = tmp_path / "boat.toml"
    path.write_text(content)
    return load_config(path)


CHANGED = """
[vessel]
variation_deg = -8
[sensors.gps2]
enabled = false
[sensors.gps4]
port = "socket://10.0.0.4:2000"
checksum = false
[sensors.compass]
deviation = [1, 2.5, -1, 0, 0.25]
[sensors.imu]
driver = "ebimu-hex"
mount = [180, 0, 90]
accel = "specific-force"
groups = "gyro,accel,mag"
[fusion]
method = "cnw-ekf"
max_sigma_deg = 10
[fusion.cnw-ekf]
gps = 4
[outputs]
csv = "heading.csv"
recording = "boat.log"
"""


def test_the_default_boat_has_five_sensors() -> None:
    config = Config()
    assert config.sources == ("gps1", "gps2", "gps3", "compass", "imu")
    assert [config.sensors[name].port for name in config.sources] == [
        "/dev/fjGPS1", "/dev/fjGPS2", "/dev/fjGPS3", "/dev/fjEC", "/dev/fjIMU",
    ]  # fmt: skip
    assert config.fusion.method == "adaptive"
    assert config.vessel.variation_deg == "auto"


def test_the_printed_configuration_is_the_default_one(tmp_path: Path) -> None:
    assert load(tmp_path, config_text()) == Config()


def test_a_printed_configuration_reads_back_as_itself(tmp_path: Path) -> None:
    config = load(tmp_path, CHANGED)
    assert load(tmp_path, config_text(config)) == config


def test_every_key_is_printed_with_its_sentence_unit_and_default() -> None:
    text = config_text()
    tables = tomllib.loads(text)
    assert set(tables) == {"vessel", "sensors", "fusion", "tasks", "outputs", "recording"}
    for section in (Config().vessel, Config().fusion, Config().fusion.cnw_ekf, *Config().sensors.values()):
        for name, declared in keys_of(section).items():
            assert f"# {declared.doc}\n# {f'Unit: {declared.unit}. ' if declared.unit else ''}Default: " in text
            assert f"\n{name} = " in text
            assert declared.doc.endswith(".")
    assert max(map(len, text.splitlines())) <= 120


def test_a_file_is_laid_over_the_defaults(tmp_path: Path) -> None:
    config = load(tmp_path, CHANGED)
    assert config.sources == ("gps1", "gps3", "gps4", "compass", "imu")
    assert config.n_gps == 4
    assert config.vessel.variation_deg == -8.0
    assert config.sensors["gps3"] == Config().sensors["gps3"]
    assert config.sensors["gps4"].baud == 9600
    assert config.decoder_options("gps4") == {"checksum": False}
    assert config.decoder_options("imu") == {"groups": "gyro,accel,mag"}
    assert config.fusion.cnw_ekf.gps == 4


def test_an_empty_file_is_the_defaults(tmp_path: Path) -> None:
    assert load(tmp_path, "") == Config()


def test_every_sensor_gets_its_decoder() -> None:
    config = Config()
    for name in config.sources:
        make_decoder(name, config.sensors[name].driver, config.decoder_options(name))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[fusion]\nmetod = 'cnw3'", "fusion.metod is not a key; did you mean fusion.method?"),
        ("method = 'cnw3'", "method is not a key; did you mean fusion.method?"),
        ("[fusoin]\nmethod = 'cnw3'", "fusoin is not a key; did you mean fusion?"),
        ("[vessel]\nmethod = 'cnw3'", "vessel.method is not a key; did you mean fusion.method?"),
        ("[sensors.gsp1]\nport = 'x'", "sensors.gsp1 is not a key; did you mean sensors.gps1?"),
        ("[sensors.gps9]\nport = 'x'", "sensors.gps9 is not a key; did you mean sensors.gps"),
        ("[sensors.gps1]\nbaudrate = 1", "sensors.gps1.baudrate is not a key; did you mean sensors.gps1.baud?"),
        ("[sensors.gps1]\nmount = [0,0,0]", "sensors.gps1.mount is not a key; did you mean sensors.imu.mount?"),
        ("[fusion.cnw-ekf]\ngsp = 1", "fusion.cnw-ekf.gsp is not a key; did you mean fusion.cnw-ekf.gps?"),
        ("[fusion]\nmethod = 'cnw4'", 'fusion.method = "cnw4" does not exist; did you mean "cnw3"?'),
        ("[fusion]\nmethod = 3", "fusion.method = 3 must be one of"),
        ("[fusion]\nmax_sigma_deg = -3", "fusion.max_sigma_deg = -3 must be a number from 0.1 to 180"),
        ("[fusion]\nmax_sigma_deg = nan", "fusion.max_sigma_deg = nan must be a number"),
        ("[fusion]\nmax_sigma_deg = true", "fusion.max_sigma_deg = true must be a number"),
        ("[fusion]\nmax_sigma_deg = 1" + "0" * 400, "must be a number"),
        ("[vessel]\nvariation_deg = 'east'", 'variation_deg = "east" must be a number from -180 to 180 or "auto"'),
        ("[vessel]\nvariation_deg = 200", "variation_deg = 200 must be a number"),
        ("[sensors.gps1]\nenabled = 1", "sensors.gps1.enabled = 1 must be true or false"),
        ("[sensors.gps1]\nbaud = 9600.0", "sensors.gps1.baud = 9600.0 must be a whole number"),
        ("[sensors.gps1]\nbaud = 0", "sensors.gps1.baud = 0 must be a whole number"),
        ("[sensors.gps1]\nport = ''", 'sensors.gps1.port = "" must be a text in quotes, and not empty'),
        ("[sensors.gps1]\nport = 1979-05-27", "sensors.gps1.port = 1979-05-27 must be"),
        ("[sensors.imu]\ndriver = 'ebimu'", 'sensors.imu.driver = "ebimu" does not exist; did you mean "ebimu-'),
        ("[sensors.imu]\nmount = [0, 0]", "sensors.imu.mount = [0, 0] must be 3 numbers [roll, pitch, yaw]"),
        ("[sensors.imu]\nmount = [0, 0, 'a']", "sensors.imu.mount"),
        ("[sensors.imu]\ngroups = 'gyro,acel'", "sensors.imu"),
        ("[sensors.compass]\ndeviation = 3", "sensors.compass.deviation = 3 must be 5 numbers [A, B, C, D, E]"),
        ("sensors = 3", "sensors must be a table"),
        ("sensors.gps1 = 3", "sensors.gps1 must be a table"),
        ("fusion.cnw-ekf = 3", "fusion.cnw-ekf must be a table"),
        ("fusion.method = {a = 1}", "fusion.method = a table must be one of"),
        ('[outputs]\ncsv = "a\\u0000"', "must not hold a NUL"),
        ('[sensors.gps1]\nport = "a\\u0000"', "must not hold a NUL"),
        ("[outputs]\ncsv = 3", "outputs.csv = 3 must be a text"),
        ("[fusion]\nmethod='cnw-ekf'\n[fusion.cnw-ekf]\ngps = 5", "fusion.cnw-ekf.gps = 5 is not an enabled receiver"),
        ("[fusion\n", "is not TOML"),
        ("a = 1\na = 2\n", "is not TOML"),
        ("a = " + "[" * 5000, "is not TOML"),
    ],
)
def test_a_mistake_is_one_line_naming_file_and_key(tmp_path: Path, content: str, says: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        load(tmp_path, content)
    assert says in str(refusal.value)
    assert "boat.toml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"missing\.toml: No such file"):
        load_config(tmp_path / "missing.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_config(tmp_path / "binary.toml")


def test_the_result_of_a_recording_is_shaped_by_its_configuration(tmp_path: Path) -> None:
    config = load(tmp_path, CHANGED)
    RecordingWriter(tmp_path / "r.log", datetime(2026, 1, 1, tzinfo=UTC), result_config(config)).close()
    replayed = apply_flat(Config(), read_recording(tmp_path / "r.log").config, "r.log")
    assert result_config(replayed) == result_config(config)
    assert replayed.sources == config.sources
    assert replayed.outputs == Config().outputs
    assert replayed.sensors["gps4"].port == "/dev/fjGPS4"


def test_every_key_can_be_given_flat(tmp_path: Path) -> None:
    config = load(tmp_path, CHANGED)
    assert apply_flat(Config(), flat_config(config), "flat") == config


@pytest.mark.parametrize("method", METHODS)
def test_a_command_line_changes_one_key(method: str) -> None:
    assert apply_flat(Config(), {"fusion.method": method}, "--method").fusion.method == method


@pytest.mark.parametrize(
    ("flat", "says"),
    [
        ({"fusion.method": "adaptve"}, "--method: fusion.method"),
        ({"fusion": 1}, "--method: fusion must be a table"),
        ({"fusion.method": "cnw3", "fusion.method.x": 1}, "--method: fusion.method.x is not a key"),
        ({"": 1}, "--method:  is not a key"),
    ],
)
def test_a_flat_mistake_names_its_origin(flat: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        apply_flat(Config(), flat, "--method")
    assert says in str(refusal.value)
