#!/usr/bin/env bash
# Installs what is missing, configures, builds and runs every test. Works from any folder.
set -eu

if [ "${1:-}" = -h ] || [ "${1:-}" = --help ]; then
  echo "usage: tests/run.sh [PRESET [CTEST ARGUMENT ...]]"
  echo "PRESET: ci (default; warnings are errors), dev, asan, tsan. Example: tests/run.sh dev -R common_io"
  exit 0
fi
preset=${1:-ci}
[ $# -eq 0 ] || shift
cd "$(dirname "$(readlink -f "$0")")/.."
jobs/install_dependencies.sh
cmake --preset "$preset"
cmake --build --preset "$preset" -j "$(nproc)"
exec ctest --preset "$preset" -j "$(nproc)" "$@"
