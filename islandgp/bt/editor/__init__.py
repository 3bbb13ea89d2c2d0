"""Editing of tree files: completion, meanings of names, canonical format."""
