"""Losses: what they count, what they leave out, and that rows do not touch each other."""

import math

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.atoms import AtomParams, two_hot  # noqa: E402
from portnav_ros.muzero.losses import (  # noqa: E402
    TERMS,
    Batch,
    expectation,
    halve_gradient,
    two_hot_loss,
    unroll,
)
from portnav_ros.muzero.networks import Network, NetworkParams  # noqa: E402

FEATURES, HEADINGS, SPEEDS = 6, 3, 2
ACTIONS = HEADINGS * SPEEDS


def network(alive=True, seed=0):
    torch.manual_seed(seed)
    atoms = AtomParams(21, -1000.0, 1000.0, 'linear')
    made = Network(FEATURES, HEADINGS, SPEEDS, NetworkParams(8, (16,), (16,), (16,), atoms, atoms, alive))
    for parameter in made.parameters():  # the heads begin at zero
        torch.nn.init.normal_(parameter, std=0.3)
    return made


def batch(count=4, steps=3, seed=1):
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.randn(shape, generator=generator)

    return Batch(
        features=draw(count, FEATURES),
        action=torch.randint(ACTIONS, (count, steps), generator=generator),
        policy=torch.softmax(draw(count, steps + 1, ACTIONS), -1),
        reward=100.0 * draw(count, steps),
        value=300.0 * draw(count, steps + 1),
        going_on=torch.ones(count, steps),
        live=torch.ones(count, steps + 1),
        trained=torch.ones(count, steps + 1),
    )


def test_two_hot_loss_is_the_cross_entropy_to_the_two_hot_array():
    atoms = AtomParams().values()
    values = np.array([-5000.0, -1000.0, -110.3, -0.6, 0.0, 0.3, 999.0, 1500.0, 2000.0])
    logits = torch.randn(len(values), len(atoms), generator=torch.Generator().manual_seed(0))
    hot = torch.from_numpy(two_hot(atoms, values))
    expected = -(hot * torch.log_softmax(logits, -1)).sum(-1)
    found = two_hot_loss(logits, torch.from_numpy(atoms).float(), torch.from_numpy(values).float())
    torch.testing.assert_close(found, expected, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize('spacing', ['h', 'linear'])
def test_a_rare_disaster_is_worth_its_share(spacing):
    """The distribution that the loss drives to has the mean of the targets, not h^-1 of a mean of h."""
    params = AtomParams(spacing=spacing)
    atoms = torch.from_numpy(params.values()).float()
    targets = torch.cat([torch.full((300,), -1000.0), torch.zeros(700)])
    hot = torch.from_numpy(two_hot(params.values(), targets.double().numpy()))
    logits = torch.log(hot.mean(0) + 1e-12)
    assert float(expectation(logits, atoms)) == pytest.approx(-300.0, rel=1e-3)
    logits.requires_grad_()
    two_hot_loss(logits.expand(1000, -1), atoms, targets).mean().backward()
    assert float(logits.grad.abs().max()) < 1e-5


def test_unrolling_is_applying_the_networks_one_after_the_other():
    net, given = network(), batch()
    said = unroll(net, given.features, given.action)
    latent = net.represent(given.features)
    for k in range(3):
        torch.testing.assert_close(said.policy[:, k], net.predict(latent).policy)
        torch.testing.assert_close(said.value[:, k], net.predict(latent).value)
        step = net.step(latent, given.action[:, k])
        torch.testing.assert_close(said.reward[:, k], step.reward)
        torch.testing.assert_close(said.alive[:, k], step.alive)
        latent = step.latent


def test_gradient_is_halved_on_the_way_back():
    x = torch.tensor([3.0], requires_grad=True)
    y = halve_gradient(halve_gradient(x))
    assert y.item() == 3.0
    y.backward()
    assert x.grad.item() == 0.25


@pytest.mark.parametrize('name', TERMS)
def test_rows_do_not_touch_each_other(name):
    net, given = network(), batch(count=3)
    whole = TERMS[name](net, unroll(net, given.features, given.action), given)
    rows = [Batch(*(item[i : i + 1] for item in given)) for i in range(3)]
    apart = [TERMS[name](net, unroll(net, row.features, row.action), row) for row in rows]
    torch.testing.assert_close(whole, torch.stack(apart).mean())


@pytest.mark.parametrize('name', TERMS)
def test_masked_positions_teach_nothing(name):
    net, given = network(), batch()
    mask = torch.tensor([1.0, 1.0, 0.0, 0.0]).expand(4, 4)
    masked = given._replace(live=mask, trained=mask)
    other = masked._replace(
        reward=masked.reward + 500.0 * (1.0 - mask[:, :-1]),
        value=masked.value - 500.0 * (1.0 - mask),
        policy=torch.where(mask[..., None] > 0, masked.policy, 1.0 / ACTIONS),
        going_on=torch.where(mask[:, :-1] > 0, masked.going_on, 0.0),
    )
    said = unroll(net, given.features, given.action)
    assert TERMS[name](net, said, masked).item() == TERMS[name](net, said, other).item()


def test_uniform_policy_costs_the_logarithm_of_the_actions():
    torch.manual_seed(0)
    fresh, given = Network(FEATURES, HEADINGS, SPEEDS, NetworkParams()), batch()
    said = unroll(fresh, given.features, given.action)
    assert TERMS['policy'](fresh, said, given).item() == pytest.approx(2.0 * math.log(ACTIONS), rel=1e-5)


def test_a_network_without_that_head_has_no_alive_loss():
    net, given = network(alive=False), batch()
    assert TERMS['alive'](net, unroll(net, given.features, given.action), given).item() == 0.0
