"""What runs in, or starts, the simulator: runner, benches, scoreboard, latency report."""
