"""The same episode from the usual parts: py_trees, pymunk, numpy, DEAP.

This is how the libraries' own documentation puts things together: the tree is
ticked in every step, the bodies are read one by one, what is in sight is asked
of numpy in every step, and a batch of episodes goes through DEAP's toolbox to a
pool of processes. The rules of the island are those of `islandgp.domains.island`, and
nothing here is slow on purpose. What is shared with it is what this benchmark
is not about: the day's schedule, the space and its contacts, the way around rocks,
the account of fitness.
"""
