"""The device to learn on: which names there are, and what is said of one that is not there."""

import pytest

from portnav_ros.training.run_directory import TrainingError

torch = pytest.importorskip('torch')

from portnav_ros.training.device import check_device  # noqa: E402


@pytest.fixture
def built(monkeypatch):
    """Make this a torch for so many GPUs; None: one without CUDA."""

    def install(gpus):
        monkeypatch.setattr(torch.backends.cuda, 'is_built', lambda: gpus is not None)
        monkeypatch.setattr(torch.cuda, 'device_count', lambda: gpus or 0)

    return install


@pytest.mark.parametrize(('gpus', 'name'), [(None, 'cpu'), (0, 'cpu'), (1, 'cuda'), (2, 'cuda:1')])
def test_what_is_there_is_taken(built, gpus, name):
    built(gpus)
    check_device(name)


@pytest.mark.parametrize(
    ('gpus', 'name', 'reason'),
    [
        (None, 'cuda', 'this torch has no CUDA; leave it out or install a CUDA build'),
        (0, 'cuda', 'GPUs that torch finds here: 0; leave it out'),
        (1, 'cuda:1', 'GPUs that torch finds here: 1; leave it out, or name one of them'),
        (1, 'nonsense', 'expected cpu or cuda'),
        (1, 'cuda:x', 'expected cpu or cuda'),
        (1, 'meta', 'expected cpu or cuda'),
    ],
)
def test_what_is_not_there_is_refused_with_the_mend(built, gpus, name, reason):
    built(gpus)
    with pytest.raises(TrainingError, match=f'--device {name}: {reason}'):
        check_device(name)
