"""Plain data: frames, recordings, trajectories, sensors, measurements, estimates."""
