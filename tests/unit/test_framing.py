"""Bytes to lines and frames: in any pieces, with noise, and bounded."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.framing import MAX_LINE_BYTES, HexFraming, LineFraming


def hex_frame(*values: int) -> bytes:
    body = struct.pack(f">2s{len(values)}h", b"\x55\x55", *values)
    return body + struct.pack(">H", sum(body) & 0xFFFF)


def test_lines_lose_their_ending_and_empty_ones_are_skipped() -> None:
    assert LineFraming().feed(b"a\r\n\r\n\nb\n\r\nc") == [b"a", b"b"]


def test_a_line_goes_out_when_the_chunk_that_ends_it_comes() -> None:
    framing = LineFraming()
    assert framing.feed(b"$GPG") == []
    assert framing.feed(b"GA,1\r") == []
    assert framing.feed(b"\n$") == [b"$GPGGA,1"]


def test_only_one_carriage_return_belongs_to_the_ending() -> None:
    assert LineFraming().feed(b"a\r\r\n") == [b"a\r"]


@pytest.mark.parametrize("ending", [b"\n", b"\r\n"])
def test_the_longest_line_passes_and_one_byte_more_does_not(ending: bytes) -> None:
    longest = b"x" * MAX_LINE_BYTES
    framing = LineFraming()
    assert framing.feed(longest + ending) == [longest]
    assert framing.feed(longest + b"y" + ending + b"next\n") == [b"next"]
    assert framing.dropped["overlong"] == 1


def test_a_megabyte_without_an_end_is_counted_once_and_the_next_line_is_read() -> None:
    framing = LineFraming()
    for _ in range(1024):
        assert framing.feed(b"z" * 1024) == []
    assert framing.feed(b"end\n$GPRMC\n") == [b"$GPRMC"]
    assert framing.dropped == {"overlong": 1}


@given(
    st.lists(st.binary(min_size=1, max_size=30).filter(lambda line: b"\n" not in line and not line.endswith(b"\r"))),
    st.integers(1, 40),
)
def test_lines_do_not_depend_on_the_size_of_the_pieces(lines: list[bytes], size: int) -> None:
    stream = b"".join(line + b"\r\n" for line in lines)
    framing = LineFraming()
    out: list[bytes] = []
    for i in range(0, len(stream), size):
        out += framing.feed(stream[i : i + size])
    assert out == lines


def test_hex_frames_are_found_in_noise_whatever_the_pieces() -> None:
    frames = [hex_frame(1, -2, 3), hex_frame(0x5555, 0x5555, 0x5555), hex_frame(-1, 0, 32767)]
    stream = b"\x00\x55\x12" + frames[0] + b"\xff" + frames[1] + frames[2] + b"\x55"
    for size in (1, 2, 3, 7, len(stream)):
        framing = HexFraming(10)
        out: list[bytes] = []
        for i in range(0, len(stream), size):
            out += framing.feed(stream[i : i + size])
        assert out == frames
        assert framing.dropped == {"noise": 4}


def test_a_bad_sum_is_counted_once_and_the_next_frame_is_found() -> None:
    good, bad = hex_frame(10, 20, 30), bytearray(hex_frame(11, 0x5555, 31))
    bad[3] ^= 1
    framing = HexFraming(10)
    assert framing.feed(good + bytes(bad) + good + bytes(bad) + bytes(bad) + good) == [good] * 3
    assert framing.dropped["checksum"] == 3


def test_a_frame_is_not_lost_to_a_start_that_noise_imitates() -> None:
    good = hex_frame(100, 200, 300)
    assert HexFraming(10).feed(b"\x55" + good + b"\x55\x55\x55" + good) == [good, good]


def test_noise_takes_no_memory() -> None:
    framing = HexFraming(22)
    for _ in range(100):
        framing.feed(b"\x00\x55\x54" * 1000)
    assert framing.dropped["noise"] == 300_000


def test_a_frame_too_short_to_be_one_is_refused() -> None:
    with pytest.raises(ValueError, match="no content"):
        HexFraming(4)
