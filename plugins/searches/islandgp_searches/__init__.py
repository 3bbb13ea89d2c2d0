"""Searches to compare with: novelty search, NSGA-II, and the library without evolution."""
