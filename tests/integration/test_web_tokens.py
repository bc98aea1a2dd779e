"""Who has the token and who has not: what each may do, on the real output process."""

from __future__ import annotations

import json
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from web_process import WebProcess, read_frame

from tinyekf_py.outputs.web.access import TokenFileError, token_in

Start = Callable[..., WebProcess]


@pytest.fixture
def open_web(start_web: Start, token_file: Path) -> WebProcess:
    """On every address of the machine."""
    return start_web(host="0.0.0.0", token_file=str(token_file))


def token_of(path: Path) -> str:
    return path.read_text().strip()


def test_on_this_machine_alone_no_token_is_made_nor_needed(start_web: Start, token_file: Path) -> None:
    web = start_web(token_file=str(token_file))
    assert web.post("/api/tasks/gps2/stop").json()["tasks"]["gps2"] is False
    assert web.get("/api/access").json() == {"read": True, "control": True}
    assert not token_file.exists()


@pytest.mark.parametrize("headers", [{}, {"Authorization": "Bearer no"}, {"Cookie": "tinyekf=99999999999.0"}])
def test_on_other_addresses_control_needs_the_token(open_web: WebProcess, headers: dict[str, str]) -> None:
    for path in ("/api/tasks/gps2/stop", "/api/tasks/all/stop"):
        assert open_web.post(path, **headers).status == 401
    assert all(open_web.running.values())
    assert open_web.get("/api/state").status == 200
    assert open_web.get("/api/access").json() == {"read": True, "control": False}
    connection, status = open_web.upgrade("/signalk/v1/stream", **headers)
    connection.close()
    assert status == 401


def test_the_token_gives_control(open_web: WebProcess, token_file: Path) -> None:
    token = token_of(token_file)
    for kind in ("Bearer", "bearer"):
        assert open_web.post("/api/tasks/gps2/stop", Authorization=f"{kind} {token}").status == 200
    assert (
        open_web.post("/api/tasks/gps2/start", Authorization=f"Bearer {token.replace('-', '').upper()}").status == 200
    )
    connection, status = open_web.upgrade("/signalk/v1/stream", Authorization=f"JWT {token}")
    with connection:
        assert status == 101
        assert json.loads(read_frame(connection)[1])["name"] == "tinyekf"


def test_the_token_is_its_owners_alone_and_stays(
    start_web: Start, token_file: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    start_web(host="0.0.0.0", token_file=str(token_file))
    token = token_of(token_file)
    assert capfd.readouterr().err.count(token) == 1
    assert stat.S_IMODE(token_file.stat().st_mode) == 0o600
    assert stat.S_IMODE(token_file.parent.stat().st_mode) == 0o700
    assert len(token.replace("-", "")) * 5 >= 120  # bits
    start_web(host="0.0.0.0", token_file=str(token_file))
    assert token_of(token_file) == token
    assert token not in capfd.readouterr().err
    assert token not in caplog.text  # whose lines are shown to everybody who may read


def test_a_session_is_a_cookie_that_neither_scripts_nor_other_sites_can_use(
    open_web: WebProcess, token_file: Path
) -> None:
    body = json.dumps({"token": token_of(token_file)}).encode()
    reply = open_web.post("/api/login", body, Content_Type="application/json")
    assert reply.status == 200
    cookie = reply.headers["set-cookie"]
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
    assert token_of(token_file) not in cookie
    pair = cookie.partition(";")[0]
    assert open_web.post("/api/tasks/gps2/stop", Cookie=pair).status == 200
    expiry, _, signature = pair.partition("=")[2].partition(".")
    for forged in (f"{int(expiry) + 1}.{signature}", f"{expiry}.{'0' * 64}", f"{expiry}.", signature, "٣.x"):
        assert open_web.post("/api/tasks/gps2/stop", Cookie=f"tinyekf={forged}").status in (400, 401)


def test_a_login_takes_json_alone(open_web: WebProcess, token_file: Path) -> None:
    body = json.dumps({"token": token_of(token_file)}).encode()
    for kind in ("text/plain", "application/x-www-form-urlencoded"):  # what another site's form can send
        assert open_web.post("/api/login", body, Content_Type=kind).status == 415
    for wrong in (b"{", b"[]", b"\xff", b'{"token": 1}', b"[" * 1000):
        assert open_web.post("/api/login", wrong, Content_Type="application/json").status == 400


def test_a_wrong_token_is_called_wrong_however_near_it_was(open_web: WebProcess, token_file: Path) -> None:
    token = token_of(token_file)
    for wrong in (token[:-1], "1" + token[1:], ""):
        body = json.dumps({"token": wrong}).encode()
        reply = open_web.post("/api/login", body, Content_Type="application/json")
        assert (reply.status, reply.json()) == (401, {"error": "the token is wrong"})
        assert "set-cookie" not in reply.headers


def test_whoever_guesses_has_to_wait_and_others_do_not(open_web: WebProcess, token_file: Path) -> None:
    body = json.dumps({"token": token_of(token_file)}).encode()
    session = open_web.post("/api/login", body, Content_Type="application/json").headers["set-cookie"]
    statuses = [open_web.post("/api/tasks/gps2/stop", Authorization=f"Bearer wrong{i}").status for i in range(7)]
    assert statuses[:4] == [401] * 4
    assert statuses[5:] == [429] * 2
    reply = open_web.post("/api/login", body, Content_Type="application/json")
    assert reply.status == 429  # nor is a right guess told from a wrong one now
    assert 0 < int(reply.headers["retry-after"]) <= 61
    assert open_web.post("/api/tasks/gps2/stop", Cookie=session.partition(";")[0]).status == 200


def test_reading_can_be_made_to_need_the_token(start_web: Start, token_file: Path) -> None:
    web = start_web(read_token=True, token_file=str(token_file))
    for path in ("/api/state", "/api/history", "/metrics", "/healthz"):
        assert web.get(path).status == 401
        assert web.get(path, Authorization=f"Bearer {token_of(token_file)}").status == 200
    connection, status = web.upgrade()
    connection.close()
    assert status == 401
    assert web.get("/").status == 200  # the page, which asks for the token
    assert web.get("/api/access").json() == {"read": False, "control": False}


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o606])
def test_a_token_that_others_can_read_is_not_used(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "token"
    path.write_text("abcd-efgh-ijkl-mnop-qrst\n")
    path.chmod(mode)
    with pytest.raises(TokenFileError, match=r"can be read by others; chmod 600"):
        token_in(path)


def test_configured_names_are_answered_and_then_control_needs_the_token(start_web: Start, token_file: Path) -> None:
    web = start_web(names=["Boat.local"], token_file=str(token_file))
    for host in ("boat.local", "BOAT.local:1", "boat.local.", "localhost", "127.0.0.1"):
        assert web.get("/api/state", Host=host).status == 200
    assert web.get("/api/state", Host="ship.local").status == 421
    assert web.post("/api/tasks/gps2/stop", Host="boat.local").status == 401
