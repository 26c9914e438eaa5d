import dataclasses
import itertools
import signal

import numpy as np
import pytest
from hypothesis import settings

from portnav_ros.muzero.model_file import Card, save_model
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.env import TaskParams
from portnav_ros.vessel import VesselParams

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background shell, and so in children

# Kernels compile within the first example of a property, and a failure must come again in the next run.
settings.register_profile('portnav', deadline=None, derandomize=True)
settings.load_profile('portnav')

LATENT, HIDDEN, BINS = 8, 16, 11


@pytest.fixture(scope='session')
def random_tensors():
    """Make the weights of a small MuZero network for a task, of ordinary size and drawn at random."""

    def make(task, seed=0):
        generator = np.random.default_rng(seed)
        headings, speeds = len(task.actions.heading_change_rad), len(task.actions.speed_mps)
        tensors = {}

        def linear(name, inputs, outputs):
            tensors[f'{name}.weight'] = generator.normal(0.0, 1.0, (outputs, inputs)) / np.sqrt(inputs)
            tensors[f'{name}.bias'] = generator.normal(0.0, 0.1, outputs)

        def norm(name, size):
            tensors[f'{name}.weight'] = generator.uniform(0.5, 1.5, size)
            tensors[f'{name}.bias'] = generator.normal(0.0, 0.1, size)

        for part, inputs in (
            ('representation', task.observation.size),
            ('dynamics', LATENT + headings + speeds),
            ('prediction', LATENT),
        ):
            linear(f'{part}.body.0.linear', inputs, HIDDEN)
            norm(f'{part}.body.0.norm', HIDDEN)
        for part in ('representation', 'dynamics'):
            linear(f'{part}.out', HIDDEN, LATENT)
            norm(f'{part}.norm', LATENT)
        linear('dynamics.reward', HIDDEN, BINS)
        linear('dynamics.alive', HIDDEN, 1)
        linear('prediction.policy', HIDDEN, headings * speeds)
        linear('prediction.value', HIDDEN, BINS)
        tensors['reward_atoms'] = tensors['value_atoms'] = np.linspace(-100.0, 100.0, BINS)
        return {name: tensor.astype(np.float32) for name, tensor in tensors.items()}

    return make


@pytest.fixture(scope='session')
def make_model(tmp_path_factory, random_tensors):
    """Save a model with random weights; return its path."""

    def make(task=None, seed=0, vessel=None, lidar=None, **fields):
        task = task or TaskParams()
        card = Card(
            algorithm='muzero',
            task=task,
            vessel=vessel or VesselParams(),
            lidar=lidar or LidarParams(),
            discount=0.99,
            network={'latent': LATENT},
            search={'simulations': 8},
            training={'steps': 0},
        )
        path = tmp_path_factory.mktemp('models') / 'muzero.safetensors'
        save_model(path, random_tensors(task, seed), dataclasses.replace(card, **fields))
        return path

    return make


@pytest.fixture(scope='session')
def make_ppo_model(tmp_path_factory):
    """Save a PPO model with random weights; return its path."""

    def make(task=None, hidden=(8, 6), **fields):
        task = task or TaskParams()
        generator = np.random.default_rng(0)
        widths = (task.observation.size, *hidden, task.actions.count)
        tensors = {}
        for index, (inputs, outputs) in enumerate(itertools.pairwise(widths)):
            weight = generator.normal(0.0, 1.0, (outputs, inputs)) / np.sqrt(inputs)
            tensors[f'policy.{index}.weight'] = weight.astype(np.float32)
            tensors[f'policy.{index}.bias'] = generator.normal(0.0, 0.1, outputs).astype(np.float32)
        card = Card('ppo', task, VesselParams(), LidarParams(), 0.99, {'hidden': hidden})
        path = tmp_path_factory.mktemp('models') / 'ppo.safetensors'
        save_model(path, tensors, dataclasses.replace(card, **fields))
        return path

    return make
