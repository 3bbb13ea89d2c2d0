"""Numbers of trees by CMA-ES: `search=decision_list` and `islandgp tune`."""
