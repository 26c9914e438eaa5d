"""Checkpoints: what is written comes back, a kill leaves the old one, damage is named."""

import json

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero import checkpoint  # noqa: E402
from portnav_ros.muzero.checkpoint import STATE, Checkpoints, Saved, read_arrays, write_arrays  # noqa: E402
from portnav_ros.muzero.replay import Replay, ReplayParams, Segment  # noqa: E402
from portnav_ros.muzero.targets import TargetParams  # noqa: E402
from portnav_ros.training.run_directory import TrainingError  # noqa: E402

CPU = torch.device('cpu')


def new_replay():
    return Replay(ReplayParams(capacity=100, warmup=0, precision='float32'), 2, 3, 4, lessons=2)


def grow(replay, count):
    rng = np.random.default_rng(replay.written)
    shape = count, 2
    replay.append(
        Segment(
            rng.normal(size=(*shape, 3)),
            rng.integers(4, size=shape),
            rng.normal(size=shape),
            (rng.random(shape) < 0.1).astype(np.uint8),
            rng.normal(size=shape),
            rng.dirichlet(np.ones(4), shape),
            np.zeros(shape),
            np.full(shape, replay.written),
            np.zeros((*shape, 2), np.int8),
            np.zeros((*shape, 2), np.float16),
        )
    )


def saved(number):
    return Saved(
        {'array': np.full(3, number), 'words': np.array('{"state": 2}')},
        {'weights': torch.full((2,), float(number)), 'updates': number},
        {'steps': number, 'generator': np.random.default_rng(number).bit_generator.state},
    )


def test_nothing_is_there_at_first(tmp_path):
    assert Checkpoints(tmp_path).load(new_replay(), CPU) is None


def test_the_last_one_comes_back_through_a_ring_that_has_turned(tmp_path):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    for number, count in enumerate((7, 30, 0, 45, 20)):
        grow(replay, count)
        checkpoints.save(str(number), saved(number), replay)
    copy = new_replay()
    back = Checkpoints(tmp_path).load(copy, CPU)
    assert back.counters == saved(4).counters
    np.testing.assert_array_equal(back.arrays['array'], [4, 4, 4])
    assert str(back.arrays['words']) == '{"state": 2}'
    assert back.tensors['updates'] == 4
    for ring in (replay, copy):
        grow(ring, 3)
    samples = [ring.sample(np.random.default_rng(0), 50, 3, TargetParams()) for ring in (replay, copy)]
    np.testing.assert_array_equal(samples[0].features, samples[1].features)
    np.testing.assert_array_equal(samples[0].policy, samples[1].policy)
    np.testing.assert_array_equal(samples[0].targets.value, samples[1].targets.value)


def test_each_decision_is_written_once_and_what_left_the_ring_goes(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, 'DECISIONS_PER_FILE', 20)
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    for number in range(12):
        grow(replay, 10)
        checkpoints.save(str(number), saved(number), replay)
    ranges = json.loads((tmp_path / STATE).read_text())['replay']
    assert ranges == [[at, at + 10] for at in range(70, 120, 10)]
    assert len(list(tmp_path.iterdir())) == len(ranges) + 3


def test_a_kill_while_writing_leaves_the_one_before(tmp_path, monkeypatch):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    grow(replay, 20)
    checkpoints.save('1', saved(1), replay)
    grow(replay, 20)

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, 'write_atomically', killed)
    with pytest.raises(KeyboardInterrupt):
        checkpoints.save('2', saved(2), replay)
    monkeypatch.undo()
    copy = new_replay()
    again = Checkpoints(tmp_path)
    assert again.load(copy, CPU).counters['steps'] == 1
    assert copy.written == 20
    grow(copy, 20)
    again.save('2', saved(2), copy)
    assert Checkpoints(tmp_path).load(new_replay(), CPU).counters['steps'] == 2


def cut(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def empty(file):
    file.write_bytes(b'')


def single(file):
    with file.open('wb') as stream:
        np.save(stream, np.zeros(3))


def pickled(file):
    with file.open('wb') as stream:
        np.savez(stream, array=np.array([print], dtype=object))


@pytest.mark.parametrize('damage', [cut, empty, single, pickled, lambda file: file.unlink()])
@pytest.mark.parametrize('name', ['arrays-1.npz', 'tensors-1.pt', 'replay-0-20.npz'])
def test_a_damaged_or_foreign_file_is_named(tmp_path, name, damage):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    grow(replay, 20)
    checkpoints.save('1', saved(1), replay)
    damage(tmp_path / name)
    with pytest.raises(TrainingError, match=rf'{name}: the checkpoint is damaged .*--out'):
        Checkpoints(tmp_path).load(new_replay(), CPU)


@pytest.mark.parametrize(
    'other', [np.zeros((20, 1, 3)), np.zeros((20, 2, 4)), np.full((20, 2, 3), 'word'), np.zeros((9, 2, 3))]
)
def test_arrays_of_another_run_are_named(tmp_path, other):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    grow(replay, 20)
    checkpoints.save('1', saved(1), replay)
    file = tmp_path / 'replay-0-20.npz'
    write_arrays(file, read_arrays(file) | {'features': other})
    with pytest.raises(TrainingError, match='another run'):
        Checkpoints(tmp_path).load(new_replay(), CPU)


def test_a_checkpoint_of_another_schema_is_named(tmp_path):
    (tmp_path / STATE).write_text('{"schema": 99}')
    with pytest.raises(TrainingError, match='schema 99'):
        Checkpoints(tmp_path).load(new_replay(), CPU)


@pytest.mark.parametrize(('added', 'dropped'), [((), ('lesson', 'regret')), (('wake',), ())])
def test_a_replay_of_another_version_is_named(tmp_path, added, dropped):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    grow(replay, 20)
    checkpoints.save('1', saved(1), replay)
    arrays = read_arrays(tmp_path / 'replay-0-20.npz')
    kept = {name: array for name, array in arrays.items() if name not in dropped}
    write_arrays(tmp_path / 'replay-0-20.npz', kept | dict.fromkeys(added, arrays['reward']))
    with pytest.raises(TrainingError, match=f'{", ".join(added + dropped)}: .* other fields.*--out'):
        Checkpoints(tmp_path).load(new_replay(), CPU)


def test_pickled_code_is_not_run(tmp_path):
    replay, checkpoints = new_replay(), Checkpoints(tmp_path)
    grow(replay, 20)
    checkpoints.save('1', saved(1), replay)
    torch.save({'code': print}, tmp_path / 'tensors-1.pt')
    with pytest.raises(TrainingError):
        Checkpoints(tmp_path).load(new_replay(), CPU)
