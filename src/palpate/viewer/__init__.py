"""Runs and recordings shown: in Rerun, live and afterwards, and on a page of their own."""
