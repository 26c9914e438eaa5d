"""A run that is taught and then rehearses: resumed to the bit, and back to search after both."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.atoms import AtomParams  # noqa: E402
from portnav_ros.muzero.checkpoint import Checkpoints  # noqa: E402
from portnav_ros.muzero.learner import LearnerParams  # noqa: E402
from portnav_ros.muzero.loop import Loop, Params  # noqa: E402
from portnav_ros.muzero.networks import NetworkParams  # noqa: E402
from portnav_ros.muzero.rehearsal import RehearsalParams  # noqa: E402
from portnav_ros.muzero.replay import ReplayParams  # noqa: E402
from portnav_ros.muzero.search import SearchParams  # noqa: E402
from portnav_ros.muzero.selfplay import SelfPlayParams  # noqa: E402
from portnav_ros.muzero.tutor import NOT_TAUGHT, TeachingParams  # noqa: E402
from portnav_ros.params import ParamError  # noqa: E402
from portnav_ros.task.actions import ActionParams  # noqa: E402
from portnav_ros.task.observation import ObservationParams  # noqa: E402
from portnav_ros.task.params import TaskParams  # noqa: E402
from portnav_ros.training.scenarios import ScenarioParams  # noqa: E402
from portnav_ros.training.schedule import ScheduleParams  # noqa: E402

SEGMENT, BATCH, HOLD = 6, 4, 8
ITERATION = SEGMENT * BATCH * HOLD  # environment steps
TAUGHT, REHEARSED = 3, 2  # iterations
ATOMS = AtomParams(21, -1500.0, 1500.0, 'linear')


def params():
    """The recipes of the presets `best` and `rehearse` in small, one after the other."""
    return Params(
        task=TaskParams(
            ObservationParams(layout='aligned', ages=(0, 2), sectors=12),
            ActionParams((-0.5, 0.0, 0.5), (1.0, 5.0), 'path', HOLD),
        ),
        scenarios=ScenarioParams(testbed='head_on'),
        network=NetworkParams(
            8, (16,), (16,), (16,), ATOMS, ATOMS, alive=True, scan_channels=(2, 3), scan_shape=(2, 12)
        ),
        search=SearchParams(simulations=4),
        selfplay=SelfPlayParams(environments=BATCH, segment=SEGMENT),
        replay=ReplayParams(capacity=400, warmup=SEGMENT * BATCH, samples_per_step=0.2, lessons=0.5),
        learner=LearnerParams(batch=16, unroll=2, precision='bfloat16'),
        schedule=ScheduleParams(8 * ITERATION),
        teaching=TeachingParams(steps=TAUGHT * ITERATION, actions=4, follow=0.25),
        rehearsal=RehearsalParams(REHEARSED * ITERATION, share=0.5, actions=4, decisions=2, threads=2),
        mirror=True,
    )


def iterate(loop, count):
    with ThreadPoolExecutor(1) as worker:
        for _ in range(count):
            loop.iterate(worker)


@pytest.fixture(scope='module')
def whole():
    """A run that nothing interrupts."""
    torch.set_num_threads(1)
    loop = Loop(params(), seed=2)
    iterate(loop, TAUGHT + REHEARSED + 2)
    return loop


@pytest.mark.parametrize('iterations', [2, TAUGHT + 1, TAUGHT + REHEARSED + 1])
def test_a_taught_run_goes_on_to_the_bit(whole, tmp_path, iterations):
    first, second = Loop(params(), seed=2), Loop(params(), seed=2)
    iterate(first, iterations)
    assert np.isfinite(first.state().arrays['tutor_poses']).any()
    Checkpoints(tmp_path).save('1', first.state(), first.replay)
    second.restore(Checkpoints(tmp_path).load(second.replay, second.learner.device))
    iterate(second, TAUGHT + REHEARSED + 2 - iterations)
    assert second.learner.updates == whole.learner.updates > 0
    for name, array in whole.learner.arrays().items():
        np.testing.assert_array_equal(array, second.learner.arrays()[name], err_msg=name)
    for name, array in whole.selfplay.state_dict().items():
        np.testing.assert_array_equal(array, second.selfplay.state_dict()[name], err_msg=name)
    written = whole.replay.written
    for a, b in zip(whole.replay.segment(0, written), second.replay.segment(0, written), strict=True):
        np.testing.assert_array_equal(a, b)


def test_lessons_come_first_and_searches_afterwards(whole):
    lessons = whole.replay.segment(0, TAUGHT * SEGMENT)
    assert (lessons.lesson[:, 0] != NOT_TAUGHT).all()  # the first of four follows
    assert (lessons.lesson[:, 1:] == NOT_TAUGHT).any()
    assert (lessons.policy == 0.0).all()
    rehearsed = whole.replay.segment(TAUGHT * SEGMENT, (TAUGHT + REHEARSED) * SEGMENT)
    assert ((rehearsed.lesson[..., 0] != NOT_TAUGHT).sum(axis=1) == BATCH // 2).all()
    searches = whole.replay.segment((TAUGHT + REHEARSED) * SEGMENT, whole.replay.written)
    assert (searches.lesson == NOT_TAUGHT).all()
    np.testing.assert_allclose(searches.policy.sum(-1), 1.0, atol=1e-5)


def test_lessons_of_two_sizes_are_refused():
    recipe = params()
    with pytest.raises(ParamError, match=r'teaching\.actions = 5, rehearsal\.actions = 4'):
        dataclasses.replace(recipe, teaching=dataclasses.replace(recipe.teaching, actions=5))


def test_what_is_learned_is_told_by_term(whole):
    means = whole.means.take()
    assert means['loss_lesson'] > 0.0
    assert all(np.isfinite(value) for value in means.values())
