"""The tree language: nodes, grammar, printer, vocabulary, and the engine that ticks a tree."""
