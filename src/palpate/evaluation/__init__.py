"""How well a recording was tracked, and what a recording is worth."""
