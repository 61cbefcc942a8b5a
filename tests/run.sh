#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The test suite. All three sessions run even when one fails: all tests serially, in two processes at a time, then a case of
# each of those marked `mpi` with 2 ranks or, beside them, with 3 (tests/conftest.py). Arguments go to pytest; a
# session in which they select nothing is then no failure, unless they select nothing in any. Called by `make test` and
# `make test-fast`, which do the set-up first. The first argument may be
#   --fast       the serial tests that are not marked `slow`, alone
#   --selection  the tests of another release (the list below), serially and with 2 ranks, up to the first failure
set -uo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=install/environment.sh
. "$clone/install/environment.sh"
cd "$clone" || exit 1
python=$clone/.venv/bin/python

# What depends on DOLFINx, UFL, PETSc, SLEPc, gmsh, Numba, VTK and MPI by their names, one scene of each kind, and ranks.
serial_selection=(
    tests/fem/test_compat.py
    tests/fem/test_domain.py
    tests/fem/test_space.py
    tests/reduction/test_integrals.py
    tests/reduction/test_pullback.py
    tests/reduction/test_multigrid.py
    tests/dynamics/test_connections.py
    tests/dynamics/test_stiffened_energy.py
    tests/boundary/test_move_boundary.py::test_psi_falls_and_members_stay
    tests/part/test_export.py
    tests/part/test_solid.py
    tests/plotting/test_space.py
    tests/plotting/test_plotting.py::test_shade_is_the_density
    tests/scene_file/test_reading.py
    tests/test_package.py
    tests/test_problem.py::test_gradient_with_a_marker_inside
    tests/demos/test_demos.py::test_short_program
)
parallel_selection=(
    tests/fem/test_domain.py
    tests/reduction/test_pullback.py
    tests/test_problem.py::test_same_numbers_on_any_number_of_ranks
)

kind=all
case ${1:-} in
--fast) kind=fast && shift && set -- -m "not slow" "$@" ;;
--selection) kind=selection && shift && set -- -x "$@" ;;
esac

# Compiled forms stay in the clone from run to run. Each session holds a directory of its own there and
# removes what a killed one has left half done, see fem/form_cache.py.
export XDG_CACHE_HOME=$clone/.venv/cache
mkdir -p "$XDG_CACHE_HOME" || exit 1
# Without its files of bytecode pytest would prepare each test module anew in each process.
unset PYTHONDONTWRITEBYTECODE
status=0
ran=0
beside=
folder=$(mktemp -d) || exit 1
trap '[ -z "$beside" ] || kill -- "-$beside" 2>/dev/null; rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM HUP

session() { # session NAME ARGUMENTS...: runs it, and leaves its line of the summary in a file
    local name=$1 start=$SECONDS code verdict
    shift
    printf '\n== tests, %s\n' "$name"
    # A place of its own for each session: ranks that clear away the directories of sessions before
    # do so at the same time, and one finds gone what the other has removed.
    PYTEST_DEBUG_TEMPROOT=$(mktemp -d) || exit 1
    export PYTEST_DEBUG_TEMPROOT
    if [ "$name" = serial ]; then
        "$python" -m pytest -n 2 --dist loadscope --no-loadscope-reorder "$@"
    else
        [ "$name" = "2 ranks" ] && [ $kind = all ] && export BESIDE_THREE=1
        # more ranks than cores: those that wait let the others work
        OMPI_MCA_mpi_yield_when_idle=1 mpirun -n "${name% *}" "$python" -m pytest -m mpi "$@" -n 0
    fi
    code=$?
    [ $code = 1 ] || rm -rf "$PYTEST_DEBUG_TEMPROOT" # files of tests that failed stay to be looked at
    if [ $code = 0 ]; then
        verdict=passed
    elif [ $code = 5 ] && [ $# -gt 0 ]; then
        verdict="no test selected"
    else
        verdict="FAILED (exit code $code)"
    fi
    printf '%-8s %-24s %4d s\n' "$name" "$verdict" $((SECONDS - start)) >"$folder/${name% *}"
    return $code
}
count() { # count CODE ARGUMENTS...: of a session that has ended
    local code=$1
    shift
    [ "$code" = 0 ] || { [ "$code" = 5 ] && [ $# -gt 0 ]; } || status=1
    { [ "$code" = 5 ] && [ $# -gt 0 ]; } || ran=1
}

# Compiled once here, and not by each of the processes that would need it first.
PYTHONPATH=$clone/src "$python" -m dolfinx_ffr compile --all

case $kind in
fast)
    session serial "$@"
    count $? "$@"
    ;;
selection)
    session serial "${serial_selection[@]}" "$@"
    count $? "$@"
    if [ $status = 0 ]; then
        session "2 ranks" "${parallel_selection[@]}" "$@"
        count $? "$@"
    fi
    ;;
all)
    session serial "$@"
    count $? "$@"
    # beside each other, as ranks wait for each other; what the second prints comes after the first
    set -m # a process group of its own, to end all of it when this script ends
    session "3 ranks" "$@" >"$folder/said" 2>&1 </dev/null &
    beside=$!
    set +m
    session "2 ranks" "$@"
    count $? "$@"
    wait "$beside"
    count $? "$@"
    beside=
    cat "$folder/said"
    ;;
esac

printf '\n== summary of the tests (%s, Python %s)\n' "$(. /etc/os-release && printf '%s' "$PRETTY_NAME")" \
    "$("$python" -c 'import platform; print(platform.python_version())')"
for name in serial 2 3; do
    [ ! -e "$folder/$name" ] || printf '   %s' "$(cat "$folder/$name")"$'\n'
done
case $kind in
fast) printf '   left out: serial tests marked slow, and 2 and 3 MPI ranks; make test runs all\n' ;;
selection) printf '   a selection of the tests; make test runs all\n' ;;
esac
[ $ran = 1 ] || status=5
exit $status
