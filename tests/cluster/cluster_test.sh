#!/usr/bin/env bash
# A build on a cluster: Slurm's daemons with four virtual nodes on this machine, Snakemake driving
# at least eight shards, and on the way one task killed, one cancelled and one node lost. The bundle
# must be that of a build in one process.  cluster_test.sh BIN_FOLDER
# Exit code 77: skipped, something that it needs is not installed (jobs/cluster/setup.sh).
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../.." && pwd)
bin=$(cd "$1" && pwd)
# Snakemake is Debian's, and so is its Python.
export PATH=/usr/bin:$PATH

for program in snakemake sbatch slurmctld slurmd munged; do
  if ! PATH=$PATH:/usr/sbin command -v $program >/dev/null; then
    echo "skipped: $program is not installed; jobs/cluster/setup.sh --with-slurm-daemons does it"
    exit 77
  fi
done
[ "$(id -u)" -eq 0 ] || { echo "skipped: Slurm's daemons need root"; exit 77; }

folder=$(mktemp -d /tmp/panofix_cluster.XXXXXX)
chmod 0755 "$folder"  # munge runs as its own user
engine=
cleanup() {
  [ -z "$engine" ] || kill -TERM "$engine" 2>/dev/null || true
  "$source_folder/tests/cluster/virtual_slurm.sh" stop "$folder/slurm" 2>/dev/null || true
  rm -rf "$folder"
}
trap cleanup EXIT
fail() {
  echo "FAILED: $*" >&2
  tail -n 60 "$folder/snakemake.log" >&2 || true
  exit 1
}

cd "$folder"
"$bin/panofix-town" --out town --seed 5 --panoramas 12 --no-drive --pano-width-px 640 \
  --frame-width-px 200 --frame-height-px 150 >town.log
options="--name town --sift-words 300 --mser-words 100 --station-spacing-m 6"
"$bin/panofix-builder" build --panoramas town/panoramas.geojson --camera town/camera.yaml \
  --out reference $options >reference.log 2>&1

# Tasks say where they run and give a test time to harm them.
mkdir tasks
cat >builder.sh <<SCRIPT
#!/usr/bin/env bash
echo "\${SLURM_JOB_ID:-0} \${SLURMD_NODENAME:-here} \$\$" >"$folder/tasks/\$1.\${SLURM_JOB_ID:-0}"
[ -z "\${SLURM_JOB_ID:-}" ] || sleep 3
exec "$bin/panofix-builder" "\$@"
SCRIPT
chmod +x builder.sh

export SLURM_CONF
SLURM_CONF=$("$source_folder/tests/cluster/virtual_slurm.sh" start "$folder/slurm" 4)

# CI=true: Snakemake then asks for its jobs every second, not every ten.
CI=true snakemake -s "$source_folder/jobs/Snakefile" --profile "$source_folder/jobs/profiles/slurm" \
  --config panoramas=town/panoramas.geojson camera=town/camera.yaml out=map \
  builder="$folder/builder.sh" threads=1 mb_per_thread=200 \
  options="$options --shard-level 21" >snakemake.log 2>&1 &
engine=$!

# A running task of the stage: its Slurm job, node and process.
task_of() {
  local file job node pid
  for _ in $(seq 600); do
    for file in tasks/"$1".*; do
      [ -s "$file" ] || continue
      read -r job node pid <"$file"
      if kill -0 "$pid" 2>/dev/null; then
        echo "$job $node $pid"
        return
      fi
    done
    kill -0 "$engine" 2>/dev/null || fail "the engine ended before a task of '$1' was seen"
    sleep 0.2
  done
  fail "no task of '$1' was seen"
}

read -r job node pid < <(task_of extract)
echo "killing task $job (extract) on $node"
kill -KILL "$pid"
read -r job node pid < <(task_of augment)
echo "cancelling task $job (augment) on $node"
scancel "$job"
read -r job node pid < <(task_of words)
echo "losing node $node with task $job (words)"
"$source_folder/tests/cluster/virtual_slurm.sh" lose "$folder/slurm" "$node"

code=0
wait "$engine" || code=$?
engine=
[ "$code" -eq 0 ] || fail "snakemake ended with exit code $code"
restarts=$(grep -c "Trying to restart job" snakemake.log || true)
shards=$(find map.work/plan/shards -name '*.stamp' | wc -l)
echo "$shards shards, $restarts tasks run again"
[ "$shards" -ge 8 ] || fail "only $shards shards"
[ "$restarts" -ge 3 ] || fail "only $restarts tasks were run again; three were harmed"
diff -r reference map || fail "the bundle is not the one-process build's"

# Another night in which nothing changed: the engine finds nothing to do but to look.
CI=true snakemake -s "$source_folder/jobs/Snakefile" --profile "$source_folder/jobs/profiles/slurm" \
  --config panoramas=town/panoramas.geojson camera=town/camera.yaml out=map \
  builder="$folder/builder.sh" threads=1 mb_per_thread=200 \
  options="$options --shard-level 21" >snakemake.log 2>&1 || fail "the second night failed"
if grep -E "^rule (extract|augment|words|landmarks|similarity):" snakemake.log; then
  fail "the second night made something again"
fi
diff -r reference map || fail "the second night changed the bundle"
echo "PASSED"
