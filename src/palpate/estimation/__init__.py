"""A factor graph over a sliding window: variables, factors, generated derivatives and block elimination. No physics."""
