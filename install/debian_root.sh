#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: install/debian_root.sh [--layer] SUITE COMMAND [ARGUMENT...]     (SUITE: bookworm, trixie, sid, or "other")
#
# Runs the command in a copy of this source tree inside a root of another Debian release, made by debootstrap
# and kept in /var/cache/dolfinx_ffr/SUITE (or below $DOLFINX_FFR_ROOTS). The copy is replaced at each run;
# the Debian packages and .venv inside the root stay. Root only: chroot and mount need it. All mounts live in
# a namespace of their own, so that a killed run leaves none behind.
#
# With --layer all that the command changes is kept in memory and forgotten: the root stays as it is.
set -euo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
fail() {
    printf 'debian_root: error: %s\n' "$1" >&2
    shift
    for line in "$@"; do printf '             %s\n' "$line" >&2; done
    exit 1
}

layer=
if [ "${1:-}" = --layer ]; then layer=yes && shift; fi
[ $# -ge 2 ] || fail "usage: install/debian_root.sh [--layer] SUITE COMMAND [ARGUMENT...]"
suite=$1
shift
if [ "$suite" = other ]; then
    case $(. /etc/os-release && printf '%s' "${VERSION_CODENAME:-unknown}") in
    bookworm) suite=trixie ;;
    trixie) suite=bookworm ;;
    *) fail "this system is neither Debian 12 (bookworm) nor Debian 13 (trixie), so there is no other release." \
        "Name one: make test-debian12 or make test-debian13." ;;
    esac
fi
[ "$(id -u)" = 0 ] || fail "a root of Debian $suite can only be made and entered by root; run this as root."
command -v apt-get >/dev/null || fail "this needs a Debian system (debootstrap); there is no apt-get here."

roots=${DOLFINX_FFR_ROOTS:-/var/cache/dolfinx_ffr}
mkdir -p "$roots" 2>/dev/null && [ -w "$roots" ] || { roots=$clone/.roots && mkdir -p "$roots"; }
root=$roots/$suite
inside=/opt/dolfinx_ffr

# One run at a time in a root; the lock ends with this process.
exec 9>"$roots/$suite.lock"
flock --nonblock 9 || { echo "debian_root: waiting for another run in $root"; flock 9; }

# The mirrors that this machine uses; debootstrap knows Debian's own where its configuration names none.
mirror() { # mirror NAME: the first configured site whose address ends in NAME, or nothing
    apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
        sed -n "s#^\(https\?://.*/$1\)/\?\$#\1#p" | awk 'NR == 1'
}

# Unstable changes from day to day.
if [ "$suite" = sid ] && [ -n "$(find "$root/var/log/bootstrap.log" -mtime +30 2>/dev/null)" ]; then
    echo "debian_root: the root of unstable is older than 30 days and is made anew"
    rm -rf --one-file-system "$root"
fi

if [ ! -d "$root" ]; then
    command -v debootstrap >/dev/null || {
        apt-get -q update && DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends debootstrap
    } || fail "debootstrap is missing and could not be installed."
    main=$(mirror debian)
    echo "debian_root: making a root of Debian $suite in $root (once, some minutes)"
    rm -rf --one-file-system "$root.partial"
    # without waiting for the disk after each file, and without manuals, which nobody reads there
    mkdir -p "$root.partial/etc/dpkg/dpkg.cfg.d"
    printf '%s\n' force-unsafe-io path-exclude=/usr/share/{doc,man,info,locale}/'*' >"$root.partial/etc/dpkg/dpkg.cfg.d/quick"
    debootstrap --variant=minbase "$suite" "$root.partial" ${main:+"$main"} || fail "debootstrap failed; see above."
    mv "$root.partial" "$root"
fi

# Network settings of this machine, renewed at each run.
main=$(mirror debian)
security=$(mirror debian-security)
# Where a mirror is not known, the list stays that debootstrap has written. Unstable has no updates of its own.
if [ "$suite" = sid ]; then
    if [ -n "$main" ]; then printf 'deb %s main\n' "$main sid" >"$root/etc/apt/sources.list"; fi
elif [ -n "$main" ] && [ -n "$security" ]; then
    printf 'deb %s main\n' "$main $suite" "$main $suite-updates" "$security $suite-security" >"$root/etc/apt/sources.list"
fi
apt-config dump --format '%F "%v";%n' Acquire::http Acquire::https Acquire::Retries Acquire::Check-Valid-Until \
    Acquire::Check-Date >"$root/etc/apt/apt.conf.d/80host"
printf 'DPkg::Post-Invoke {"rm -f /var/cache/apt/archives/*.deb || true";};\n' >"$root/etc/apt/apt.conf.d/80keep-no-archives"
printf '#!/bin/sh\nexit 101\n' >"$root/usr/sbin/policy-rc.d" # no services are started in the root
chmod +x "$root/usr/sbin/policy-rc.d"
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf; do
    if [ -f "$file" ]; then cp -L "$file" "$root$file"; fi
done
if [ -f "${HOME:-/root}/.config/pip/pip.conf" ]; then
    mkdir -p "$root/root/.config/pip"
    cp "${HOME:-/root}/.config/pip/pip.conf" "$root/root/.config/pip/pip.conf"
fi
settings=(HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 TERM="${TERM:-dumb}"
    NUMBA_CACHE_DIR="$inside/.venv/numba") # beside the sources it would go with them
for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY PIP_INDEX_URL PIP_EXTRA_INDEX_URL \
    PIP_TRUSTED_HOST PIP_PROXY PIP_DEFAULT_TIMEOUT; do
    if [ -n "${!name:-}" ]; then settings+=("$name=${!name}"); fi
done
certificates=${PIP_CERT:-${SSL_CERT_FILE:-/etc/ssl/certs/ca-certificates.crt}}
if [ -f "$certificates" ]; then
    cp -L "$certificates" "$root/etc/host-certificates.pem"
    settings+=(PIP_CERT=/etc/host-certificates.pem)
    echo 'Acquire::https::CaInfo "/etc/host-certificates.pem";' >>"$root/etc/apt/apt.conf.d/80host"
fi

# The sources as they stand here, changes that are not yet committed included.
mkdir -p "$root$inside"
find "$root$inside" -mindepth 1 -maxdepth 1 ! -name '.venv*' -exec rm -rf {} +
list_sources() {
    if git -C "$clone" -c safe.directory="$clone" rev-parse --git-dir >/dev/null 2>&1; then
        (cd "$clone" && git -c safe.directory="$clone" ls-files -z --cached --others --exclude-standard |
            while IFS= read -r -d '' file; do
                if [ -e "$file" ] || [ -L "$file" ]; then printf '%s\0' "$file"; fi
            done)
    else
        (cd "$clone" && find . -type f ! -path './.venv*' ! -path './.roots/*' ! -path './results/*' \
            ! -name '*.pyc' -print0)
    fi
}
list_sources | tar --create --directory "$clone" --null --files-from - | tar --extract --directory "$root$inside" --no-same-owner

export root inside layer
# $0 and $@ of the inner shell are the settings and the command.
# shellcheck disable=SC2016
exec unshare --mount --propagation private --pid --fork --kill-child bash -c '
    if [ -n "$layer" ]; then
        mount -t tmpfs layer /mnt && mkdir /mnt/{upper,work,root} &&
            mount -t overlay -o lowerdir="$root",upperdir=/mnt/upper,workdir=/mnt/work layer /mnt/root || exit 1
        root=/mnt/root
    fi
    mount -t proc proc "$root/proc" || mount --rbind /proc "$root/proc" || exit 1
    mount --rbind /sys "$root/sys" && mount -t tmpfs tmpfs "$root/dev/shm" || exit 1
    mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts" 2>/dev/null # only apt asks for it, to write a log
    chroot "$root" env -i "$@"
    exit $?
' debian_root "${settings[@]}" bash -c '
    cd "$0" || exit 1
    if [ "$1" = make ] && ! command -v make >/dev/null; then
        apt-get -q update && DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends make || exit 1
    fi
    exec "$@"
' "$inside" "$@"
