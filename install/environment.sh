# SPDX-License-Identifier: MIT
# Environment of every command that make starts; sourced, not run. Expects $clone, the top of the source tree.
# shellcheck shell=bash disable=SC2154

# Another Python's modules must not come before Debian's.
unset PYTHONPATH PYTHONHOME

# Modules are compiled once, not at every start.
unset PYTHONDONTWRITEBYTECODE

# The matrices are small: threads of the BLAS cost more than they bring, and MPI ranks share the cores.
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}"

# Pictures without a display. VTK, which PyVista's views of exported grids need, would first try an X server, and
# say so: it draws by OSMesa where that is installed; Debian unstable has it no longer, and Mesa's EGL does the same.
export MPLBACKEND="${MPLBACKEND:-Agg}"
export PYVISTA_OFF_SCREEN="${PYVISTA_OFF_SCREEN:-true}"
if compgen -G '/usr/lib/*/libOSMesa.so*' >/dev/null; then
    export VTK_DEFAULT_OPENGL_WINDOW="${VTK_DEFAULT_OPENGL_WINDOW:-vtkOSOpenGLRenderWindow}"
else
    export VTK_DEFAULT_OPENGL_WINDOW="${VTK_DEFAULT_OPENGL_WINDOW:-vtkEGLRenderWindow}"
fi

# Open MPI 4 (Debian 12), 5 (Debian 13) and 6 (unstable): allow root and more ranks than cores, each by its
# own name. All ranks are on this machine: no network between them, which a chroot lacks and Open MPI then
# complains of, and no copying between processes by system calls that containers refuse with a warning.
if [ "$(id -u)" = 0 ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
export OMPI_MCA_rmaps_base_oversubscribe=1
export PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
export PRTE_MCA_mapby=:oversubscribe
export OMPI_MCA_btl=^tcp
export OMPI_MCA_btl_vader_single_copy_mechanism=none

# Caches of compiled forms, fonts and the like stay in the clone where the home directory cannot be written.
_cache="${XDG_CACHE_HOME:-${HOME:-/nonexistent}/.cache}"
if ! { mkdir -p "$_cache" && [ -w "$_cache" ]; } 2>/dev/null; then
    export XDG_CACHE_HOME="$clone/.venv/cache"
    export MPLCONFIGDIR="${MPLCONFIGDIR:-$XDG_CACHE_HOME/matplotlib}"
    mkdir -p "$MPLCONFIGDIR" 2>/dev/null || true
fi
unset _cache
