"""Proposals: the further hypotheses that an event makes necessary, a file for each origin."""
