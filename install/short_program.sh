#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The short program with few elements, steps and iterations, run by PYTHON in the present folder, as a test of a
# package that is installed in FOLDER: install/short_program.sh PYTHON FOLDER
set -euo pipefail

source=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)/demos/short.py
sed -e 's/elements=(200, 20)/elements=(40, 4)/' -e 's/TimeInterval(2.0)/TimeInterval(2.0, 1e-2)/' \
    -e 's/iterations=[0-9]*/iterations=3/' -e 's#"results/short/motion.gif"#&, frames=3#' "$source" >short.py
[ "$(diff "$source" short.py | grep -c '^>')" = 4 ] ||
    { echo "demos/short.py has changed; adapt what $0 shortens in it" >&2; exit 1; }
cat >>short.py <<PROGRAM

from pathlib import Path

assert Path(ffr.__file__).is_relative_to("$2"), ffr.__file__
assert 0.0 < result.evaluation.psi < float("inf")
assert all(Path("results/short", name).stat().st_size for name in ("history.csv", "motion.gif"))
PROGRAM
exec "$1" short.py
