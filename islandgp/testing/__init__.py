"""Test doubles for external services, for tests and `make demo-llm`, and tests of domains."""
