#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The whole test suite: all tests serially, in two processes at a time, then those marked `mpi` with several ranks: a
# part of them with 3, the others with 2 (tests/conftest.py). All three sessions run even when one fails. Arguments go to
# pytest; a session in which they select nothing is then no failure, unless they select nothing in any. With --fast before them, the serial
# tests that are not marked `slow` alone. Called by `make test` and `make test-fast`, which do the set-up first.
set -uo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=install/environment.sh
. "$clone/install/environment.sh"
cd "$clone" || exit 1
python=$clone/.venv/bin/python

sessions=("serial" "2 ranks" "3 ranks")
selection=()
if [ "${1:-}" = --fast ]; then
    shift
    sessions=("serial")
    selection=(-m "not slow")
fi

# Compiled forms stay in the clone from run to run. Each session holds a directory of its own there and
# removes what a killed one has left half done, see fem/form_cache.py.
export XDG_CACHE_HOME=$clone/.venv/cache
mkdir -p "$XDG_CACHE_HOME" || exit 1
# Without its files of bytecode pytest would prepare each test module anew in each process.
unset PYTHONDONTWRITEBYTECODE
trap 'exit 130' INT TERM HUP

results=()
status=0
ran=0
for session in "${sessions[@]}"; do
    printf '\n== tests, %s\n' "$session"
    start=$SECONDS
    # A place of its own for each session: ranks that clear away the directories of sessions before
    # do so at the same time, and one finds gone what the other has removed.
    PYTEST_DEBUG_TEMPROOT=$(mktemp -d) || exit 1
    export PYTEST_DEBUG_TEMPROOT
    if [ "$session" = serial ]; then
        "$python" -m pytest -n 2 --dist loadscope --no-loadscope-reorder "${selection[@]}" "$@"
    else
        [ "$session" = "2 ranks" ] && export BUT_THOSE_OF_THREE=1
        # more ranks than cores: those that wait let the others work
        OMPI_MCA_mpi_yield_when_idle=1 mpirun -n "${session% *}" "$python" -m pytest -m mpi "$@" -n 0
    fi
    code=$?
    [ $code = 1 ] || rm -rf "$PYTEST_DEBUG_TEMPROOT" # files of tests that failed stay to be looked at
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
    results+=("$(printf '%-8s %-24s %4d s' "$session" "$verdict" $((SECONDS - start)))")
done

printf '\n== summary of the tests (%s, Python %s)\n' "$(. /etc/os-release && printf '%s' "$PRETTY_NAME")" \
    "$("$python" -c 'import platform; print(platform.python_version())')"
printf '   %s\n' "${results[@]}"
if [ ${#sessions[@]} = 1 ]; then
    printf '   left out: the tests marked slow, and 2 and 3 MPI ranks; make test runs all\n'
fi
[ $ran = 1 ] || status=5
exit $status
