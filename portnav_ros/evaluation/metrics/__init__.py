"""What is measured of an episode: one metric per file, listed in `table`."""
