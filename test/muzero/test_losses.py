"""Losses: what they count, what they leave out, and that rows do not touch each other."""

import math

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.atoms import AtomParams, two_hot  # noqa: E402
from portnav_ros.muzero.losses import (  # noqa: E402
    LESSON_TEMPERATURE,
    REGRET_SCALE,
    TERMS,
    Batch,
    Unrolled,
    expectation,
    halve_gradient,
    imitation_loss,
    lesson_loss,
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
        lesson=torch.argsort(draw(count, steps + 1, ACTIONS), -1)[..., :4],
        regret=50.0 * draw(count, steps + 1, 4).abs(),
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


def loss_of(name, net, given):
    """A term of what the networks say along the actions, and of the actions of the lessons."""
    return TERMS[name](net, unroll(net, given.features, given.action, given.lesson[:, 0]), given)


@pytest.mark.parametrize('name', TERMS)
def test_rows_do_not_touch_each_other(name):
    net, given = network(), batch(count=3)
    apart = [loss_of(name, net, Batch(*(item[i : i + 1] for item in given))) for i in range(3)]
    assert min(apart) > 0.0
    torch.testing.assert_close(loss_of(name, net, given), torch.stack(apart).mean())


@pytest.mark.parametrize('name', TERMS)
def test_masked_positions_teach_nothing(name):
    net, given = network(), batch()
    mask = torch.tensor([[0.0] * 4, [1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [1.0] * 4])
    masked = given._replace(live=mask, trained=mask)
    other = masked._replace(
        reward=masked.reward + 500.0 * (1.0 - mask[:, :-1]),
        value=masked.value - 500.0 * (1.0 - mask),
        policy=torch.where(mask[..., None] > 0, masked.policy, 1.0 / ACTIONS),
        going_on=torch.where(mask[:, :-1] > 0, masked.going_on, 0.0),
        regret=masked.regret * (2.0 - mask[..., None]),
    )
    assert loss_of(name, net, masked).item() == loss_of(name, net, other).item() > 0.0
    everywhere = masked._replace(live=torch.ones(4, 4), trained=torch.ones(4, 4))
    changed = other._replace(live=torch.ones(4, 4), trained=torch.ones(4, 4))
    assert loss_of(name, net, everywhere).item() != loss_of(name, net, changed).item()


def test_uniform_policy_costs_the_logarithm_of_the_actions():
    torch.manual_seed(0)
    fresh, given = Network(FEATURES, HEADINGS, SPEEDS, NetworkParams()), batch()
    said = unroll(fresh, given.features, given.action)
    assert TERMS['policy'](fresh, said, given).item() == pytest.approx(2.0 * math.log(ACTIONS), rel=1e-5)


def test_a_network_without_that_head_has_no_alive_loss():
    net, given = network(alive=False), batch()
    assert TERMS['alive'](net, unroll(net, given.features, given.action), given).item() == 0.0


def told(logits, lesson, regret):
    """What N root decisions cost: logits [N, A], actions valued [N, C] and their regret [N, C]."""
    count = len(logits)
    live = torch.ones(count, 1)
    said = Unrolled(logits[:, None], torch.zeros(count, 1, 3), torch.zeros(count, 0, 3), None)
    given = batch(count, 0)._replace(
        lesson=torch.tensor(lesson)[:, None], regret=torch.tensor(regret)[:, None], live=live
    )
    return lesson_loss(network(), said, given) + 0.5 * imitation_loss(network(), said, given)


def test_a_lesson_costs_expected_regret_and_half_a_cross_entropy():
    logits = torch.tensor([[0.7, 9.0, -0.4]])
    loss = told(logits, [[0, 2]], [[0.0, 12.0]])
    first = 1.0 / (1.0 + math.exp(-0.4 - 0.7))  # chance of the first among the two that were valued
    wanted = 1.0 / (1.0 + math.exp(-12.0 / LESSON_TEMPERATURE))
    entropy = -wanted * math.log(first) - (1.0 - wanted) * math.log(1.0 - first)
    assert loss.item() == pytest.approx(12.0 * (1.0 - first) / REGRET_SCALE + 0.5 * entropy, rel=1e-5)


def test_actions_that_were_not_valued_are_left_alone():
    logits = torch.zeros(1, 3, requires_grad=True)
    told(logits, [[0, 2]], [[0.0, 12.0]]).backward()
    assert logits.grad[0, 1].item() == 0.0
    assert logits.grad[0, 0].item() < 0.0 < logits.grad[0, 2].item()


def test_a_decision_without_a_lesson_teaches_nothing():
    logits = torch.tensor([[0.7, -0.4], [0.1, 0.2]], requires_grad=True)
    loss = told(logits, [[0, 1], [-1, -1]], [[0.0, 40.0], [0.0, 0.0]])
    loss.backward()
    assert loss.item() == pytest.approx(0.5 * told(logits[:1], [[0, 1]], [[0.0, 40.0]]).item())
    assert (logits.grad[1] == 0.0).all()
    assert (logits.grad[0] != 0.0).all()


def test_a_run_that_is_not_taught_has_no_lesson_loss():
    given = batch()._replace(lesson=torch.zeros(4, 4, 0, dtype=torch.int64), regret=torch.zeros(4, 4, 0))
    net = network()
    said = unroll(net, given.features, given.action)
    assert lesson_loss(net, said, given).item() == imitation_loss(net, said, given).item() == 0.0


def learned_from(lesson, regret, start, steps=400):
    """The policy [A] after gradient descent on decisions that the network cannot tell apart."""
    logits = torch.tensor(start, requires_grad=True)
    for _ in range(steps):
        (gradient,) = torch.autograd.grad(told(logits.expand(len(lesson), -1), lesson, regret), logits)
        with torch.no_grad():
            logits -= 0.5 * gradient
    return torch.softmax(logits, -1).detach()


def test_the_gradient_lowers_the_regret_of_a_policy_sure_of_a_wrong_action():
    policy = learned_from([[0, 1, 2]], [[300.0, 0.0, 20.0]], start=[8.0, -2.0, 0.0])
    assert float(policy @ torch.tensor([300.0, 0.0, 20.0])) < 3.0


def test_what_no_sensor_tells_is_averaged_before_choosing():
    """Worth (0, -100) or (-30, -30) as a coin falls: the second action is the better bet of the two.

    The best action of a row is the first as often as the second, so that a cross-entropy to it alone
    would be undecided.
    """
    policy = learned_from([[0, 1], [0, 1]], [[0.0, 30.0], [70.0, 0.0]], start=[1.0, 0.0])
    assert policy[1] > 0.8
