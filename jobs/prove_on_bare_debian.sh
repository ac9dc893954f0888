#!/usr/bin/env bash
# Proves that a bare Debian 12 is enough: makes an empty one in a folder, clones the committed sources
# into it, and runs the quick start and all tests there. Root only; the host is left as it was.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: jobs/prove_on_bare_debian.sh FOLDER [--only-install] [--remove]

FOLDER must be new or empty, with about 6 GB free; the Debian goes to FOLDER/root, logs and times to
FOLDER/*.log. Packages come from the mirror that this machine's own apt uses.

  --only-install  stop after jobs/install_dependencies.sh
  --remove        remove FOLDER/root at the end
TEXT
}

fail() {
  echo "prove_on_bare_debian.sh: $*" >&2
  exit 1
}

suite=bookworm
folder='' only_install=false remove=false
for argument in "$@"; do
  case "$argument" in
    --only-install) only_install=true ;;
    --remove) remove=true ;;
    -h | --help) usage; exit 0 ;;
    -*) usage >&2; fail "unknown argument '$argument'" ;;
    *) folder=$argument ;;
  esac
done
[ -n "$folder" ] || { usage >&2; fail "name a folder"; }
[ "$(id -u)" -eq 0 ] || fail "needs root (debootstrap and chroot do)"
command -v debootstrap >/dev/null || fail "needs debootstrap: apt-get install debootstrap"
command -v git >/dev/null || fail "needs git: apt-get install git"
sources=$(dirname "$(readlink -f "$0")")/..
mkdir -p "$folder"
folder=$(readlink -f "$folder")
[ -z "$(ls -A "$folder")" ] || fail "$folder is not empty; name a new folder"
root=$folder/root

# The first apt source of this machine that carries the suite, in either of apt's formats.
find_mirror() {
  local file uri
  for file in /etc/apt/sources.list.d/*.sources /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
    [ -f "$file" ] || continue
    uri=$(awk -v suite="$suite" '
      /^URIs:/ { uri = $2 }
      /^Suites:/ { for (i = 2; i <= NF; i++) if ($i == suite && uri != "") { print uri; exit } }
      $1 == "deb" { for (i = 2; i < NF; i++) if ($i ~ /^https?:/ && $(i + 1) == suite) { print $i; exit } }
    ' "$file")
    if [ -n "$uri" ]; then
      echo "$uri $file"
      return
    fi
  done
  fail "no apt source of this machine carries $suite"
}

unmount() {
  local point
  for point in "$root/proc" "$root/dev"; do
    if mountpoint -q "$point"; then umount -l "$point"; fi
  done
}
finish() {
  unmount
  # --one-file-system: were something still mounted, it would not be entered.
  if $remove && [ -d "$root" ]; then rm -rf --one-file-system "$root"; fi
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# step NAME COMMAND...: runs it into FOLDER/NAME.log and prints its time.
step() {
  local name=$1 start=$SECONDS code
  shift
  printf '%-12s ' "$name"
  set +e  # as a condition the command would lose its own -e
  (set -e; "$@") >"$folder/$name.log" 2>&1 </dev/null
  code=$?
  set -e
  if [ $code -ne 0 ]; then
    echo failed
    tail -n 20 "$folder/$name.log" >&2
    fail "step '$name' failed; its whole log is $folder/$name.log"
  fi
  printf '%5d s\n' $((SECONDS - start))
}

in_root() {
  local proxies=() name
  for name in http_proxy https_proxy no_proxy; do
    [ -z "${!name:-}" ] || proxies+=("$name=${!name}")
  done
  chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 CI=true \
    "${proxies[@]}" "$@"
}

bootstrap() {
  local with=()
  case "$mirror" in https:*) with=(--include=ca-certificates) ;; esac
  debootstrap --variant=minbase "${with[@]}" "$suite" "$root" "$mirror"
}

use_the_hosts_network() {
  local file
  rm -f "$root/etc/apt/sources.list"
  install -D -m 644 -t "$root$(dirname "$source_file")" "$source_file"
  for file in /etc/apt/apt.conf.d/*; do
    if grep -qi '^[[:space:]]*Acquire' "$file"; then install -m 644 -t "$root/etc/apt/apt.conf.d" "$file"; fi
  done
  install -m 644 /etc/resolv.conf "$root/etc/resolv.conf"
  if [ -d /usr/local/share/ca-certificates ]; then
    mkdir -p "$root/usr/local/share"
    cp -r /usr/local/share/ca-certificates "$root/usr/local/share/"
  fi
  mount -t proc proc "$root/proc"
  mount --bind /dev "$root/dev"
}

found=$(find_mirror)
mirror=${found% *} source_file=${found#* }
step debootstrap bootstrap
step network use_the_hosts_network
step clone git clone --quiet --no-hardlinks "$sources" "$root/panofix"
step install in_root /panofix/jobs/install_dependencies.sh
if $only_install; then
  echo "$(in_root dpkg-query -W -f='x\n' | wc -l) packages, $(du -shx "$root" | cut -f1)"
  exit 0
fi
step quickstart in_root /panofix/jobs/quickstart.sh
cat "$folder/quickstart.log"
step tests in_root /panofix/tests/run.sh
tail -n 5 "$folder/tests.log"
