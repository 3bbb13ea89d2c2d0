"""The domains of the package. Only the configuration names them, no other module."""
