"""Genetic programming: individuals, random trees, operators, archive, records."""
