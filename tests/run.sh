#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The whole test suite: all tests serially, then those marked `mpi` with 2 and with 3 ranks. All three sessions
# run even when one fails. Arguments go to pytest; a session in which they select nothing is then no failure,
# unless they select nothing in any. Called by `make test`, which does the set-up first.
set -uo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=install/environment.sh
. "$clone/install/environment.sh"
cd "$clone" || exit 1
python=$clone/.venv/bin/python

# Compiled forms of this session only: nothing that an earlier, killed run left can matter, nor can this one
# leave anything. Removed at the end, and also when interrupted.
XDG_CACHE_HOME=$(mktemp -d "${TMPDIR:-/tmp}/dolfinx_ffr-tests.XXXXXX") || exit 1
export XDG_CACHE_HOME
trap 'rm -rf "$XDG_CACHE_HOME"' EXIT
trap 'exit 130' INT TERM HUP

names=("serial" "2 ranks" "3 ranks")
results=()
status=0
ran=0
for ranks in 1 2 3; do
    printf '\n== tests, %s\n' "${names[ranks - 1]}"
    start=$SECONDS
    if [ "$ranks" = 1 ]; then
        "$python" -m pytest "$@"
    else
        mpirun -n "$ranks" "$python" -m pytest -m mpi "$@"
    fi
    code=$?
    if [ $code = 0 ]; then
        verdict=passed
        ran=1
    elif [ $code = 5 ] && [ $# -gt 0 ]; then
        verdict="no test selected"
    else
        verdict="FAILED (exit code $code)"
        status=1
        ran=1
    fi
    results+=("$(printf '%-8s %-24s %4d s' "${names[ranks - 1]}" "$verdict" $((SECONDS - start)))")
done

printf '\n== summary of the tests (%s, Python %s)\n' "$(. /etc/os-release && printf '%s' "$PRETTY_NAME")" \
    "$("$python" -c 'import platform; print(platform.python_version())')"
printf '   %s\n' "${results[@]}"
[ $ran = 1 ] || status=5
exit $status
