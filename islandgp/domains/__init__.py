"""Worlds for robots. Configuration names them; no other module of the package does."""
