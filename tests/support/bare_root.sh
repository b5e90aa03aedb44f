#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# What a newcomer's machine makes of the README's two commands: a bare Debian 12 root without anything of this machine.
#   tests/support/bare_root.sh              their packages and configure steps, as a user with sudo: in .ci/run
#   tests/support/bare_root.sh --whole [COMMAND]   the whole commands, or one of them, each twice, as root and as a user with sudo:
#                                                  before a release
#   tests/support/bare_root.sh --packages BUILD    the Debian packages of a build of deform, deformd and manual: installed, and a first
#                                                  round with the server under its own account
# The first command runs before the packages of the second are there. Needs root and mmdebstrap; nothing is kept. The second
# user compiles nothing that the first one compiled: both have a clone of their own at the same path and one compiler cache.
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
whole=()
packages=
case "$*" in
  "") ;;
  "--packages "*)
    packages=$2
    rm -rf "$packages/packages"
    (cd "$packages" && cpack -G DEB -D "CPACK_COMPONENTS_ALL=tools;server")
    ;;
  --whole) whole=(deploy/quick-start deploy/run-tests) ;;
  "--whole deploy/quick-start" | "--whole deploy/run-tests") whole=("$2") ;;
  *)
    echo "usage: $0 [--whole [deploy/quick-start | deploy/run-tests] | --packages BUILD]" >&2
    exit 2
    ;;
esac
if [ "$(id -u)" -ne 0 ]; then
  echo "bare root: skipped, it needs root"
  exit 0
fi

root=$(mktemp -d)
leave() {
  umount -l "$root/dev/pts" "$root/dev/shm" "$root/dev" "$root/sys" "$root/proc" 2>/dev/null || true
  rm -rf --one-file-system "$root"
}
trap leave EXIT
trap 'echo "bare root: failed: $doing"' ERR

# Packages come from where this machine takes them, by the same settings of its apt.
doing="making the root"
sources=$(find /etc/apt -name debian.sources -o -name sources.list | head -1)
mmdebstrap --quiet --variant=minbase --include=sudo,git,ca-certificates bookworm "$root" "$sources"
for settings in /etc/apt/apt.conf.d/*; do
  case $(basename "$settings") in
    99* | docker-clean | docker-no-languages) cp "$settings" "$root/etc/apt/apt.conf.d/" ;;
  esac
done
cp /etc/resolv.conf "$root/etc/resolv.conf"
echo force-unsafe-io >"$root/etc/dpkg/dpkg.cfg.d/unsafe-io"  # the root is thrown away, so nothing waits for the disk
mount --bind /proc "$root/proc"
mount --bind /sys "$root/sys"
mount --bind /dev "$root/dev"
mount --make-private "$root/dev"
mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"
mount -t devpts devpts "$root/dev/pts" 2>/dev/null || true
mkdir -m 1777 "$root/ccache"
chroot "$root" useradd -m -s /bin/bash engineer
echo 'engineer ALL=(ALL) NOPASSWD:ALL' >"$root/etc/sudoers.d/engineer"

# clone OWNER: what is committed, and what is not yet.
clone() {
  rm -rf "$root/srv/clone"
  git clone -q . "$root/srv/clone"
  git diff --binary HEAD | (cd "$root/srv/clone" && git apply --allow-empty)
  git ls-files -z --others --exclude-standard | xargs -0r cp --parents -t "$root/srv/clone"
  chroot "$root" chown -R "$1:$1" /srv/clone
}
# as USER COMMAND...
as() {
  doing="$* (as $1)"
  printf '\n== bare root, as %s: %s\n' "$1" "${*:2}"
  chroot "$root" su - "$1" -c "export CCACHE_DIR=/ccache CCACHE_UMASK=000; cd /srv/clone && ${*:2}"
}

if [ -n "$packages" ]; then
  doing="installing the packages"
  cp "$packages"/packages/*.deb "$root/tmp/"
  chroot "$root" sh -ec 'apt-get update -q && apt-get install -qy --no-install-recommends /tmp/*.deb'
  doing="a first round with what they installed"
  chroot "$root" sh -ec 'test "$(stat -c "%a %G" /etc/deformd/deformd.yaml)" = "640 deformd"
    install -d -m 0700 -o deformd -g deformd /var/lib/deformd
    su deformd -s /bin/sh -c "exec deformd --config /etc/deformd/deformd.yaml --data-dir /var/lib/deformd" &
    trap "kill $!; wait $! || true" EXIT
    for attempt in 1 2 3 4 5; do deform status && break; sleep 1; done
    cd /home/engineer && deform sample -o ahmed.obj && deform register ahmed.obj && deform list
    test -e /usr/share/man/man8/deformd.8 -o -e /usr/share/man/man8/deformd.8.gz'
  chroot "$root" apt-get purge -qy deform deformd
  test -d "$root/var/lib/deformd/geometries" || { echo "bare root: removing the package removed the data" >&2; exit 1; }
  echo "bare root: the packages install, serve and go again"
  exit 0
fi

clone engineer
if [ ${#whole[@]} -eq 0 ]; then
  as engineer deploy/quick-start --configure-only
  as engineer deploy/run-tests --configure-only >/dev/null
  echo "bare root: both commands find what they need"
  exit 0
fi
for user in engineer root; do
  [ "$user" = engineer ] || clone "$user"
  for command in "${whole[@]}"; do
    as "$user" "$command"
    as "$user" "$command"
  done
done
echo "bare root: ${whole[*]} work, twice, as a user with sudo and as root"
