#!/bin/sh
# The paper's experiment: `make study`. Takes the folder of python.
set -e
BIN=$1
CONF='--config-dir studies/conf'
"$BIN/python" -m islandgp $CONF experiment=study 'seed=range(7500,7530)' supervisor=baseline,expert progress=plain -m
"$BIN/islandgp" compare $CONF --arm expert="supervisor=expert" --arm baseline="supervisor=baseline" runs/study \
  --primary first.complete -o studies/paper/results
"$BIN/python" -m studies.paper.claims
"$BIN/python" -m studies.paper.trees
