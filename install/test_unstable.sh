#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A selection of the tests on Debian unstable, in a root that is kept: do DOLFINx, UFL and the other packages of
# tomorrow still fit? Called by `make test-unstable` and by .ci/run.
#
# Exit code 0: the tests pass. 1: one of them fails. 77: skipped, and the last line says why. Whatever keeps the
# tests from starting is skipped, for unstable may be broken or out of reach at any time: no root can be made, its
# packages cannot be installed or do not fit together, or the time is up. As soon as they have started, a test that
# fails counts: the run ends with it, so that one whose time is up has seen no failure.
set -uo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
limit=${DOLFINX_FFR_UNSTABLE_SECONDS:-480} # for all of it, a fresh root included [s]

skip() {
    printf 'unstable: SKIPPED after %d s: %s\n' "$SECONDS" "$1"
    exit 77
}
in_root() { # in_root COMMAND...: in what is left of the time
    local left=$((limit - SECONDS))
    [ $left -gt 0 ] || return 124
    timeout --kill-after=10 $left "$clone/install/debian_root.sh" sid "$@"
}
time_up() { [ "$1" = 124 ] || [ "$1" = 137 ]; }

in_root true
code=$?
if time_up $code; then skip "a root could not be made in $limit s; it is not kept"; fi
[ $code = 0 ] || skip "a root of Debian unstable cannot be made here (its message stands above)"

in_root make setup
code=$?
if time_up $code; then skip "its packages could not be installed in $limit s; the next run goes on from there"; fi
[ $code = 0 ] || skip "its packages cannot be installed, or do not fit together (their message stands above)"

# What tomorrow calls obsolete is shown, but no error.
in_root tests/run.sh --selection -W default
code=$?
if time_up $code; then skip "no test has failed, but the time of $limit s was up before the last of them"; fi
[ $code = 0 ] || { printf 'unstable: FAILED after %d s\n' "$SECONDS"; exit 1; }
printf 'unstable: passed after %d s\n' "$SECONDS"
