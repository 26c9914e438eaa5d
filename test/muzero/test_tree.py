import numpy as np
import pytest

from portnav_ros.muzero.tree import (
    LEAST_PRIOR,
    Step,
    best_path,
    grow,
    new_leaves,
    new_tree,
    padded,
    plant,
    softmax,
)


def planted(value=10.0, actions=3, nodes=6):
    tree = new_tree(1, nodes, actions, 1)
    prior = np.zeros((1, padded(actions)), np.float32)
    prior[0, :actions] = 1.0 / actions
    plant(tree, prior, np.array([value], np.float32), np.zeros((1, 1), np.float32))
    return tree


def add(tree, node, parent, action, reward, discount, value):
    leaves = new_leaves(1, 1)
    leaves.parent[0], leaves.action[0] = parent, action
    numbers = (np.array([number], np.float32) for number in (reward, discount))
    latent, logits = np.full((1, 1), node, np.float32), np.zeros((1, 3), np.float32)
    grow(tree, node, leaves, Step(latent, *numbers, logits, np.array([value], np.float32)))


def test_a_reward_belongs_to_the_action_that_earns_it():
    """Three steps: root -(2)-> 1 -(30)-> 2 -(400)-> 3, discount a half."""
    tree = planted()
    add(tree, 1, 0, 1, 2.0, 0.5, 0.0)
    add(tree, 2, 1, 0, 30.0, 0.5, 0.0)
    add(tree, 3, 2, 2, 400.0, 0.5, 8.0)
    last = 400.0 + 0.5 * 8.0
    assert tree.q[0, 2, 2] == last
    assert tree.value[0, 2] == last / 2.0  # mean with the network's 0
    assert tree.q[0, 1, 0] == 30.0 + 0.5 * last / 2.0
    second = (30.0, 30.0 + 0.5 * last)
    assert tree.value[0, 1] == pytest.approx(sum(second) / 3.0)
    root = (10.0, 2.0, 2.0 + 0.5 * second[0], 2.0 + 0.5 * second[1])
    assert tree.value[0, 0] == pytest.approx(sum(root) / 4.0)
    assert tree.q[0, 0, 1] == pytest.approx(2.0 + 0.5 * sum(second) / 3.0)
    assert tree.visits[0, 0, 1] == 3
    assert tree.node_visits[0, 0] == 4.0


def test_nothing_comes_back_through_the_end_of_an_episode():
    tree = planted()
    add(tree, 1, 0, 0, -1000.0, 0.0, 777.0)
    add(tree, 2, 1, 1, 555.0, 0.9, 333.0)
    assert tree.q[0, 0, 0] == -1000.0
    assert tree.value[0, 0] == pytest.approx((10.0 - 2000.0) / 3.0)


def test_planting_forgets_the_last_tree():
    tree = planted()
    add(tree, 1, 0, 1, 2.0, 0.5, 0.0)
    add(tree, 2, 1, 0, 3.0, 0.5, 0.0)
    plant(tree, tree.prior[:, 0].copy(), np.array([4.0], np.float32), np.zeros((1, 1), np.float32))
    add(tree, 1, 0, 2, 1.0, 1.0, 1.0)
    assert tree.visits[0, 0].tolist() == [0, 0, 1, 0, 0, 0, 0, 0]
    assert tree.child[0, 0, :3].tolist() == [-1, -1, 1]
    assert (tree.child[0, 1] == -1).all()
    assert tree.value[0, 0] == 3.0


def test_softmax_of_any_logits():
    out = np.zeros(8, np.float32)
    for logits in ([0.0, 1.0, 2.0], [1e9, 0.0, -1e9], [-3e4, -3e4, -3e4]):
        exact = np.exp(np.array(logits) - max(logits))
        softmax(np.array(logits, np.float32), out)
        np.testing.assert_allclose(out[:3], np.maximum(exact / exact.sum(), LEAST_PRIOR), rtol=1e-6)
        assert (out[:3] >= LEAST_PRIOR).all()
        assert not out[3:].any()


def test_the_best_path_follows_visits():
    tree = planted(nodes=8)
    for node, parent, action in ((1, 0, 1), (2, 1, 0), (3, 1, 2), (4, 3, 1), (5, 0, 2)):
        add(tree, node, parent, action, 0.0, 1.0, 0.0)
    paths = np.empty((1, 5), np.int64)
    best_path(tree, np.array([1]), paths)
    assert paths[0].tolist() == [1, 2, 1, -1, -1]
    best_path(tree, np.array([0]), paths)
    assert paths[0].tolist() == [0, -1, -1, -1, -1]
