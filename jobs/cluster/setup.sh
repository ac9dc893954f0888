#!/usr/bin/env bash
# Installs what builds on many machines need beside panofix: Snakemake, and Slurm's commands.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: jobs/cluster/setup.sh [--with-slurm-daemons] [--list]

Installs Snakemake 7 and Slurm's client commands on Debian 12. Debian's Snakemake depends on the
clients of three clouds (some 600 MB) that panofix never calls; an empty package that stands in for
them is made and installed first (remove it with: apt-get purge panofix-no-cloud-clients). Where the
clients are installed already, they stay.

  --with-slurm-daemons  also slurmctld, slurmd and munge: a cluster on this one machine, as
                        tests/cluster starts it
  --list                print the packages and stop
TEXT
}

fail() {
  echo "setup.sh: $*" >&2
  exit 1
}

packages=(snakemake slurm-client)
list_only=false
for argument in "$@"; do
  case "$argument" in
    --with-slurm-daemons) packages+=(slurmctld slurmd munge) ;;
    --list) list_only=true ;;
    -h | --help) usage; exit 0 ;;
    *) usage >&2; fail "unknown argument '$argument'" ;;
  esac
done
if $list_only; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

is_installed() {
  [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null || true)" = installed ]
}

command -v apt-get >/dev/null || fail "this is no Debian; install the counterparts of: ${packages[*]}"
missing=()
for package in "${packages[@]}"; do
  is_installed "$package" || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  echo "cluster: all ${#packages[@]} packages are installed"
  exit 0
fi
[ "$(id -u)" -eq 0 ] || fail "needs root: run it with sudo"
export DEBIAN_FRONTEND=noninteractive
apt-get -qq update || fail "apt-get update failed; check the network and /etc/apt/sources.list"

# Snakemake -> python3-smart-open -> clouds. Nothing of theirs is imported by what we run.
clouds=(python3-azure python3-azure-storage python3-boto3 python3-botocore python3-paramiko)
stand_in=()
for package in "${clouds[@]}"; do
  is_installed "$package" || stand_in+=("$package")
done
if ! is_installed snakemake && [ ${#stand_in[@]} -eq ${#clouds[@]} ]; then
  folder=$(mktemp -d)
  trap 'rm -rf "$folder"' EXIT
  mkdir -p "$folder/package/DEBIAN"
  provides=$(printf '%s, ' "${stand_in[@]}")
  cat >"$folder/package/DEBIAN/control" <<TEXT
Package: panofix-no-cloud-clients
Version: 1.0
Architecture: all
Maintainer: panofix
Provides: ${provides%, }
Description: stands in for cloud clients that Snakemake's packages ask for
TEXT
  chmod 0755 "$folder" "$folder/package" "$folder/package/DEBIAN"
  dpkg-deb --build --root-owner-group "$folder/package" "$folder/stand-in.deb" >/dev/null
  dpkg -i "$folder/stand-in.deb" >/dev/null
fi
echo "cluster: installing ${missing[*]}"
apt-get -qq -y --no-install-recommends install "${missing[@]}" >/dev/null ||
  fail "apt-get install failed; the lines above say why"
echo "cluster: installed"
