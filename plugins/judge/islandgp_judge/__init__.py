"""Judges a language model by edits of recorded populations: `islandgp judge` (README.md)."""
