import numpy as np
import pytest

from portnav_ros.evaluation.benchmark_search_contender import random_state
from portnav_ros.muzero.inference import Beginning
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

    def begin(self, observation):
        return Beginning(observation, *self.predict(observation))

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

    def make(rng, features=20, latent=16, hidden=(32,), bins=11, alive=True):
        state = random_state(rng, features, latent, hidden, bins, (9, 3), alive)
        return state | {'value_atoms': np.linspace(-50.0, 50.0, bins, dtype=np.float32)}

    return make
