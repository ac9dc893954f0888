#!/usr/bin/env bash
# From a fresh clone to scored poses: builds panofix, renders a small town, builds its map, localizes a
# drive through it over real sockets, and scores the answers against the exact truth.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: jobs/quickstart.sh [--seed N] [--panoramas N] [--frames N] [--rate HZ] [--keep]

Everything lands in out/quickstart: town/ (panoramas, drive, truth), bundle/ (the map), poses.csv,
birdseye.svg (the drive over the map) and one log a step.

  --seed N       another town (default 7)
  --panoramas N  panoramas along its streets (default 14)
  --frames N     camera frames of the drive (default 25)
  --rate HZ      frames a second that the camera publishes (default 1)
  --keep         go on from what an earlier run left: the map's build resumes instead of starting anew
TEXT
}

fail() {
  echo "quickstart.sh: $*" >&2
  exit 1
}

number() {  # OPTION VALUE: the value, if it is a positive number
  [[ "${2:-}" =~ ^[0-9]+(\.[0-9]+)?$ ]] || fail "$1 needs a number; see --help"
  echo "$2"
}

seed=7 num_panoramas=14 num_frames=25 rate_hz=1 keep=false
while [ $# -gt 0 ]; do
  case "$1" in
    --seed) seed=$(number "$@"); shift 2 ;;
    --panoramas) num_panoramas=$(number "$@"); shift 2 ;;
    --frames) num_frames=$(number "$@"); shift 2 ;;
    --rate) rate_hz=$(number "$@"); shift 2 ;;
    --keep) keep=true; shift ;;
    -h | --help) usage; exit 0 ;;
    *) usage >&2; fail "unknown argument '$1'" ;;
  esac
done

cd "$(dirname "$(readlink -f "$0")")/.."
out=out/quickstart
town=$out/town
bin=build/dev/bin
mkdir -p "$out"

pids=()
stop_all() {
  local pid
  for pid in "${pids[@]}"; do kill -TERM "$pid" 2>/dev/null || true; done
  for pid in "${pids[@]}"; do wait "$pid" 2>/dev/null || true; done
  pids=()
}
trap stop_all EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# step NAME COMMAND...: runs it into out/quickstart/NAME.log and prints its time, or the log's end if it
# fails. The shell's -e does not reach inside: functions that are steps pass failures on themselves.
step() {
  local name=$1 log=$out/$1.log start end
  shift
  printf '%-12s ' "$name"
  start=$(date +%s%N)
  if ! "$@" >"$log" 2>&1; then
    echo failed
    tail -n 15 "$log" >&2
    fail "step '$name' failed; its whole log is $log"
  fi
  end=$(date +%s%N)
  printf '%6d.%d s\n' $(((end - start) / 1000000000)) $(((end - start) / 100000000 % 10))
}

build_programs() {
  cmake --preset dev && cmake --build --preset dev -j "$(nproc)" \
    --target panofix-builder panofix-runtime panofix-town
}

render_town() {
  local arguments=(--seed "$seed" --panoramas "$num_panoramas" --frames "$num_frames") stamp
  stamp="${arguments[*]} $(sha256sum <"$bin/panofix-town")"
  if [ -f "$town/town.json" ] && [ "$(cat "$out/town.stamp" 2>/dev/null)" = "$stamp" ]; then
    echo "the town of these arguments is there already"
    return
  fi
  rm -rf "$town" "$out/town.stamp"
  "$bin/panofix-town" --out "$town" "${arguments[@]}" && echo "$stamp" >"$out/town.stamp"
}

is_open() { (exec 3<>"/dev/tcp/127.0.0.1/$1") 2>/dev/null; }

free_port() {  # a port that nobody listens on; not below 20000, not in the kernel's range for clients
  local port
  for _ in $(seq 100); do
    port=$((20000 + RANDOM % 10000))
    if [ "$port" != "${1:-}" ] && ! is_open "$port"; then
      echo "$port"
      return
    fi
  done
  fail "no free port between 20000 and 30000; close some programs"
}

wait_for_port() {  # PORT PID: until the program listens
  for _ in $(seq 600); do
    is_open "$1" && return
    kill -0 "$2" 2>/dev/null || { echo "the runtime stopped"; return 1; }
    sleep 0.1
  done
  echo "the runtime did not open its port within a minute"
  return 1
}

drive_through() {
  local frames_port poses_port serve_pid record_pid rows
  frames_port=$(free_port) && poses_port=$(free_port "$frames_port") || return 1
  rows=$(($(wc -l <"$town/drive/frames.csv") - 1))
  rm -f "$out/poses.csv" "$out/runtime.json"
  "$bin/panofix-runtime" serve --bundle "$out/bundle" --frames "tcp://127.0.0.1:$frames_port" \
    --poses "tcp://127.0.0.1:$poses_port" >"$out/serve.log" 2>&1 &
  serve_pid=$!
  pids+=("$serve_pid")
  wait_for_port "$poses_port" "$serve_pid" || { tail -n 5 "$out/serve.log"; return 1; }
  "$bin/panofix-runtime" record --poses "tcp://127.0.0.1:$poses_port" --out "$out/poses.csv" \
    --log "$out/runtime.json" --count "$rows" >"$out/record.log" 2>&1 &
  record_pid=$!
  pids+=("$record_pid")
  sleep 1  # its subscription reaches the runtime
  "$bin/panofix-runtime" play --drive "$town/drive" --bind "tcp://127.0.0.1:$frames_port" \
    --rate "$rate_hz" --wait-for-subscriber &
  pids+=($!)  # in the background, so that a signal to this script is acted on at once
  wait $! || { tail -n 5 "$out/serve.log"; return 1; }
  # A slow machine answers the newest frame and leaves some out: the recorder is then told to stop.
  for _ in $(seq 100); do
    kill -0 "$record_pid" 2>/dev/null || break
    sleep 0.1
  done
  stop_all
  [ -s "$out/poses.csv" ] || { tail -n 5 "$out/serve.log" "$out/record.log"; return 1; }
}

score() {
  "$bin/panofix-builder" score --poses "$out/poses.csv" --drive "$town/drive" \
    --bundle "$out/bundle" --log "$out/runtime.json" --picture "$out/birdseye.svg"
}

jobs/install_dependencies.sh
step compile build_programs
step town render_town
$keep || rm -rf "$out/bundle"
step map "$bin/panofix-builder" build --panoramas "$town/panoramas.geojson" \
  --camera "$town/camera.yaml" --out "$out/bundle"
step drive drive_through
step score score
echo
cat "$out/score.log"
echo
echo "map      $out/bundle ($(du -sh "$out/bundle" | cut -f1))"
echo "poses    $out/poses.csv"
echo "picture  $out/birdseye.svg"
