"""Proofs of rules about trees: `islandgp verify-tree` (README.md)."""
