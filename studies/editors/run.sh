#!/bin/sh
# The seventh study: `make study-editors`. The plan is in studies/log.md. Takes the folder of python.
# --force: the editor and its main control have 30 seeds, the other arms 15.
set -e
BIN=$1
CONF="--config-dir studies/conf"
RUN="$BIN/python -m islandgp $CONF experiment=study name=study7 progress=plain -m"
OTHERS='seed=range(8500,8515)'
$RUN 'seed=range(8500,8530)' supervisor=editor,editor_random_branch library=single
$RUN "$OTHERS" supervisor=expert library=single
$RUN "$OTHERS" supervisor=baseline
$RUN "$OTHERS" supervisor=editor_random_tree,editor_constant library=single
$RUN "$OTHERS" supervisor=editor_yoked library=single supervisor.policy.first=8500 supervisor.policy.seeds=15 \
  'supervisor.policy.record="runs/study7/editor-seed{seed}-library=single"'
$RUN "$OTHERS" supervisor=expert library=combined
$RUN "$OTHERS" supervisor=baseline gp.founders=true library=single
$RUN "$OTHERS" supervisor=fixed
$RUN "$OTHERS" supervisor=baseline search=compose library=single
"$BIN/islandgp" compare $CONF runs/study7 --primary first_descendant.complete --force -o studies/editors/results \
  --arm editor="supervisor=editor" --arm random_branch="supervisor=editor_random_branch" \
  --arm random_tree="supervisor=editor_random_tree" --arm constant="supervisor=editor_constant" \
  --arm yoked="supervisor=editor_yoked" --arm expert="supervisor=expert library.trees.pickup=[single_pickup]" \
  --arm combined="supervisor=expert library.trees.pickup=[pickup_specialist]" \
  --arm founders="supervisor=baseline gp.founders=true" --arm fixed="supervisor=fixed" \
  --arm baseline="supervisor=baseline gp.founders=false search=paper" --arm compose="search=compose"
(cd runs/study7 && sha256sum */lineage.csv */best.bt) > studies/editors/results/digests.txt
