"""What is recorded, without any file format: frames, recordings, trajectories, sensors, images, measurements."""
