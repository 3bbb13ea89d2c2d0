"""The configuration: composed by Hydra, validated, and its mistakes in one line each."""
