"""The live program as a service: systemd's notifications, and a log that nobody reads."""

from __future__ import annotations

import logging
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from live_boat import DEADLINE_S, ROOT, Boat, Program

from tinyekf_py.program_log import BURST, BackgroundLog, JournalFormatter, RepeatFilter


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[Boat]:
    boat = Boat(tmp_path)
    yield boat
    boat.close()


def test_systemd_is_told_ready_fed_only_while_the_loop_turns_and_told_the_end(tmp_path: Path, boat: Boat) -> None:
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(str(tmp_path / "notify"))
    manager.settimeout(DEADLINE_S)
    live = Program(tmp_path, boat, env={"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "600000"})
    try:
        assert manager.recv(4096) == b"READY=1"
        assert manager.recv(4096).startswith(b"WATCHDOG=1\nSTATUS=")
        assert manager.recv(4096).startswith(b"WATCHDOG=1\nSTATUS=")
        live.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, live.process.pid, os.WSTOPPED | os.WNOWAIT)
        while select.select([manager], [], [], 0)[0]:
            manager.recv(4096)
        assert select.select([manager], [], [], 1.0)[0] == []  # five times its period: a hanging loop feeds nothing
        live.process.send_signal(signal.SIGCONT)
        assert manager.recv(4096).startswith(b"WATCHDOG=1")
        live.process.send_signal(signal.SIGTERM)
        while (last := manager.recv(4096)) != b"STOPPING=1":
            assert last.startswith(b"WATCHDOG=1")
        assert live.process.wait(DEADLINE_S) == 0
    finally:
        live.kill()
        manager.close()


def test_a_log_that_nobody_reads_stalls_nobody() -> None:
    program = (
        "import logging, sys\n"
        "from tinyekf_py.program_log import BackgroundLog\n"
        "log = logging.getLogger(); log.addHandler(BackgroundLog(sys.stderr))\n"
        "for n in range(3000): log.error('%s %s', n, 'x' * 100)\n"
        "print('done', flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], DEADLINE_S)[0], "the log stalls the program"
        assert process.stdout.readline() == b"done\n"
        assert process.wait(DEADLINE_S) == 0


def test_a_message_that_repeats_is_held_back() -> None:
    repeats = RepeatFilter()
    records = [logging.makeLogRecord({"msg": "%s: worker died", "args": ("imu",)}) for _ in range(100)]
    assert sum(repeats.filter(record) for record in records) == BURST
    assert repeats.filter(logging.makeLogRecord({"msg": "%s: worker died", "args": ("gps1",)}))


def test_the_journal_gets_a_priority_before_every_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "journal").open("w+") as journal:
        status = os.fstat(journal.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        log = BackgroundLog(journal)
        assert isinstance(log.formatter, JournalFormatter)
        log.handle(logging.makeLogRecord({"msg": "two\nlines", "levelno": logging.ERROR}))
        log.close()
        journal.seek(0)
        assert journal.read() == "<3>two\n<3>lines\n"
