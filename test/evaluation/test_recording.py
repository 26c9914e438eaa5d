"""Recording: whatever the order of arrival, equal runs give equal bags."""

import itertools
import random
import shutil

from portnav_ros.evaluation import bag_writer
from portnav_ros.evaluation.bag_writer import TYPES, BagError
from portnav_ros.evaluation.bags import read_bag
from portnav_ros.evaluation.recording import RecordedTopic, Recording, StampOrder, stamp_ns

POSE, STATUS = 'geometry_msgs/msg/PoseStamped', 'diagnostic_msgs/msg/DiagnosticStatus'
TOPICS = (
    RecordedTopic('/time', POSE, 10, False),
    RecordedTopic('/other', POSE, 10, False),
    RecordedTopic('/state', STATUS, 1, True),
)
SECOND_NS = 1_000_000_000


def pose(time_ns: int, x: float = 0.0) -> bytes:
    types = TYPES.types
    stamp = types['builtin_interfaces/msg/Time'](*divmod(time_ns, SECOND_NS))
    point = types['geometry_msgs/msg/Point'](x, 0.0, 0.0)
    turn = types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)
    message = types[POSE](
        types['std_msgs/msg/Header'](stamp, 'map'), types['geometry_msgs/msg/Pose'](point, turn)
    )
    return bytes(TYPES.serialize_cdr(message, POSE))


def status(**values: object) -> bytes:
    pair = TYPES.types['diagnostic_msgs/msg/KeyValue']
    pairs = [pair(key, str(value)) for key, value in values.items()]
    return bytes(TYPES.serialize_cdr(TYPES.types[STATUS](0, 'episode', '', '', pairs), STATUS))


def record(path, messages, every: int = 7) -> Recording:
    recording = Recording(path, 'sqlite3', TOPICS, {}, 2 * SECOND_NS)
    newest_ns = 0
    for number, (topic, data) in enumerate(messages):
        stamp = recording.push(topic, data)
        newest_ns = stamp if topic == 0 else newest_ns
        if number % every == 0:
            recording.file(newest_ns)
    recording.close()
    return recording


def run(seed: int):
    """Two topics and a state of one run; how they interleave on arrival depends on the seed."""
    streams = [
        [(0, pose(k * SECOND_NS // 4)) for k in range(200)],
        [(1, pose(k * SECOND_NS // 2)) for k in range(100)],
        [(2, status(stamp=k * SECOND_NS)) for k in range(50)],
    ]
    keyed = [
        ((k * (1, 2, 4)[s] + random.Random(seed + s * k).random() * 4), item)
        for s, stream in enumerate(streams)
        for k, item in enumerate(stream)
    ]
    in_order = {s: iter(stream) for s, stream in enumerate(streams)}
    return [next(in_order[item[0]]) for _, item in sorted(keyed, key=lambda pair: pair[0])]


def test_the_order_of_arrival_does_not_show(tmp_path):
    assert run(1) != run(2)
    contents = []
    for seed, every in ((1, 7), (2, 3)):
        record(tmp_path / str(seed) / 'bag', run(seed), every)
        folder = tmp_path / str(seed) / 'bag'
        contents.append([(file.name, file.read_bytes()) for file in sorted(folder.iterdir())])
    assert contents[0] == contents[1]


def test_nothing_is_lost_and_stamps_are_the_messages_own(tmp_path):
    recording = record(tmp_path / 'bag', run(1))
    bag = read_bag(tmp_path)
    assert [stamp for stamp, _ in bag.messages['/other']] == [k * SECOND_NS // 2 for k in range(100)]
    assert recording.written == sum(map(len, bag.messages.values())) == 350


def test_a_message_from_another_clock_does_not_spoil_the_order(tmp_path):
    messages = [
        (0, pose(0)),
        (1, pose(1_800_000_000 * SECOND_NS)),
        (0, pose(SECOND_NS)),
        (1, pose(SECOND_NS)),
    ]
    record(tmp_path / 'bag', messages)
    bag = read_bag(tmp_path)
    assert [stamp for stamp, _ in bag.messages['/other']] == [0, SECOND_NS]
    assert [stamp for stamp, _ in bag.messages['/time']] == [0, SECOND_NS]


def test_a_recording_begins_with_the_first_odometry(tmp_path):
    now = 1_700_000_000
    messages = [(1, pose(0)), (1, pose((now - 1) * SECOND_NS)), (2, status()), (0, pose(now * SECOND_NS))]
    record(tmp_path / 'bag', [*messages, (1, pose(0)), (0, pose((now + 1) * SECOND_NS))])
    bag = read_bag(tmp_path)
    assert {stamp for rows in bag.messages.values() for stamp, _ in rows} == {
        now * SECOND_NS,
        (now + 1) * SECOND_NS,
    }
    assert len(bag.messages['/other']) == 3


def test_what_comes_after_the_last_odometry_is_filed_and_keeps_its_stamp(tmp_path):
    recording = Recording(tmp_path / 'bag', 'sqlite3', TOPICS, {}, 2 * SECOND_NS)
    recording.push(0, pose(0))
    for second in range(1, 61):
        recording.push(1, pose(second * SECOND_NS))
        recording.file(second * SECOND_NS)
    assert recording.written == 58
    recording.close()
    assert [stamp for stamp, _ in read_bag(tmp_path).messages['/other']] == [
        second * SECOND_NS for second in range(1, 61)
    ]


def test_a_repeated_message_is_recorded_once(tmp_path):
    messages = [(0, pose(0, 1.0)), (1, pose(0, 1.0)), (0, pose(0, 2.0)), (0, pose(0, 1.0)), (0, pose(1, 2.0))]
    record(tmp_path / 'bag', messages)
    bag = read_bag(tmp_path)
    assert [message.pose.position.x for _, message in bag.messages['/time']] == [1.0, 2.0, 2.0]
    assert len(bag.messages['/other']) == 1


def test_the_last_answer_is_left_out_whether_it_came_or_not(tmp_path):
    topics = (TOPICS[0], TOPICS[1]._replace(answer=True))
    asked = [(0, pose(k * SECOND_NS)) for k in range(3)]
    for name, answers in (('late', 2), ('in_time', 3)):
        recording = Recording(tmp_path / name / 'bag', 'sqlite3', topics, {}, 0)
        for topic, data in asked + [(1, data) for _, data in asked[:answers]]:
            recording.push(topic, data)
        recording.close()
        bag = read_bag(tmp_path / name)
        assert [len(bag.messages[topic.name]) for topic in topics] == [3, 2]


def test_a_disk_that_refuses_ends_the_recording_only(tmp_path, monkeypatch):
    recording = Recording(tmp_path / 'bag', 'sqlite3', TOPICS, {}, 2 * SECOND_NS)
    refusals = itertools.count()

    def refuse(*_):
        next(refusals)
        raise BagError('bag: cannot be written: no space left')

    for k in range(40):
        if k == 30:
            monkeypatch.setattr(bag_writer.BagWriter, 'write', refuse)
        recording.file(recording.push(0, pose(k * SECOND_NS)))
    recording.close()
    assert 'no space left' in recording.failure
    assert next(refusals) == 1
    assert len(read_bag(tmp_path).messages['/time']) == 25


def test_messages_are_filed_by_stamp_topic_and_arrival():
    order = StampOrder()
    for number, (stamp, topic) in enumerate([(2, 1), (1, 1), (2, 0), (1, 0), (1, 0)]):
        order.push(stamp, topic, bytes([number]))
    assert [item.data[0] for item in order.release(2)] == [3, 4, 1]
    assert [item.data[0] for item in order.release(3)] == [2, 0]


def test_stamps_are_found():
    assert stamp_ns(POSE, pose(12_345_678_901)) == 12_345_678_901
    assert stamp_ns(STATUS, status(outcome='SUCCESS', stamp=12_345_678_901)) == 12_345_678_901
    assert stamp_ns(STATUS, status(outcome='SUCCESS')) == 0


def test_checkpoints_go_on_when_a_driver_begins_anew(tmp_path):
    recording = Recording(tmp_path / 'bag', 'sqlite3', TOPICS, {}, 2 * SECOND_NS)
    for voyage in (range(60), range(20)):
        for second in voyage:
            recording.file(recording.push(0, pose(second * SECOND_NS)))
    shutil.copytree(tmp_path / 'bag', tmp_path / 'killed')
    recording.close()
    assert len(read_bag(tmp_path / 'killed').messages['/time']) > 70
