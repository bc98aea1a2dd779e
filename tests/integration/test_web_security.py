"""Each attack that docs/security.md says is warded off, on the real output process."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from web_process import DEADLINE_S, TASKS, WebProcess, client_frame, read_frame

from tinyekf_py.outputs.web import guard, streams

Start = Callable[..., WebProcess]


@pytest.fixture(scope="module")
def default_web(start_web: Start) -> WebProcess:
    return start_web()


@pytest.fixture
def web(default_web: WebProcess) -> WebProcess:
    """As it is by default: on this machine alone, without a token."""
    default_web.running.update(dict.fromkeys(TASKS, True))
    return default_web


def test_it_listens_on_this_machine_alone_unless_told_otherwise(web: WebProcess) -> None:
    table = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
    listening = [line.split()[1] for line in table.splitlines() if line.split()[3] == "0A"]
    assert [address for address in listening if address.endswith(f":{web.port:04X}")] == [f"0100007F:{web.port:04X}"]


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "localhost.evil.example", "", "10.0.0.1"),
        *("[::1]evil", "127.0.0.1@evil.example", "2130706433", "evil.example, 127.0.0.1"),
    ],
)
def test_a_name_pointed_at_us_is_refused(web: WebProcess, host: str) -> None:
    """DNS rebinding: a stranger's page reaches us under its own name."""
    for method, path in (("GET", "/"), ("GET", "/api/state"), ("POST", "/api/tasks/gps2/stop"), ("GET", "/metrics")):
        reply = web.request(method, path, Host=host.format(port=web.port))
        assert reply.status in (400, 421)
        assert b"estimate" not in reply.body
    connection, status = web.upgrade(Host=host.format(port=web.port) or "evil.example")
    connection.close()
    assert status in (400, 421)
    assert all(web.running.values())


def test_two_host_headers_are_refused(web: WebProcess) -> None:
    answer = web.send(f"GET /api/state HTTP/1.1\r\nHost: 127.0.0.1:{web.port}\r\nHost: evil.example\r\n\r\n".encode())
    assert int(answer.split()[1]) in (400, 421)


@pytest.mark.parametrize(
    "origin",
    [
        *("http://evil.example", "null", "http://127.0.0.1", "http://127.0.0.1:1", "https://127.0.0.1", "file://", "x"),
        *("http://localhost:{port}", "http://127.0.0.1:{port}.evil.example"),
    ],
)
def test_other_sites_can_neither_post_nor_watch(web: WebProcess, origin: str) -> None:
    origin = origin.format(port=web.port)
    assert web.post("/api/tasks/gps2/stop", Origin=origin).status == 403
    connection, status = web.upgrade(Origin=origin)
    connection.close()
    assert status == 403
    assert all(web.running.values())


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_browser_that_says_that_it_is_another_site_is_believed(web: WebProcess, site: str) -> None:
    assert web.post("/api/tasks/gps2/stop", Sec_Fetch_Site=site).status == 403
    assert web.get("/api/state", Sec_Fetch_Site=site, Sec_Fetch_Mode="no-cors").status == 403
    assert web.get("/", Sec_Fetch_Site=site, Sec_Fetch_Mode="navigate").status == 200  # a link to the page


def test_our_own_page_may_post_and_watch(web: WebProcess) -> None:
    ours = f"http://127.0.0.1:{web.port}"
    assert web.post("/api/tasks/gps2/stop", Origin=ours, Sec_Fetch_Site="same-origin").status == 200
    connection, status = web.upgrade(Origin=ours)
    with connection:
        assert status == 101
        assert json.loads(read_frame(connection)[1])["hello"] == {"control": True, "rate_hz": 10.0}


def test_tasks_are_switched_by_post_alone(web: WebProcess) -> None:
    for method in ("GET", "HEAD", "PUT", "DELETE", "OPTIONS", "TRACE"):
        assert web.request(method, "/api/tasks/gps2/stop").status == 405
    assert all(web.running.values())


@pytest.mark.parametrize(
    "path",
    [
        *("/../access.py", "/static/../access.py", "/..%2faccess.py", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd"),
        *("/page.css/..", "/api/tasks/..%2f..%2fx/stop", "/./../../../etc/passwd", "/page.js%00.html"),
        *("/..\\..\\etc\\passwd", "/index.html"),
    ],
)
def test_no_path_leads_to_a_file(web: WebProcess, path: str) -> None:
    reply = web.get(path)
    assert reply.status in (400, 404)
    assert b"root:" not in reply.body
    assert b"import" not in reply.body


@pytest.mark.parametrize(
    "path", ["/", "/page.js", "/page.css", "/api/state", "/metrics", "/healthz", "/nothing", "/api/access"]
)
def test_every_answer_says_that_it_is_only_what_it_is(web: WebProcess, path: str) -> None:
    headers = web.get(path).headers
    policy = dict(part.strip().partition(" ")[::2] for part in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["require-trusted-types-for"] == "'script'"
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "access-control-allow-origin" not in headers
    assert "aiohttp" not in headers.get("server", "").lower()


def test_the_page_has_nothing_inline_and_nothing_from_elsewhere(web: WebProcess) -> None:
    page = web.get("/").body.decode()
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\son\w+=|\sstyle=|javascript:", page)
    for name in ("page.js", "tiles.js", "rose.js", "charts.js", "words.js", "sound.js", "page.css"):
        text = web.get(f"/{name}").body.decode()
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function", text)
        assert not re.search(
            r"(https?:)?//(?!www\.w3\.org/2000/svg)[\w.]+\.\w", re.sub(r"^\s*//.*$", "", text, flags=re.M)
        )


def test_large_requests_are_refused(web: WebProcess) -> None:
    host = f"Host: 127.0.0.1:{web.port}\r\n"
    login = f"POST /api/login HTTP/1.1\r\n{host}Content-Type: application/json\r\n"
    chunk = "400\r\n" + "a" * 1024 + "\r\n"
    too_much = [
        f"GET /{'a' * 9000} HTTP/1.1\r\n{host}\r\n",
        f"GET / HTTP/1.1\r\n{host}X: {'a' * 9000}\r\n\r\n",
        f"GET / HTTP/1.1\r\n{host}" + "Y: b\r\n" * 4000,
        f"{login}Content-Length: 9000\r\n\r\n" + "a" * 9000,
        f"{login}Content-Length: 99999999\r\n\r\n" + "a" * 99999,
        f"{login}Transfer-Encoding: chunked\r\n\r\n" + 99 * chunk,
    ]
    for request in too_much:
        answer = web.send(request.encode())
        assert not answer or int(answer.split()[1]) in (400, 413, 414, 431)
    assert web.get("/healthz").status == 200


def test_one_connection_carries_one_request(web: WebProcess) -> None:
    one = f"POST /api/tasks/gps2/stop HTTP/1.1\r\nHost: 127.0.0.1:{web.port}\r\nContent-Length: 0\r\n\r\n"
    answer = web.send((one + one.replace("gps2", "gps1")).encode())
    assert answer.count(b"HTTP/1.1 ") == 1
    assert web.running["gps1"]


def test_connections_are_capped(web: WebProcess) -> None:
    connections = []
    try:
        for _ in range(guard.MAX_OF_ONE_ADDRESS + 8):
            connections.append(web.connect())
        refused = 0
        for connection in connections[-8:]:
            refused += connection.recv(100).startswith(b"HTTP/1.1 503")
        assert refused == 8
    finally:
        for connection in connections:
            connection.close()
    web.until_heard()
    assert web.get("/healthz").status in (200, 503)


def test_a_connection_that_says_little_is_ended(web: WebProcess) -> None:
    """Slow headers hold nothing; neither does saying nothing."""
    began = time.monotonic()
    with web.connect() as silent, web.connect() as slow:
        slow.sendall(b"GET / HTTP/1.1\r\nHost: 127")
        for connection in (silent, slow):
            connection.settimeout(guard.REQUEST_PATIENCE_S + 15)
            with contextlib.suppress(ConnectionResetError):
                assert connection.recv(100) == b""
    assert time.monotonic() - began >= guard.REQUEST_PATIENCE_S - 1


def opcodes_until_the_end(connection: socket.socket, flood: bytes = b"") -> set[int]:
    """Which frames a watcher is sent after `flood`, until the server hangs up."""
    seen = set()
    connection.settimeout(3 * streams.PING_PERIOD_S)
    with connection, contextlib.suppress(ConnectionResetError, BrokenPipeError):
        connection.sendall(flood)
        while True:
            seen.add(read_frame(connection)[0])
    return seen


def test_a_watcher_that_does_not_answer_pings_is_ended(web: WebProcess) -> None:
    connection, status = web.upgrade()
    assert status == 101
    assert 9 in opcodes_until_the_end(connection)  # a ping


@pytest.mark.parametrize("flood", [(1, 200, 1000), (9, 0, 20000), (1, 9000, 1)], ids=["texts", "pings", "long text"])
def test_a_watcher_that_says_too_much_is_ended(web: WebProcess, flood: tuple[int, int, int]) -> None:
    opcode, size, times = flood
    connection, status = web.upgrade()
    assert status == 101
    assert 9 not in opcodes_until_the_end(connection, client_frame(opcode, b"x" * size) * times)  # at once, unpinged
    assert web.get("/healthz").status == 200


def test_a_watcher_that_stops_reading_costs_the_others_nothing(web: WebProcess) -> None:
    slow = [web.upgrade()[0] for _ in range(4)]
    for connection in slow:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    quick, _ = web.upgrade()
    times: list[float] = []
    with quick:
        while len(times) < 60:
            message = json.loads(read_frame(quick)[1])
            if "state" in message:
                times.append(message["state"]["elapsed_s"])
    assert all(earlier < later for earlier, later in pairwise(times))
    assert max(later - earlier for earlier, later in pairwise(times[1:])) < 1.0  # of the boat's time
    for connection in slow:
        connection.close()


def test_simulated_deltas_do_not_leave_this_machine(start_web: Start, token_file: Path) -> None:
    """Signal K has no mark for a simulated heading."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing; says which of our addresses would
        elsewhere = probe.getsockname()[0]
    for allowed, address, comes in ((False, "127.0.0.1", True), (False, elsewhere, False), (True, elsewhere, True)):
        web = start_web(host="0.0.0.0", token_file=str(token_file), allow_simulated=allowed)
        web.simulated, web.address = True, address
        connection, status = web.upgrade("/signalk/v1/stream", Authorization=f"Bearer {token_file.read_text().strip()}")
        assert status == 101
        page, _ = web.upgrade()  # the page has a mark, and tells how much time has gone
        with connection, page:
            for _ in range(8):
                read_frame(page)
            assert "self" in json.loads(read_frame(connection)[1])
            connection.settimeout(DEADLINE_S if comes else 0.01)
            if comes:
                assert "updates" in json.loads(read_frame(connection)[1])
            else:
                with pytest.raises(TimeoutError):
                    read_frame(connection)


def test_what_a_task_is_called_cannot_be_anything(web: WebProcess) -> None:
    assert web.post("/api/tasks/gps9/stop").status == 404
    for name in ("GPS2", "gps2%20", "gps2;stop", "%0astop", "a" * 17, "", "gps2/stop"):
        assert web.post(f"/api/tasks/{name}/stop").status == 404
    assert web.post("/api/tasks/gps2/restart").status == 404
    assert dict.fromkeys(TASKS, True) == web.running
