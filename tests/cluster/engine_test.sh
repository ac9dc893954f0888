#!/usr/bin/env bash
# Snakemake on this machine alone: killed with -9 half-way it goes on; what can never succeed is
# tried once and reported, and the rest is built.  engine_test.sh BIN_FOLDER
# Exit code 77: skipped, Snakemake is not installed (jobs/cluster/setup.sh).
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../.." && pwd)
bin=$(cd "$1" && pwd)
export PATH=/usr/bin:$PATH
command -v snakemake >/dev/null || { echo "skipped: snakemake is not installed"; exit 77; }
folder=$(mktemp -d /tmp/panofix_engine.XXXXXX)
trap 'rm -rf "$folder"' EXIT
fail() {
  echo "FAILED: $*" >&2
  tail -n 60 "$folder/snakemake.log" >&2 || true
  exit 1
}
cd "$folder"
"$bin/panofix-town" --out town --seed 5 --panoramas 8 --no-drive --pano-width-px 640 \
  --frame-width-px 200 --frame-height-px 150 >town.log 2>&1
options="--name town --sift-words 300 --mser-words 100 --station-spacing-m 6"
"$bin/panofix-builder" build --panoramas town/panoramas.geojson --camera town/camera.yaml \
  --out reference $options >reference.log 2>&1
engine() {
  snakemake -s "$source_folder/jobs/Snakefile" --profile "$source_folder/jobs/profiles/local" \
    --config panoramas=town/panoramas.geojson camera=town/camera.yaml out=map threads=1 \
    mb_per_thread=200 builder="${builder:-$bin/panofix-builder}" \
    options="$options --shard-level 21" "$@" >>snakemake.log 2>&1
}

engine &
pid=$!
for _ in $(seq 600); do
  [ -n "$(ls map.work/done/extract 2>/dev/null)" ] && break
  sleep 0.1
done
kill -KILL $pid $(ps -o pid= --ppid $pid) 2>/dev/null || true
wait $pid 2>/dev/null || true
[ ! -e map ] || fail "the build was over before it was killed"
engine --unlock || fail "cannot be unlocked"
engine || fail "does not go on after kill -9"
diff -r reference map || fail "the bundle is not the one-process build's"

# A shard whose stage always finds bad data: once is enough, and the others are done.
shard=$(ls map.work/plan/shards | head -n 1 | cut -d. -f1)
cat >broken.sh <<SCRIPT
#!/usr/bin/env bash
if [ "\$1" = extract ] && [[ "\$*" == *"$shard"* ]]; then
  echo once >>"$folder/tries"
  echo "panofix-builder: pano-00000: a fault of its own" >&2
  exit 65
fi
exec "$bin/panofix-builder" "\$@"
SCRIPT
chmod +x broken.sh
rm -rf map map.work .snakemake
: >snakemake.log
code=0
builder=$folder/broken.sh engine || code=$?
[ $code -ne 0 ] || fail "a broken shard was built"
[ "$(wc -l <tries)" -eq 1 ] || fail "what cannot succeed was tried $(wc -l <tries) times"
grep -q "gave up extract-$shard: exit code 65: panofix-builder: pano-00000: a fault of its own" \
  snakemake.log || fail "the reason is not reported"
shards=$(ls map.work/plan/shards/*.stamp | wc -l)
[ "$(ls map.work/done/extract | wc -l)" -eq $((shards - 1)) ] || fail "the other shards were not done"
[ ! -e map ] || fail "half a city was published"
echo PASSED
