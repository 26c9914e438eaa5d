"""The world: scenarios, ports, traffic, ranging sensor, and their batched simulation."""
