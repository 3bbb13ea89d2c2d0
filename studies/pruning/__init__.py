"""Compares best robots before and after their shortening, in unseen worlds."""
