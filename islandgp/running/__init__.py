"""Runs and sweeps: everything with side effects, from the command line to the summary."""
