# SPDX-License-Identifier: MIT
"""Where the peers are: packages from PyPI that are measured beside this one, and need not be there.

    python benchmarks/peer_packages.py

puts them into a folder of their own, last on the path, without what they depend on: NumPy, SciPy,
Matplotlib and SymPy are those of the environment, and nothing outside that folder changes.
"""

import importlib.util
import subprocess
import sys
from collections.abc import Iterable
from importlib.metadata import distributions
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "results" / "peers"
#: Names on PyPI with the releases that were tried. Exudyn: flexible multibody dynamics. pyMOTO:
#: topology optimisation; CVXOPT gives it the CHOLMOD factorisation, opt_einsum faster products.
PEERS = {"exudyn": "1.13.6", "pymoto": "2.0.1", "cvxopt": "1.3.3", "opt_einsum": "3.4.0"}
#: What pyMOTO needs besides NumPy, SciPy and Matplotlib; the environment mostly has it.
COMPANIONS = {"sympy": "1.13.3", "mpmath": "1.3.0"}


def use_peers() -> None:
    """Let this process find the peers."""
    if str(FOLDER) not in sys.path:
        sys.path.append(str(FOLDER))


def missing() -> str | None:
    """What is not there and what to do about it, or None where all peers are there."""
    use_peers()
    absent = ", ".join(_absent([*PEERS, *COMPANIONS]))
    told = f"peers: {absent} not found; `make benchmark-peers` puts them into {FOLDER} "
    return told + "(25 MB from PyPI, nothing else changes) and runs this study" if absent else None


def _absent(names: Iterable[str]) -> list[str]:
    return [name for name in names if importlib.util.find_spec(name) is None]


def versions() -> dict[str, str]:
    """The releases of the peers that are there."""
    use_peers()
    found = {str(d.metadata["Name"]).lower().replace("-", "_"): d.version for d in distributions()}
    return {name: found[name] for name in PEERS if name in found}


def main() -> None:
    """Put the peers into their folder, if they are not there."""
    if missing() is None:
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--no-deps", "--upgrade", "--target", str(FOLDER)]
    wanted = PEERS | {name: COMPANIONS[name] for name in _absent(COMPANIONS)}
    command += [f"{name}=={version}" for name, version in wanted.items()]
    print(f"peers: installing {', '.join(wanted)} from PyPI into {FOLDER}")
    if subprocess.run(command).returncode != 0:
        raise SystemExit("peers: pip could not install them; its own message stands above")


if __name__ == "__main__":
    main()
