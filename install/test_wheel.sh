#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The package as a wheel: built, compared with the sources, installed in a fresh environment that knows nothing of
# this tree, and used there by the short program with few elements and iterations. Called by `make test-wheel`,
# which does the set-up first.
set -euo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
# shellcheck source=install/environment.sh
. "$clone/install/environment.sh"
away=$(mktemp -d "${TMPDIR:-/tmp}/dolfinx_ffr-wheel.XXXXXX")
trap 'rm -rf "$away"' EXIT
trap 'exit 130' INT TERM HUP
export XDG_CACHE_HOME=$away/cache
export PIP_CACHE_DIR=${PIP_CACHE_DIR:-${HOME:-/root}/.cache/pip}

/usr/bin/python3 -m venv --system-site-packages "$away/venv"
python=$away/venv/bin/python
rm -rf "$clone/build/lib" "$clone"/build/bdist.* # setuptools would take modules from there that are gone
"$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$away" "$clone"
wheel=("$away"/*.whl)
cd "$away"

"$python" - "${wheel[0]}" "$clone/src" <<'PROGRAM'
import sys
import zipfile
from pathlib import Path

wheel, sources = zipfile.ZipFile(sys.argv[1]), Path(sys.argv[2])
packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
wanted = {str(path.relative_to(sources)) for path in sources.glob("dolfinx_ffr/**/*.py")}
wanted.add("dolfinx_ffr/py.typed")
wanted |= {str(path.relative_to(sources)) for path in sources.glob("dolfinx_ffr/report/templates/*")}
if packed != wanted:
    sys.exit(f"the wheel lacks {sorted(wanted - packed)} and has beside {sorted(packed - wanted)}")
if not any(name.endswith("licenses/LICENSE") for name in wheel.namelist()):
    sys.exit("the wheel has no licence")
print(f"wheel: {Path(sys.argv[1]).name}, {len(packed)} files, as in src/")
PROGRAM

# No constraints: what the wheel itself asks for must leave Debian's NumPy and its companions in their places.
"$python" -m pip install --quiet --disable-pip-version-check "${wheel[0]}"
"$python" "$clone/install/debian_stack.py" check "$clone/.venv/constraints.txt"
sed -e 's/elements=(200, 20)/elements=(40, 4)/' -e 's/TimeInterval(2.0)/TimeInterval(2.0, 1e-2)/' \
    -e 's/iterations=60/iterations=3/' -e 's#"results/short/motion.gif"#&, frames=3#' \
    "$clone/demos/short.py" >short.py
[ "$(diff "$clone/demos/short.py" short.py | grep -c '^>')" = 4 ] ||
    { echo "wheel: demos/short.py has changed; adapt what $0 shortens in it" >&2; exit 1; }
cat >>short.py <<'PROGRAM'

from pathlib import Path

assert Path(ffr.__file__).is_relative_to(Path(__file__).parent / "venv"), ffr.__file__
assert 0.0 < result.evaluation.psi < float("inf")
assert all(Path("results/short", name).stat().st_size for name in ("history.csv", "motion.gif"))
PROGRAM
"$python" short.py
echo "wheel: the short program runs in a fresh environment"
