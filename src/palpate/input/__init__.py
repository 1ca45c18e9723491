"""From a frame as it arrives to a plausible one, with the sensor's true pose and the contact decided."""
