"""How fast is it: the benchmarks behind `make bench` and `docs/performance.md`.

Worlds, seeds and trees are pinned (`pinned`); what is compared runs in turns
(`turns`), so that a machine that is busy for a while is busy for both sides.
"""
