#!/usr/bin/env bash
# Runs one stage of a planned build for an engine: run_stage.sh BUILDER WORK ATTEMPT STAGE [OPTION …]
#
# Leaves the hash of the stage's receipt in WORK/done, for engines that look at files.
#
# An engine tries every failure again. What can never succeed (any exit code but 75, and deaths by a
# signal: memory, a node) is remembered in WORK/gave_up, so that further attempts end at once and
# the failure is reported with its own words. The last words of the others are in WORK/tried.
set -uo pipefail
[ $# -ge 4 ] || { echo "usage: run_stage.sh BUILDER WORK ATTEMPT STAGE [OPTION ...]" >&2; exit 64; }
builder=$1 work=$2 attempt=$3
shift 3
stage=$1 unit=all
case ${2:-} in --shard | --tile) unit=$3 ;; esac
note=$work/gave_up/$stage-$unit tried=$work/tried/$stage-$unit
if [ "$attempt" -gt 1 ] && [ -s "$note" ]; then
  cat "$note" >&2
  exit 65
fi
said=$(mktemp)
trap 'rm -f "$said"' EXIT
"$builder" "$@" --work "$work" 2> >(tee "$said" >&2)
code=$?
case $code in
  0)
    receipt=$work/receipts/$stage/$unit.json
    [ "$stage" = publish ] && receipt=$work/receipts/assemble/all.json
    mkdir -p "$work/done/$stage"
    rm -f "$tried"
    sha256sum <"$receipt" >"$work/done/$stage/.$unit.$$" &&
      mv "$work/done/$stage/.$unit.$$" "$work/done/$stage/$unit" || exit 75
    ;;
  75 | 129 | 130 | 137 | 143)
    mkdir -p "$work/tried"
    printf 'attempt %s, exit code %s: %s\n' "$attempt" "$code" "$(tail -n 1 "$said")" >"$tried"
    ;;
  *)
    mkdir -p "$work/gave_up"
    printf 'exit code %s: %s\n' "$code" "$(tail -n 1 "$said")" >"$note.$$" && mv "$note.$$" "$note"
    ;;
esac
exit $code
