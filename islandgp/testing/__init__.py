"""Tests of the promises of a domain."""
