"""What every learning algorithm shares: scenarios, run directory, statistics, validation."""
