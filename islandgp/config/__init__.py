"""The configuration: composed by Hydra, validated, with one-line error messages."""
