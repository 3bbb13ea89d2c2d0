#!/bin/sh
# Controls of the expert: `make ablations`, after `make study`. Takes the folder of python.
set -e
BIN=$1
CONF='--config-dir studies/conf'
SEEDS='seed=range(7500,7530)'
RUN="$BIN/python -m islandgp $CONF $SEEDS progress=plain -m"
LIBRARY='library.folder=grammar/examples gp.founders=false' # arms differ in their library as a whole
$RUN experiment=ablation_another_record supervisor.policy.first=7500 supervisor.policy.seeds=30 \
  'supervisor.policy.record="runs/study/expert-seed{seed}"'
for part in rate_only injection_only random_injection combined founders; do
  $RUN experiment=ablation_$part
done
"$BIN/islandgp" compare $CONF --arm expert="name=study supervisor=expert $SEEDS $LIBRARY" \
  --arm baseline="name=study supervisor=baseline $SEEDS $LIBRARY" \
  --arm blind="name=ablation_random_injection $SEEDS $LIBRARY" \
  --arm yoked="name=ablation_another_record $SEEDS $LIBRARY" \
  --arm trees="name=ablation_injection_only $SEEDS $LIBRARY" \
  --arm rate="name=ablation_rate_only $SEEDS $LIBRARY" \
  --arm combined="name=ablation_combined $SEEDS $LIBRARY" \
  --arm founders="name=ablation_founders $SEEDS library.folder=grammar/examples gp.founders=true" \
  --primary first.complete --worlds 30 -o studies/controls/results
