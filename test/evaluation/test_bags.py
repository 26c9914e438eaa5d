"""Bags written and read without ROS: whole, cut off, left by a killed process, on a full disk."""

import os
import resource
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from portnav_ros.evaluation.bag_writer import STORAGES, TYPES, BagError, BagWriter
from portnav_ros.evaluation.bags import read_bag

ODOMETRY = 'nav_msgs/msg/Odometry'


def odometry(time_ns: int, x_m: float = 0.0) -> bytes:
    types = TYPES.types
    header = types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(time_ns, 1_000_000_000)), 'map'
    )
    vector = types['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    pose = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](x_m, 0.0, 0.0),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
    )
    covariance = np.zeros(36)
    message = types[ODOMETRY](
        header,
        'base_link',
        types['geometry_msgs/msg/PoseWithCovariance'](pose, covariance),
        types['geometry_msgs/msg/TwistWithCovariance'](
            types['geometry_msgs/msg/Twist'](vector, vector), covariance
        ),
    )
    return bytes(TYPES.serialize_cdr(message, ODOMETRY))


def write(path, storage, count: int, close: bool = True) -> BagWriter:
    bag = BagWriter(path, storage, {'seed': '7'})
    topic = bag.add_topic('/odom', ODOMETRY)
    for number in range(count):
        bag.write(topic, number * 50_000_000, odometry(number * 50_000_000, float(number)))
        if number % 100 == 99:
            bag.checkpoint()
    if close:
        bag.close()
    return bag


def positions(bag) -> list[float]:
    return [message.pose.pose.position.x for _, message in bag.messages['/odom']]


@pytest.mark.parametrize('storage', STORAGES)
def test_what_was_written_is_read(tmp_path, storage):
    write(tmp_path / 'bag', storage, 250)
    bag = read_bag(tmp_path)
    assert positions(bag) == list(range(250))
    assert [stamp for stamp, _ in bag.messages['/odom']][:3] == [0, 50_000_000, 100_000_000]
    assert bag.metadata == {'seed': '7'}
    assert not bag.lost


@pytest.mark.parametrize('storage', STORAGES)
def test_equal_messages_give_equal_bytes(tmp_path, storage):
    contents = []
    for name in ('one', 'two'):
        write(tmp_path / name / 'bag', storage, 250)
        contents.append([file.read_bytes() for file in sorted((tmp_path / name / 'bag').iterdir())])
    assert contents[0] == contents[1]


@pytest.mark.parametrize('storage', STORAGES)
def test_a_killed_writer_leaves_what_it_had_filed(tmp_path, storage):
    script = textwrap.dedent(f"""
        import importlib.util, os
        spec = importlib.util.spec_from_file_location('writing', {__file__!r})
        writing = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(writing)
        from pathlib import Path
        writing.write(Path({str(tmp_path / 'bag')!r}), {storage!r}, 250, close=False)
        os.kill(os.getpid(), 9)
        """)
    assert subprocess.run((sys.executable, '-c', script), check=False).returncode == -signal.SIGKILL
    bag = read_bag(tmp_path)
    assert positions(bag) == list(range(200))
    assert 'cut off' in bag.lost or 'damaged' in bag.lost
    assert bag.metadata == {'seed': '7'}


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('share', [0.5, 0.9])
def test_a_cut_off_file_gives_its_beginning(tmp_path, storage, share):
    write(tmp_path / 'bag', storage, 2000)
    (file,) = (tmp_path / 'bag').glob('bag.*')
    os.truncate(file, int(file.stat().st_size * share))
    bag = read_bag(tmp_path)
    read = positions(bag)
    assert read == list(range(len(read)))
    assert 0.3 * share * 2000 < len(read) < 2000
    assert file.name in bag.lost


def test_a_file_of_nonsense_is_refused_by_name(tmp_path):
    (tmp_path / 'bag.mcap').write_bytes(b'not a bag')
    with pytest.raises(BagError, match=r'bag\.mcap: nothing can be read.*record the run again'):
        read_bag(tmp_path)


def test_a_folder_without_a_bag_is_refused(tmp_path):
    with pytest.raises(BagError, match=r'no \.db3 or \.mcap'):
        read_bag(tmp_path)


def test_missing_metadata_is_told(tmp_path):
    write(tmp_path / 'bag', 'sqlite3', 10)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    bag = read_bag(tmp_path)
    assert len(positions(bag)) == 10
    assert 'metadata.yaml is missing' in bag.lost


def test_a_bag_is_not_overwritten(tmp_path):
    write(tmp_path / 'bag', 'sqlite3', 1)
    with pytest.raises(BagError, match='exists already'):
        BagWriter(tmp_path / 'bag', 'sqlite3', {})


@pytest.mark.parametrize('storage', STORAGES)
def test_a_full_disk_is_an_error_and_the_beginning_stays(tmp_path, storage):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, limits[1]))
    try:
        with pytest.raises(BagError, match='cannot be written'):
            write(tmp_path / 'bag', storage, 2000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    read = positions(read_bag(tmp_path))
    assert read == list(range(len(read)))
    assert len(read) >= 100
