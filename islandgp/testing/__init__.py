"""Stand-ins for what a run asks outside of itself, for tests and for `make demo-llm`."""
