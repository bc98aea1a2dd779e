"""The rules of the web by themselves: names, origins, sessions, guesses."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tinyekf_py.outputs.web import access
from tinyekf_py.outputs.web.access import Access, Failures, TokenFileError, token_in, token_path

TOKEN = "abcd-efgh-ijkl-mnop-qrst-uvwx"


@pytest.mark.parametrize(
    ("host", "local", "ours"),
    [
        ("127.0.0.1:8080", "127.0.0.1", True),
        ("[::1]:8080", "::1", True),
        ("192.168.7.2", "::ffff:192.168.7.2", True),
        ("192.168.7.2", "192.168.7.2", True),
        ("192.168.7.3", "192.168.7.2", False),
        ("[fe80::1]", "fe80::1%usb0", True),
        ("LocalHost:1", "192.168.7.2", True),
        ("boat.local.", "192.168.7.2", True),
        ("boat.local:80:80", "192.168.7.2", False),
        ("boat.local\n", "192.168.7.2", False),
        ("bo\u0430t.local", "192.168.7.2", False),  # a Cyrillic a
        ("0x7f000001", "127.0.0.1", False),
        ("127.1", "127.0.0.1", False),
        ("", "127.0.0.1", False),
    ],
)
def test_which_hosts_are_ours(host: str, local: str, ours: bool) -> None:
    assert Access(None, ["Boat.Local"]).host_is_ours(host, local) is ours


@pytest.mark.parametrize(
    ("origin", "host", "ours"),
    [
        (None, "boat.local", True),
        ("http://boat.local", "boat.local", True),
        ("http://boat.local:80", "boat.local", True),
        ("https://boat.local", "boat.local:443", True),
        ("http://boat.local", "boat.local:8080", False),
        ("https://boat.local", "boat.local:80", False),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://boat.local/x", "boat.local", False),
        ("http://user@boat.local", "boat.local", False),
        ("ftp://boat.local", "boat.local", False),
    ],
)
def test_which_origins_are_ours(origin: str | None, host: str, ours: bool) -> None:
    assert Access(None).origin_is_ours(origin, host, None) is ours


def test_a_session_ends_with_its_time_and_with_the_token(monkeypatch: pytest.MonkeyPatch) -> None:
    rules = Access(TOKEN)
    session = rules.session()
    assert rules.may_control(None, session, "10.0.0.1")
    assert not Access(TOKEN + "-2222").may_control(None, session, "10.0.0.1")
    monkeypatch.setattr(access, "SESSION_S", -1)
    assert not rules.may_control(None, rules.session(), "10.0.0.1")


@pytest.mark.parametrize(
    "cookie", ["", ".", "1", "99999999999.", "99999999999." + "0" * 64, "\u0663.x", "-1.x", "\ud800.\ud800"]
)
def test_no_forged_session_is_taken(cookie: str) -> None:
    assert not Access(TOKEN).may_control(None, cookie, "10.0.0.1")


def test_guesses_are_counted_by_network(monkeypatch: pytest.MonkeyPatch) -> None:
    failures = Failures()
    for i in range(access.MAX_FAILURES):
        assert failures.wait_s("2001:db8::1") == 0.0
        failures.add(f"2001:db8::{i}")
    assert 0.0 < failures.wait_s("2001:db8::ffff") <= access.FAILURE_WINDOW_S
    assert failures.wait_s("2001:db8:0:1::1") == 0.0
    later = time.monotonic() + access.FAILURE_WINDOW_S + 1.0
    monkeypatch.setattr(time, "monotonic", lambda: later)
    assert failures.wait_s("2001:db8::ffff") == 0.0


def test_counting_guesses_takes_no_more_memory_than_so_much() -> None:
    failures = Failures()
    for i in range(5000):
        failures.add(f"10.0.{i // 250}.{i % 250}")
    assert len(failures._times) <= 256


def test_where_the_token_is_kept() -> None:
    assert token_path("/x", {"STATE_DIRECTORY": "/y"}) == Path("/x")
    assert token_path("", {"STATE_DIRECTORY": "/y:/z", "HOME": "/h"}) == Path("/y/web-token")
    assert token_path("", {"XDG_CONFIG_HOME": "/c", "HOME": "/h"}) == Path("/c/tinyekf/token")
    assert token_path("", {"HOME": "/h"}) == Path("/h/.config/tinyekf/token")


def test_a_token_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "a" / "token"
    token, is_new = token_in(path)
    assert is_new
    assert token_in(path) == (token, False)
    assert [file.name for file in path.parent.iterdir()] == ["token"]


def test_a_short_token_and_no_place_for_one_are_errors_of_one_line(tmp_path: Path) -> None:
    short = tmp_path / "short"
    short.write_text("abc-def\n")
    short.chmod(0o600)
    with pytest.raises(TokenFileError, match="shorter than 16"):
        token_in(short)
    with pytest.raises(TokenFileError, match=r"set outputs\.web\.token_file") as error:
        token_in(short / "token")
    assert "\n" not in str(error.value)
