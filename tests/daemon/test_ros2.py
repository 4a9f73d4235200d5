"""ROS 2 sees the joints: the message as rosbags decodes it, key, tokens and attachment as rmw_zenoh wants them."""

from __future__ import annotations

import math
import struct
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from lostmotion.daemon.lifecycle import happen, raised
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import AlarmEvent, Cause, Health, JointRow, ScoreRow, Severity
from lostmotion.daemon.sinks.diagnostics import HASH, Board, key, tokens
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.drivers.codec.rmw_zenoh import attachment
from tests.daemon.conftest import wait_until
from tests.daemon.zenoh_world import session

NAME = "diagnostic_msgs/msg/DiagnosticArray"
ROS = get_typestore(Stores.ROS2_JAZZY)
NOON = datetime(2026, 1, 31, 12, 0, 0, 123456, tzinfo=UTC)
SCORE = ScoreRow("elbow", NOON, 0.25, 17.54, 8.0, True, play=math.radians(3.4 / 60), severity=math.radians(3.6 / 60))
WARNING = raised("elbow", Cause.PLAY, Severity.WARNING, "play: much", NOON)
FAULT = raised("wrist", Cause.DEVICE, Severity.ERROR, "no data", NOON)


def board() -> Board:
    """A good shoulder, a worn elbow, and a wrist whose sensor is dead."""
    board = Board("arm1")
    for row in (
        JointRow("shoulder"),
        JointRow("elbow", Health.WARNING, "spüre Spiel", NOON),
        JointRow("wrist", Health.DEGRADED, "no data", NOON),
    ):
        board.health(row)
    board.score(SCORE)
    for change in (WARNING, FAULT):
        board.alarm(change.alarm)
    return board


def decoded(data: bytes) -> Any:
    """The message as rosbags reads it; writing it again gives the same bytes."""
    message = ROS.deserialize_cdr(data, NAME)
    assert bytes(ROS.serialize_cdr(message, NAME)) == data
    return message


def test_rosbags_reads_the_message() -> None:
    """Levels, names, texts beyond ASCII and values arrive; a dead sensor is STALE."""
    message = decoded(board().message(NOON))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1769860800, 123456000)
    assert [status.level for status in message.status] == [0, 1, 3]
    assert [status.name for status in message.status][1:] == ["lostmotion: elbow", "lostmotion: wrist"]
    assert [status.message for status in message.status] == ["OK", "spüre Spiel", "no data"]
    assert {status.hardware_id for status in message.status} == {"arm1"}
    values = {pair.key: pair.value for pair in message.status[1].values}
    assert values == {
        "health": "WARNING", "score": "17.54", "level": "8", "play [arcmin]": "3.4", "severity [arcmin]": "3.6",
        "alarm play": "warning, active",
    }  # fmt: skip


@pytest.mark.parametrize("length", range(9))
def test_texts_of_every_length_are_aligned(length: int) -> None:
    """Padding is right wherever a text ends."""
    one = Board("r")
    one.health(JointRow("j" * (length + 1), Health.ERROR, "x" * length or "?"))
    (status,) = decoded(one.message(NOON)).status
    assert (status.level, status.name) == (2, f"lostmotion: {'j' * (length + 1)}")


def test_cleared_alarms_are_not_told() -> None:
    """A device that is back is no longer STALE; a shelved alarm is not shown."""
    seen = board()
    seen.alarm(happen(FAULT.alarm, AlarmEvent.CLEARED, NOON).alarm)
    seen.alarm(happen(WARNING.alarm, AlarmEvent.SHELVED, NOON, until=NOON).alarm)
    message = decoded(seen.message(NOON))
    assert message.status[2].level == 1
    assert "alarm play" not in {pair.key for pair in message.status[1].values}


def test_the_hash_is_that_of_the_type() -> None:
    """REP 2011's hash, computed by rosbags from the definition, is the one in the key."""
    assert ROS.hash_rihs01(NAME) == HASH
    assert key(7) == f"7/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/{HASH}"


def test_tokens_and_attachment() -> None:
    """The node's and the publisher's token in the form of rmw_zenoh's design page; 33 bytes with each message."""
    node, publisher = tokens(2, "arm-1", "aac3178e146ba6f1fc6e6a4085e77f21")
    assert node == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%arm_1/lostmotion"
    assert publisher == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/1/MP/%/%arm_1/lostmotion/%diagnostics/"
        f"diagnostic_msgs::msg::dds_::DiagnosticArray_/{HASH}/::,10:,:,:,,"
    )
    assert struct.unpack("<qqB16s", attachment(5, 6, bytes(range(16)))) == (5, 6, 16, bytes(range(16)))


def test_a_ros_subscriber_hears_the_joints(endpoint: str) -> None:
    """Over a real session: a message a second under the key, numbered; tokens while the service runs, then none."""
    options = ZenohOptions(mode="client", connect=[endpoint], ros2=True, ros2_domain=3)
    with session("router", listen=[endpoint]) as ros:
        heard: list[zenoh.Sample] = []
        ros.declare_subscriber(key(3), heard.append)
        with closing(ZenohSink("arm1", options, Path("none.db"))) as sink:
            sink.health(JointRow("elbow"))
            wait_until(lambda: len(heard) >= 2)
            alive = [str(reply.ok.key_expr).split("/")[5] for reply in ros.liveliness().get("@ros2_lv/**") if reply.ok]
        assert sorted(alive) == ["MP", "NN"]
        wait_until(lambda: not list(ros.liveliness().get("@ros2_lv/**")))
    assert [status.name for status in decoded(heard[1].payload.to_bytes()).status] == ["lostmotion: elbow"]
    told = [sample.attachment.to_bytes() for sample in heard if sample.attachment]
    assert [struct.unpack("<q", attached[:8])[0] for attached in told] == list(range(1, len(heard) + 1))
    assert {len(attached) for attached in told} == {33}


def test_off_unless_asked_for(endpoint: str) -> None:
    """Without ros2 = true nothing of ROS is on the network."""
    with (
        session("router", listen=[endpoint]) as ros,
        closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), Path("none.db"))) as sink,
    ):
        wait_until(lambda: sink.is_open)
        wait_until(lambda: list(ros.liveliness().get("lostmotion/*/alive")))
        assert list(ros.liveliness().get("@ros2_lv/**")) == []
