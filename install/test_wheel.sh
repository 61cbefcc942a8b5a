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
files = (path for path in sources.glob("dolfinx_ffr/**/*") if path.is_file())
wanted = {str(path.relative_to(sources)) for path in files if "__pycache__" not in path.parts}
if packed != wanted:
    sys.exit(f"the wheel lacks {sorted(wanted - packed)} and has beside {sorted(packed - wanted)}")
if not any(name.endswith("licenses/LICENSE") for name in wheel.namelist()):
    sys.exit("the wheel has no licence")
print(f"wheel: {Path(sys.argv[1]).name}, {len(packed)} files, as in src/")
PROGRAM

# No constraints: what the wheel itself asks for must leave Debian's NumPy and its companions in their places.
"$python" -m pip install --quiet --disable-pip-version-check "${wheel[0]}"
"$python" "$clone/install/debian_stack.py" check "$clone/.venv/constraints.txt"
"$clone/install/short_program.sh" "$python" "$away/venv"
echo "wheel: the short program runs in a fresh environment"
