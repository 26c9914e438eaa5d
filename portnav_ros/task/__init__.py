"""The task as reinforcement learning sees it: observation, actions, reward, environment."""
