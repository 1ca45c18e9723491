"""What of a stream of frames can be believed, before anything is estimated from it."""
