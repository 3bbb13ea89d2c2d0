"""Runs under adverse conditions: `make torture`."""
