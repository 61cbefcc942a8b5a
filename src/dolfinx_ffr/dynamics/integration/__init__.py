# SPDX-License-Identifier: MIT
"""Time integration and its discrete adjoint, whatever the kinematics."""

__all__ = ()
