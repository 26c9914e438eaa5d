"""The MuZero local planner."""
