"""What the model thinks the actions of a lesson are worth."""

import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.atoms import AtomParams  # noqa: E402
from portnav_ros.muzero.losses import (  # noqa: E402
    WORTH_OF_REGRET,
    WORTH_SCALE,
    Batch,
    LossWeights,
    expectation,
    unroll,
    worth_loss,
)
from portnav_ros.muzero.networks import Network, NetworkParams  # noqa: E402
from portnav_ros.params import ParamError  # noqa: E402

REGRET = torch.tensor([[0.0, 400.0, 40.0]])
LESSON = torch.tensor([[4, 0, 2]])


def network(alive=True):
    torch.manual_seed(0)
    atoms = AtomParams(21, -1500.0, 1500.0, 'linear')
    return Network(5, 3, 2, NetworkParams(8, (16,), (16,), (16,), atoms, atoms, alive))


def batch(count=2, taught=True):
    lesson = LESSON.expand(count, 2, 3).clone()
    zeros = torch.zeros(count, 1)
    return Batch(
        features=torch.randn(count, 5, generator=torch.Generator().manual_seed(1)),
        action=torch.zeros(count, 1, dtype=torch.int64),
        policy=torch.full((count, 2, 6), 1.0 / 6.0),
        reward=zeros,
        value=torch.zeros(count, 2),
        going_on=zeros + 1.0,
        live=torch.ones(count, 2),
        trained=torch.ones(count, 2),
        lesson=lesson if taught else lesson - 10,
        regret=REGRET.expand(count, 2, 3).clone(),
    )


@pytest.mark.parametrize('alive', [True, False])
def test_worth_is_the_reward_and_what_may_follow(alive):
    net, given = network(alive), batch()
    said = unroll(net, given.features, given.action, given.lesson[:, 0])
    latent = net.represent(given.features)
    for column, action in enumerate(LESSON[0]):
        after = net.step(latent, action.expand(2))
        value = expectation(net.predict(after.latent).value, net.value_atoms)
        going_on = torch.sigmoid(after.alive) if alive else 1.0
        expected = expectation(after.reward, net.reward_atoms) + going_on * value
        torch.testing.assert_close(said.worth[:, column], expected, rtol=1e-4, atol=1e-2)


def test_a_fresh_network_errs_by_the_spread_of_the_lesson():
    net, given = network(), batch()
    said = unroll(net, given.features, given.action, given.lesson[:, 0])
    wanted = WORTH_OF_REGRET * REGRET[0] / WORTH_SCALE
    expected = ((wanted - wanted.mean()) ** 2).mean()
    assert worth_loss(net, said, given).item() == pytest.approx(expected.item(), rel=1e-3)


def test_it_is_learned():
    net, given = network(), batch()
    optimiser = torch.optim.Adam(net.parameters(), 1e-2)
    for _ in range(300):
        loss = worth_loss(net, unroll(net, given.features, given.action, given.lesson[:, 0]), given)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    worth = unroll(net, given.features, given.action, given.lesson[:, 0]).worth
    apart = (worth[:, :1] - worth).detach()
    torch.testing.assert_close(apart, WORTH_OF_REGRET * REGRET.expand(2, 3), atol=60.0, rtol=0.1)


def test_what_is_not_taught_does_not_count():
    net, given = network(), batch(taught=False)
    assert (
        worth_loss(net, unroll(net, given.features, given.action, LESSON.expand(2, 3)), given).item() == 0.0
    )
    assert worth_loss(net, unroll(net, given.features, given.action), given).item() == 0.0


def test_weights_are_checked():
    with pytest.raises(ParamError, match='worth'):
        LossWeights(worth=-1.0)
