"""Messages survive the pipe, however its reads split them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.message import (
    COUNTS,
    ERROR,
    LINE,
    MAX_LINE,
    MAX_MESSAGE,
    RESTART,
    Message,
    MessageError,
    MessageParser,
    pack_line,
    pack_text,
)
from acquisition.sample import IMU, ImuSample, unpack

IMU_LINE = b"*1.49,1.97,-5.44,7.27,0.48,1.92,-0.027,0.041,0.994"
IMU_SAMPLE = ImuSample(70_850, IMU, 0, 1.49, 1.97, -5.44, 7.27, 0.48, 1.92, -0.027, 0.041, 0.994, 1.0, 2.0, 3.0)


def test_a_line_arrives_with_its_sample() -> None:
    (message,) = MessageParser().feed(pack_line(70_850, IMU_LINE, (IMU_SAMPLE,)))
    assert message[:3] == (70_850, LINE, IMU_LINE)
    assert unpack(message.samples) == IMU_SAMPLE


def test_a_line_may_complete_several_samples_or_none() -> None:
    later = IMU_SAMPLE._replace(t_us=80_000)
    none, two = MessageParser().feed(pack_line(1, b"$GPGSV", ()) + pack_line(2, b"$GPGGA", (IMU_SAMPLE, later)))
    assert none.samples == b""
    assert [unpack(two.samples[:112]), unpack(two.samples[112:])] == [IMU_SAMPLE, later]


def test_the_longest_line_and_every_byte_pass_unchanged() -> None:
    line = bytes(range(256)) * (MAX_LINE // 256)
    (message,) = MessageParser().feed(pack_line(-5, line, (IMU_SAMPLE, IMU_SAMPLE)))
    assert (message.t_us, message.line, len(message.samples)) == (-5, line, 224)


def test_a_line_that_no_framing_gives_is_refused() -> None:
    with pytest.raises(MessageError, match="1025 bytes"):
        pack_line(0, bytes(MAX_LINE + 1))
    with pytest.raises(MessageError, match="40 samples"):
        pack_line(0, b"", [IMU_SAMPLE] * 40)


def test_a_long_traceback_keeps_its_end() -> None:
    packed = pack_text(0, ERROR, b"Traceback\n" + b"x" * 10_000 + b"\nValueError: the reason")
    assert len(packed) == MAX_MESSAGE
    (message,) = MessageParser().feed(packed)
    assert message.text.endswith("ValueError: the reason")


_STAMPS = st.integers(0, 2**62)
_LINES = st.builds(
    lambda t_us, line, count: pack_line(t_us, line, [IMU_SAMPLE] * count),
    _STAMPS,
    st.binary(max_size=90),
    st.integers(0, 2),
)
_TEXTS = st.builds(lambda t_us, text: pack_text(t_us, COUNTS, text), _STAMPS, st.binary(max_size=90))


@given(st.lists(st.one_of(_LINES, _TEXTS), max_size=12), st.data())
def test_messages_do_not_depend_on_how_reads_split_them(packed: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(packed)
    whole = MessageParser().feed(stream)
    assert len(whole) == len(packed)
    parser, pieces, start = MessageParser(), [], 0
    while start < len(stream):
        size = data.draw(st.integers(1, 300))
        pieces += parser.feed(stream[start : start + size])
        start += size
    assert pieces == whole


@given(st.binary(min_size=1, max_size=400))
def test_nonsense_gives_messages_or_an_error_but_nothing_else(noise: bytes) -> None:
    parser = MessageParser()
    try:
        messages = parser.feed(noise)
    except MessageError:
        return
    assert all(isinstance(message, Message) and message.kind <= RESTART for message in messages)
