"""Ten thousand malformed requests leave the web output running, no larger than before."""

from __future__ import annotations

import contextlib
import json
import os
import random
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest
from web_process import WebProcess, client_frame, read_frame

REQUESTS = 10_000
WARM_UP = 4_000  # after which everything that is loaded or grown once has been
GROWTH_KB = (
    1_500  # the allocator's coming and going, and a history that fills; a leak of 150 bytes a request would show
)
SEED = 20261124

METHODS = (b"GET", b"POST", b"PUT", b"HEAD", b"OPTIONS", b"get", b"G\0T", b"", b"A" * 300, b"PRI", b"CONNECT", b"\xff")
PATHS = (
    *(b"/", b"/api/state", b"/api/tasks/gps2/stop", b"/api/login", b"/metrics", b"/api/stream", b"/signalk/v1/stream"),
    *(
        b"",
        b"*",
        b"http://evil.example/",
        b"/%",
        b"/%ff%fe",
        b"/\xff",
        b"/" + b"a" * 5000,
        b"/?" + b"&a=b" * 500,
        b"//",
    ),
)
VERSIONS = (b"HTTP/1.1", b"HTTP/1.0", b"HTTP/2.0", b"HTTP/9.9", b"http/1.1", b"HTTP/1.", b"", b"HTTP/1.1 x")
HEADERS = (
    *(b"Content-Length: -1", b"Content-Length: x", b"Content-Length: 5", b"Content-Length: 99999999999999999999"),
    *(b"Content-Length: 1\r\nContent-Length: 2", b"Transfer-Encoding: chunked", b"Transfer-Encoding: gzip, chunked"),
    *(b"Transfer-Encoding: chunked\r\nContent-Length: 3", b"Content-Encoding: deflate", b"Content-Encoding: br"),
    *(b"Expect: 100-continue", b"Connection: Upgrade", b"Upgrade: websocket", b"Upgrade: h2c"),
    *(b"Sec-WebSocket-Version: 13", b"Sec-WebSocket-Version: 99", b"Sec-WebSocket-Key: x"),
    *(b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", b"Content-Type: application/json", b"Content-Type: \xff"),
    b"Sec-WebSocket-Extensions: permessage-deflate; server_max_window_bits=99",
    *(b"Content-Type: multipart/form-data; boundary=", b"Cookie: tinyekf=\xff\x00; ;=;", b"Cookie: " + b"a=b;" * 500),
    *(b"Authorization: Bearer \xe9", b"Authorization: " + b"A" * 4000, b"Authorization", b": x", b" folded"),
    *(b"X: \x00", b"X:" + b"y" * 9000, b"Origin: null", b"Host: [", b"Host: \xff", b"Accept: " + b"*/*," * 300),
    *(b"Range: bytes=9-1", b'If-None-Match: "'),
)
BODIES = (
    *(b"", b"{", b"[" * 900, b'{"token":"' + b"\\u0000" * 50, b"5\r\nabcde\r\n0\r\n\r\n", b"zz\r\n"),
    *(b"\x00" * 1000, b"a" * 3000),
)


@pytest.fixture(params=[sys.executable, "/usr/bin/python3"], ids=["newest aiohttp", "Debian's aiohttp"])
def web(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[WebProcess]:
    if subprocess.run([request.param, "-c", "import aiohttp"], capture_output=True).returncode:
        why = "no aiohttp for the system's Python: apt install python3-aiohttp"
        pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)
    monkeypatch.setattr(sys, "executable", request.param)
    web = WebProcess()
    yield web
    web.close()


def malformed_request(chance: random.Random, port: int) -> bytes:
    """Something like HTTP, or nothing like it."""
    if chance.random() < 0.1:
        return chance.randbytes(chance.randrange(1, 600))
    headers = [b"Host: 127.0.0.1:%d" % port] * chance.choice((0, 1, 1, 1, 1, 2))
    headers += chance.sample(HEADERS, chance.randrange(0, 6))
    first = b" ".join((chance.choice(METHODS), chance.choice(PATHS), chance.choice(VERSIONS)))
    text = bytearray(b"\r\n".join((first, *headers, b"", b"")) + chance.choice(BODIES))
    for _ in range(chance.choice((0, 0, 1, 3))):
        text[chance.randrange(len(text))] = chance.randrange(256)
    return bytes(text[: chance.randrange(1, len(text))] if chance.random() < 0.2 else text)


def malformed_frame(chance: random.Random) -> bytes:
    """Something like a frame of a WebSocket's client."""
    kind = chance.randrange(8)
    if kind == 0:
        return chance.randbytes(chance.randrange(1, 200))
    if kind == 1:
        return bytes((0x80 | chance.randrange(16), chance.randrange(128))) + chance.randbytes(20)  # not masked
    if kind == 2:
        return b"\x81\xff" + chance.randbytes(8) + chance.randbytes(20)  # a length of anything up to 2^64
    if kind == 3:
        return client_frame(1, b"\xff\xfe\x00")  # not UTF-8
    if kind == 4:
        return client_frame(8, chance.randbytes(chance.randrange(0, 126)))  # a close of any code and reason
    if kind == 5:
        return bytes((0x70 | chance.randrange(16), 0x80)) + bytes(4)  # reserved bits
    if kind == 6:
        return b"\x01\x80" + bytes(4) + client_frame(1, b"a message within a message")
    return client_frame(chance.choice((3, 7, 9, 10, 11, 15, 0)), chance.randbytes(chance.randrange(0, 200)))


def attack(web: WebProcess, chance: random.Random) -> None:
    """One malformed request; whatever it brings about is no matter, as long as it is soon over."""
    with contextlib.suppress(ConnectionResetError, BrokenPipeError):
        if chance.random() < 0.3:
            connection, status = web.upgrade()
            with connection:
                if status == 101:
                    connection.sendall(malformed_frame(chance))
                    if chance.random() < 0.5:
                        connection.recv(100)
            return
        with web.connect() as connection:
            connection.sendall(malformed_request(chance, web.port))
            if chance.random() < 0.7:
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(65536):
                    pass


def test_malformed_requests_leave_it_running_and_no_larger(web: WebProcess, caplog: pytest.LogCaptureFixture) -> None:
    chance = random.Random(SEED)
    pid = web.process.pid
    for _ in range(WARM_UP):
        attack(web, chance)
    web.until_heard()
    before_kb = web.rss_kb()
    for _ in range(REQUESTS):
        attack(web, chance)
    web.until_heard()
    grown_kb = web.rss_kb() - before_kb
    assert web.process.pid == pid
    assert web.process.restarts == 0
    assert caplog.text == ""  # nor do they fill the journal
    assert grown_kb < GROWTH_KB, f"grew by {grown_kb} kB"
    assert all(web.running.values()) or web.running["gps2"] is False  # a request that was well-formed after all
    assert web.get("/api/state").json()["estimate"]["heading_deg"] == 123.4
    watcher, status = web.upgrade()
    with watcher:
        assert status == 101
        assert "hello" in json.loads(read_frame(watcher)[1])
