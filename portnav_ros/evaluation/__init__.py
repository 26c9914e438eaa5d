"""Episodes to figures: bags, metrics, plots, reports, benchmarks."""
