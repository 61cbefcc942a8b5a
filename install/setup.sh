#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Debian packages, the virtual environment .venv and the PyPI packages in it. Running it again does nothing.
# With the argument "tests" also the Debian packages that only tests need.
#
# The environment is made on Debian's own /usr/bin/python3 with Debian's packages visible in it: DOLFINx is
# compiled against Debian's NumPy, which pip must therefore never replace. The last step checks that.
set -euo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$clone/.venv
stamp=$venv/.complete
python=/usr/bin/python3
list=$clone/install/debian-packages.txt
lists=("$list")
if [ "${1:-}" = tests ]; then lists+=("$clone/install/debian-packages-tests.txt"); fi
# shellcheck source=install/environment.sh
. "$clone/install/environment.sh"

say() { printf 'setup: %s\n' "$*"; }
fail() {
    printf '\nsetup: error: %s\n' "$1" >&2
    shift
    for line in "$@"; do printf '       %s\n' "$line" >&2; done
    exit 1
}

for tool in apt-get dpkg-query; do
    command -v "$tool" >/dev/null || fail "this system has no $tool, so the Debian packages cannot be installed." \
        "Use the conda-forge route instead: docs/install.md, section \"With conda-forge\"."
done

missing_packages() {
    local name
    declare -A installed=()
    while read -r name; do installed[$name]=1; done < <(
        dpkg-query -W -f '${Package} ${db:Status-Status}\n' "$@" 2>/dev/null | sed -n 's/ installed$//p')
    for name in "$@"; do [ -n "${installed[$name]:-}" ] || printf '%s\n' "$name"; done
}

# What the environment was made from: a change in any of it sets up again.
fingerprint() {
    { cat "$list" "$clone/pyproject.toml" "${BASH_SOURCE[0]}"
      readlink -f "$python" # Debian may have been upgraded
    } | sha256sum | cut -d' ' -f1
}

# Of alternatives the first that apt knows, installed ones included; the last one may be none.
choose_packages() {
    local name alternative
    while read -r name; do
        for alternative in ${name//|/ }; do
            if [ "$alternative" = "$name" ] || [ -n "$(apt-cache show "$alternative" 2>/dev/null)" ]; then break; fi
        done
        [ "$alternative" = none ] || printf '%s\n' "$alternative"
    done < <(sed 's/#.*//' "${lists[@]}" | awk 'NF {print $1}')
}

mapfile -t packages < <(choose_packages)
mapfile -t missing < <(missing_packages "${packages[@]}")
if [ ${#missing[@]} = 0 ] && [ -x "$venv/bin/python" ] && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$(fingerprint) $clone" ]; then
    exit 0
fi

# One set-up at a time in this clone; the second one then finds everything done.
if [ -z "${DOLFINX_FFR_SETUP_LOCKED:-}" ]; then
    command -v flock >/dev/null && DOLFINX_FFR_SETUP_LOCKED=1 exec flock "$clone/.venv.lock" bash "${BASH_SOURCE[0]}" "$@"
fi

if [ ${#missing[@]} -gt 0 ]; then
    as_root=()
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || fail "these Debian packages are missing and neither root nor sudo is at hand:" \
            "${missing[*]}" "Ask an administrator to install them with apt-get, then run this again."
        as_root=(sudo)
    fi
    apt() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 "$@"; }
    say "installing ${#missing[@]} Debian packages and what they need, some minutes: ${missing[*]}"
    # An installation that was killed leaves packages unpacked but not configured.
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a
    apt update || fail "apt-get update failed (its own message stands above)." \
        "Check the network and /etc/apt/sources.list, then run this again."
    mapfile -t packages < <(choose_packages)
    apt install -y --fix-broken --no-install-recommends "${packages[@]}" || fail \
        "apt-get could not install the packages of install/debian-packages.txt (its own message stands above)." \
        "They are in Debian 12, Debian 13 and unstable. On another system use the conda-forge route:" \
        "docs/install.md, section \"With conda-forge\"."
fi

[ -x "$python" ] || fail "$python does not exist; it belongs to Debian's package python3."
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail \
    "$python is $("$python" --version 2>&1); Python 3.11 or newer is needed (Debian 12 or 13)." \
    "On an older system use the conda-forge route: docs/install.md, section \"With conda-forge\"."

# No stamp means that a set-up was killed half-way: nothing of it is trusted. Nor can an environment be moved.
if [ ! -f "$stamp" ] || [ "$(cut -d' ' -f2- "$stamp")" != "$clone" ] || ! "$venv/bin/python" -m pip --version >/dev/null 2>&1 ||
    [ "$("$venv/bin/python" -c 'import sys; print(sys.prefix, *sys.version_info[:2])')" != \
      "$venv $("$python" -c 'import sys; print(*sys.version_info[:2])')" ]; then
    say "making the virtual environment $venv"
    rm -rf "$venv"
    "$python" -m venv --system-site-packages "$venv"
fi
rm -f "$stamp"

# Packages that the user installed below the home directory would otherwise hide Debian's.
site=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
printf 'import site; site.ENABLE_USER_SITE = False\n' >"$site/dolfinx_ffr_no_user_site.pth"

"$python" -I "$clone/install/debian_stack.py" constraints >"$venv/constraints.txt"
say "installing PyPI packages, at first about 150 MB (Debian's NumPy and its companions stay as they are)"
# Bytecode comes with the first import of a module: of most packages only few modules are ever imported.
pip() {
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile \
        --constraint "$venv/constraints.txt" "$@" && return
    wait # what is compiled beside it, so that the reason stands last
    fail "pip could not install the PyPI packages (its own message stands above)." "Check the network, then run this again."
}
# So that the first run need not wait for it. Beside the sources, where every later run finds it. Except for its
# progress bar it needs Debian's packages alone, and pip keeps one core busy: both at a time.
compile() { (cd "$venv" && PYTHONPATH="$clone/src" "$venv/bin/python" -m dolfinx_ffr compile --all); }
pip tqdm
say "compiling the time integration beside it, about two minutes of processor time"
compile &
compilation=$!
pip --editable "$clone[test,lint,docs]"

"$venv/bin/python" "$clone/install/debian_stack.py" check "$venv/constraints.txt" || fail \
    "the environment is not usable; the reason stands above."

printf '%s %s\n' "$(fingerprint)" "$clone" >"$stamp.new"
mv "$stamp.new" "$stamp"

wait "$compilation" || compile || say "that has failed; the first simulation compiles again and says why"
say "done: $venv"
