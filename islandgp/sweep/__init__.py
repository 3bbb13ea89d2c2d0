"""Sweeps: their folder, jobs, progress, and searches that choose the jobs."""
