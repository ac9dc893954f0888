#!/usr/bin/env bash
# Installs the Debian packages that panofix is built from: only those that are missing.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: jobs/install_dependencies.sh [--runtime-only] [--browser] [--list]

Installs what panofix needs to build, on Debian 12 or a system with the same package names. Packages
that are there already are left alone, and nothing is asked of the network when none is missing.

  --runtime-only  what the on-line half needs (configure with -DPANOFIX_BUILD_BUILDER=OFF
                  -DPANOFIX_BUILD_TESTS=OFF): no Ceres, no test tools, no Embree
  --browser       also Chromium and its driver, for the test of the live page (it skips without)
  --list          print the packages and stop
TEXT
}

fail() {
  echo "install_dependencies.sh: $*" >&2
  exit 1
}

# The one place that lists them. OpenCV by component: libopencv-dev drags in VTK and Qt.
runtime_packages=(
  build-essential cmake ninja-build ccache pkg-config
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev libopencv-features2d-dev
  libopencv-flann-dev libopencv-calib3d-dev
  libeigen3-dev libtbb-dev libhdf5-dev libgeographiclib-dev libjpeg-dev zlib1g-dev
  libzmq3-dev cppzmq-dev libflatbuffers-dev flatbuffers-compiler
  libcli11-dev libspdlog-dev nlohmann-json3-dev libssl-dev libyaml-cpp-dev
  libsodium-dev libzstd-dev libcurl4-openssl-dev libcpp-httplib-dev libjs-leaflet
)
builder_packages=(libceres-dev)
test_packages=(libembree-dev libgtest-dev libgmock-dev libbenchmark-dev minisign
  python3-zmq python3-flatbuffers)

browser_packages=()
list_only=false
for argument in "$@"; do
  case "$argument" in
    --runtime-only) builder_packages=() test_packages=() ;;
    --browser) browser_packages=(chromium chromium-driver) ;;
    --list) list_only=true ;;
    -h | --help) usage; exit 0 ;;
    *) usage >&2; fail "unknown argument '$argument'" ;;
  esac
done
packages=("${runtime_packages[@]}" "${builder_packages[@]}" "${test_packages[@]}" "${browser_packages[@]}")
if $list_only; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

command -v apt-get >/dev/null ||
  fail "this is no Debian or Ubuntu; install the counterparts of: ${packages[*]}"

missing=()
for package in "${packages[@]}"; do
  # "|| true": dpkg-query fails on a name it has never seen.
  state=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$state" = installed ] || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  echo "dependencies: all ${#packages[@]} packages are installed"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null ||
    fail "needs root or sudo; as root run: apt-get install --no-install-recommends ${missing[*]}"
  as_root=(sudo)
fi
export DEBIAN_FRONTEND=noninteractive
echo "dependencies: installing ${#missing[@]} of ${#packages[@]} packages: ${missing[*]}"
"${as_root[@]}" apt-get -qq update ||
  fail "apt-get update failed; check the network and /etc/apt/sources.list"
"${as_root[@]}" apt-get -qq -y --no-install-recommends install "${missing[@]}" >/dev/null ||
  fail "apt-get install failed; the lines above say why"
echo "dependencies: installed"
