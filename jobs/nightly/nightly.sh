#!/usr/bin/env bash
# One night: build, judge, and only then let vehicles see the new bundle.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: jobs/nightly/nightly.sh CONFIG

Builds a bundle, replays the drives that CONFIG names through it, and where every quality gate holds
makes it the one that FOLDER/current points at; the one before stays as FOLDER/previous. Where a
step fails, current stays as it was. A night that finds another still at work leaves at once.

CONFIG is a file of shell variables; see jobs/nightly/example.conf.

Exit codes: 0 done; 1 a quality gate does not hold; 75 another night is at work; otherwise the
builder's (panofix-builder --help).
TEXT
}

say() { printf '%s %s\n' "$(date -u +%FT%TZ)" "$*"; }
fail() {
  say "nightly.sh: $*" >&2
  exit "${code:-65}"
}

case ${1:-} in -h | --help) usage; exit 0 ;; esac
[ $# -eq 1 ] || { usage >&2; exit 64; }
[ -r "$1" ] || { echo "nightly.sh: $1: cannot be read; name the night's config" >&2; exit 66; }
name='' drives=() build_options=() gate_options=() snakemake_options=()
builder=panofix-builder engine=none keep_logs=30
# shellcheck source=/dev/null
. "$(realpath "$1")"
for setting in panoramas camera folder; do
  [ -n "${!setting:-}" ] || {
    echo "nightly.sh: $1: '$setting' is not set; write $setting=..." >&2
    exit 64
  }
done
mkdir -p "$folder/log" "$folder/bundles"
# An engine works from another folder.
folder=$(realpath "$folder") panoramas=$(realpath "$panoramas") camera=$(realpath "$camera")
case $builder in */*) builder=$(realpath "$builder") ;; esac

exec 9>"$folder/lock"
flock --nonblock 9 || {
  echo "nightly.sh: another night is at work in $folder; it is left alone" >&2
  exit 75
}
night=$(date -u +%Y%m%dT%H%M%SZ)
log=$folder/log/$night.log
exec > >(tee -a "$log") 2>&1
# Whatever ends the script, its last words are in the log.
trap 'code=$?; [ $code -eq 0 ] || say "the night failed with exit code $code; $folder/current stays"; exit $code' EXIT

# The build number only grows, whatever became of the file that keeps it.
before=$(readlink "$folder/current" || true)
last=$(cat "$folder/number" 2>/dev/null || echo 0)
[ "$last" -ge "${before##*/}" ] 2>/dev/null || last=${before##*/}
number=$((${last:-0} + 1))
candidate=$folder/bundles/$number
rm -rf "$candidate"  # of a night that failed
options=(--build "$number" --name "${name:-$(basename "$folder")}" "${build_options[@]}")
# A vocabulary is trained once; later nights reuse it, or every tile would change every night.
[ ! -e "$folder/vocabulary.h5" ] || options+=(--vocabulary "$folder/vocabulary.h5")
say "night $night: build $number of $panoramas"
case $engine in
  none)
    "$builder" build --panoramas "$panoramas" --camera "$camera" --out "$candidate" \
      --work "$folder/work" "${options[@]}"
    ;;
  snakemake)
    here=$(cd "$(dirname "$(realpath "$0")")/.." && pwd)
    (cd "$folder" && snakemake -s "$here/Snakefile" --profile "$here/profiles/${profile:-local}" \
      --config panoramas="$panoramas" camera="$camera" out="$candidate" work="$folder/work" \
      builder="$builder" options="${options[*]}" "${snakemake_options[@]}")
    ;;
  *) code=64 fail "engine=$engine: unknown; none or snakemake" ;;
esac

for drive in "${drives[@]}"; do
  say "quality gate: $drive"
  code=0
  "$builder" validate "$candidate" --drive "$drive" --json "$folder/log/$night.$(basename "$drive").json" \
    "${gate_options[@]}" || code=$?
  [ $code -eq 0 ] || fail "$candidate does not pass on $drive; it is kept for a look"
done
[ ${#drives[@]} -gt 0 ] || say "no drives are named: nothing was judged"

# One rename each; who opened the old bundle keeps it.
point() {
  ln -sfn "$2" "$folder/.$1.new"
  mv -T "$folder/.$1.new" "$folder/$1"
}
[ -z "$before" ] || point previous "$before"
point current "bundles/$number"
printf '%s\n' "$number" >"$folder/number.new" && mv "$folder/number.new" "$folder/number"
[ -e "$folder/vocabulary.h5" ] || cp "$candidate/vocabulary.h5" "$folder/vocabulary.h5"
say "night $night: $folder/current is build $number"

# Older bundles and logs go; what current and previous point at stays.
for old in "$folder"/bundles/*/; do
  old=bundles/$(basename "$old")
  [ "$old" = "bundles/$number" ] || [ "$old" = "$before" ] || rm -rf "${folder:?}/$old" "${folder:?}/$old.report.json"
done
find "$folder/log" -name '*.log' -printf '%f\n' | sort -r | tail -n +$((keep_logs + 1)) |
  while read -r old; do rm -f "$folder/log/${old%.log}".*; done
