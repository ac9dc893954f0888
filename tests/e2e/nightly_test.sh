#!/usr/bin/env bash
# Nights in a row over a small town: publish, keep, refuse, lock.  nightly_test.sh BIN_FOLDER
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../.." && pwd)
bin=$(cd "$1" && pwd)
folder=$(mktemp -d /tmp/panofix_nightly.XXXXXX)
trap 'rm -rf "$folder"' EXIT
fail() {
  echo "FAILED: $*" >&2
  cat "$folder"/city/log/*.log >&2 || true
  exit 1
}
cd "$folder"
"$bin/panofix-town" --out town --seed 4 --panoramas 4 --spacing-m 8 --pano-width-px 1600 --frames 4 \
  --frame-width-px 400 --frame-height-px 300 --same-light >/dev/null 2>&1
write_config() {
  cat >city.conf <<TEXT
panoramas=$folder/${1:-town/panoramas.geojson}
camera=$folder/town/camera.yaml
folder=$folder/city
drives=($folder/town/drive)
gate_options=(--min-share-1m ${2:-0.5})
build_options=(--sift-words 500 --mser-words 200 --station-spacing-m 5)
builder=$bin/panofix-builder
TEXT
}
night() { "$source_folder/jobs/nightly/nightly.sh" city.conf >out.log 2>&1; }

write_config
night || fail "the first night failed"
[ "$(readlink city/current)" = bundles/1 ] || fail "current is not build 1"
[ ! -e city/previous ] || fail "previous is there before there was one"
[ -s city/vocabulary.h5 ] || fail "no vocabulary release is kept"

night || fail "the second night failed"
[ "$(readlink city/current)" = bundles/2 ] || fail "current is not build 2"
[ "$(readlink city/previous)" = bundles/1 ] || fail "previous is not build 1"
for part in vocabulary.h5 graph.h5 tiles; do
  diff -r city/bundles/1/$part city/bundles/2/$part || fail "$part changed in a night without news"
done

write_config town/panoramas.geojson 1
sed -i 's/--min-share-1m 1/--min-share-1m 1 --min-fix-share 1 --max-false-fix-share 0/' city.conf
sed -i "s|drives=.*|drives=($folder/town/drive $folder/nowhere)|" city.conf
code=0; night || code=$?
[ $code -ne 0 ] || fail "a drive that is not there was passed"
[ "$(readlink city/current)" = bundles/2 ] || fail "a refused night moved current"

write_config
(
  exec 9>city/lock
  flock 9
  code=0; night || code=$?
  [ $code -eq 75 ] || fail "two nights at once: exit code $code"
)
code=0; "$source_folder/jobs/nightly/nightly.sh" nowhere.conf 2>/dev/null || code=$?
[ $code -eq 66 ] || fail "a missing config: exit code $code"

night || fail "the third good night failed"
[ "$(readlink city/current)" = bundles/3 ] || fail "current is not build 3"
[ ! -e city/bundles/1 ] || fail "build 1 was not cleared away"
[ -e city/bundles/2 ] || fail "the previous build was cleared away"

# A lost number takes no build back; paths count from here; a map has the name that vehicles ask for.
rm city/number
sed -i "s|$folder/town|town|; \$a name=ville" city.conf
night || fail "the night without a number failed"
[ "$(readlink city/current)" = bundles/4 ] || fail "current is not build 4"
grep -q '"name": *"ville"' city/current/manifest.json || fail "the map's name is not the config's"
echo PASSED
