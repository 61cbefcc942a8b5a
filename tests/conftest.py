# SPDX-License-Identifier: MIT
"""Fixtures, and the rules by which one pytest session runs on several MPI ranks.

Every rank runs the same session, so that collective calls meet:

* with more than one rank only the tests marked ``mpi`` are selected; with more than two, the first
  case of each, and outside of the folders where ranks share fields only those about ranks;
  ``BESIDE_THREE`` leaves these out of a run with two, beside which one with three is made, and has
  the first case of each of the others: further ones hold other meshes, laws and messages, which
  the serial session has, to the same agreement of the ranks;
* the ranks agree on the outcome of each phase of each test over a communicator of their own: a test
  that fails anywhere fails everywhere, with the reason from the rank that knows it;
* a rank that does not come to this agreement hangs in a collective call that another rank has left
  by an exception. After a grace time the run is aborted and every rank prints where it stood.

After each test on several ranks garbage is collected on all of them together: PETSc's destructors
are collective. On one rank it is collected after each module.

Serial tests may run in several workers of pytest-xdist at once, each of which is an MPI process by
itself. The tests of a module stay together there, with what they share.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import re
import signal
import sys
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TextIO

from mpi4py import MPI

import pytest
from hypothesis import settings

from dolfinx_ffr.fem.form_cache import claim_form_cache

#: Longest duration of one phase of one test before it counts as hanging [s].
HANGING = 600.0
#: How long a rank on which a test has failed waits for the others [s].
GRACE = 60.0

#: Folders of tests of fields and matrices that the ranks share. With more than two ranks, of what
#: is made of these (motions, parts, whole loops) those run that say so in their names, no demos.
SHARED = ("design", "fem", "reduction")
RANKS = re.compile(r"_ranks?(_|\b)")

#: Communicator of the agreement, so that it never meets a collective call of the test itself.
AGREEMENT = MPI.COMM_WORLD.Dup()

# The same examples on every rank and in every run, and no judgement by the clock.
settings.register_profile("reproducible", derandomize=True, deadline=None, database=None)
settings.load_profile("reproducible")


#: Standard error past pytest's capturing.
STDERR = pytest.StashKey[TextIO]()


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Let one rank report, and print the stacks when a run is aborted."""
    if AGREEMENT.size > 1:
        config.stash[STDERR] = os.fdopen(os.dup(sys.__stderr__.fileno()), "w")
        faulthandler.register(signal.SIGTERM, file=config.stash[STDERR], chain=True)
    if AGREEMENT.rank > 0:
        config.pluginmanager.unregister(name="terminalreporter")


def _with_three(folder: str, text: str) -> bool:
    """Whether tests of a name, or some of a module, run with three ranks."""
    return folder in SHARED or (folder != "demos" and RANKS.search(text) is not None)


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """With several ranks, pass over modules without a test for them: imports take seconds."""
    if AGREEMENT.size > 1 and collection_path.match("test_*.py"):
        text, folder = collection_path.read_text(), collection_path.parent.name
        if "mark.mpi" not in text:
            return True
        if AGREEMENT.size > 2:
            return None if _with_three(folder, text) else True
        return True if os.environ.get("BESIDE_THREE") and folder in SHARED else None
    return None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With several ranks, select tests marked ``mpi``, of which some run with three (see above).

    Among several workers modules with slow ones come first: none is left with one at the end.
    """
    if AGREEMENT.size == 1:
        if os.environ.get("PYTEST_XDIST_WORKER"):
            items.sort(key=lambda item: item.get_closest_marker("slow") is None)
        return
    chosen = [item for item in items if item.get_closest_marker("mpi")]
    first_cases: dict[str, pytest.Item] = {}
    for item in chosen:
        first_cases.setdefault(item.nodeid.partition("[")[0], item)
    if AGREEMENT.size > 2 or os.environ.get("BESIDE_THREE"):
        chosen = [
            item
            for name, item in first_cases.items()
            if _with_three(item.path.parent.name, name) == (AGREEMENT.size > 2)
        ]
    config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
    items[:] = chosen
    names = AGREEMENT.allgather([item.nodeid for item in items])
    if any(other != names[0] for other in names):
        pytest.exit("the ranks have collected different tests", returncode=3)


def _agree(failed: bool, reason: str, config: pytest.Config, nodeid: str) -> list[str]:
    """What the ranks on which the phase failed say of it; abort the run if a rank hangs."""
    request = AGREEMENT.Ibarrier()
    limit = time.monotonic() + (GRACE if failed else HANGING)
    while not request.Test():
        if time.monotonic() > limit:
            message = f"{'has failed' if failed else 'is done'} on rank {AGREEMENT.rank}"
            message += f", while another rank hangs; all ranks are stopped.\n{reason}"
            print(f"\n{nodeid}: {message}", file=config.stash[STDERR], flush=True)
            AGREEMENT.Abort(1)
        time.sleep(1e-4)
    message = AGREEMENT.allgather(reason if failed else "")
    return [f"on rank {rank}: {text}" for rank, text in enumerate(message) if text]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Make a phase that failed on one rank fail on all."""
    report = yield
    if AGREEMENT.size > 1:
        failed = report.outcome == "failed"
        reason = ""
        if failed:
            first_line = call.excinfo.exconly().splitlines()[0] if call.excinfo else "failed"
            reason = f"{first_line}\n{report.longreprtext}"
        reasons = _agree(failed, reason, item.config, item.nodeid)
        if reasons:
            report.outcome = "failed"
            report.longrepr = "\n".join(reasons)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Stop a test that hangs, showing where."""
    file = item.config.stash.get(STDERR, sys.__stderr__)
    faulthandler.dump_traceback_later(2.0 * HANGING, exit=True, file=file)
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="session", autouse=True)
def _form_cache() -> None:
    """Keep compiled forms, also those of tests that compile some without a domain."""
    claim_form_cache(MPI.COMM_WORLD)


@pytest.fixture(scope="module", autouse=True)
def _frozen() -> None:
    """Let the collection of garbage pass over what was there before the tests of a module."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _collect_garbage() -> Iterator[None]:
    """Destroy what the test has left, on all ranks together."""
    yield
    if AGREEMENT.size > 1:
        gc.collect()
        MPI.COMM_WORLD.Barrier()


@pytest.fixture
def comm() -> MPI.Intracomm:
    """The communicator of all ranks."""
    return MPI.COMM_WORLD


@pytest.fixture
def shared_tmp_path(comm: MPI.Intracomm, tmp_path: Path) -> Path:
    """A temporary directory, the same one on every rank."""
    return comm.bcast(tmp_path)
