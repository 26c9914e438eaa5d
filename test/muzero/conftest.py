import numpy as np
import pytest

from portnav_ros.muzero.tree import Step


class TabularModel:
    """A finite decision process as a model: the latent is the number of the state."""

    def __init__(self, logits, value, reward, discount, following):
        """Tables [S, A], the value [S], and the following state [S, A]."""
        tables = logits, value, reward, discount
        self.logits, self.value, self.reward, self.discount = (np.asarray(t, np.float32) for t in tables)
        self.following = np.asarray(following)

    @classmethod
    def random(cls, rng, states, actions):
        shape = states, actions
        return cls(
            logits=(2.0 * rng.standard_normal(shape)).round(3),
            value=(10.0 * rng.standard_normal(states)).round(3),
            reward=rng.standard_normal(shape).round(3),
            discount=rng.choice([0.0, 0.95, 0.97, 0.99], shape),
            following=rng.integers(0, states, shape),
        )

    def represent(self, observation):
        return observation

    def predict(self, latent):
        state = latent[:, 0].astype(int)
        return self.logits[state], self.value[state]

    def step(self, latent, action):
        edge = latent[:, 0].astype(int), action
        state = self.following[edge]
        latent = state[:, None].astype(np.float32)
        return Step(latent, self.reward[edge], self.discount[edge], *self.predict(latent))


@pytest.fixture
def tabular():
    return TabularModel


@pytest.fixture
def network_state():
    """A state dict of the networks' shape with random numbers, as numpy arrays."""

    def make(rng, features=20, latent=16, hidden=(32,), bins=11, alive=True, grid=(9, 3)):
        state = {}

        def linear(name, inputs, outputs):
            state[f'{name}.weight'] = rng.standard_normal((outputs, inputs)) / np.sqrt(inputs)
            state[f'{name}.bias'] = 0.1 * rng.standard_normal(outputs)

        def norm(name, size):
            state[f'{name}.weight'] = 1.0 + 0.1 * rng.standard_normal(size)
            state[f'{name}.bias'] = 0.1 * rng.standard_normal(size)

        def body(name, inputs):
            for i, (size, outputs) in enumerate(zip((inputs, *hidden), hidden, strict=False)):
                linear(f'{name}.body.{i}.linear', size, outputs)
                norm(f'{name}.body.{i}.norm', outputs)

        body('representation', features)
        body('dynamics', latent + sum(grid))
        body('prediction', latent)
        heads = {'representation.out': latent, 'dynamics.out': latent, 'dynamics.reward': bins}
        heads |= {'prediction.policy': grid[0] * grid[1], 'prediction.value': bins}
        for name, outputs in (heads | ({'dynamics.alive': 1} if alive else {})).items():
            linear(name, hidden[-1], outputs)
        norm('representation.norm', latent)
        norm('dynamics.norm', latent)
        state['reward_atoms'] = np.linspace(-5.0, 5.0, bins)
        state['value_atoms'] = np.linspace(-50.0, 50.0, bins)
        return {name: array.astype(np.float32) for name, array in state.items()}

    return make
