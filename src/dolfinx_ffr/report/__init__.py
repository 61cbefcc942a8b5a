# SPDX-License-Identifier: MIT
"""A run as one page, for those who did not make it: what was modelled, found, and how well.

`run_record` gathers what a results folder must hold beside its history and pictures; `write_report`
makes the page from the folder alone, at once or years later.
"""

from __future__ import annotations

from .record import recorded_warnings as recorded_warnings
from .record import run_record as run_record
from .sections import write_report as write_report
