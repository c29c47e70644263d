#!/usr/bin/env bash
# Find the shared libraries that installed wheels need and this machine lacks, and install them.
# Usage: system-libraries.sh VENV. Does nothing, and says nothing, when nothing is missing.
#
# The wheels of open3d and bpy link to libraries of X, GL and USB that a bare Debian or Ubuntu does not have. ldd says
# which are missing; the table below says which package brings each. Drivers that wheels load only when a graphics card
# is there (libcuda, libamdhip64, libze_loader) are not in the table, and so never asked for.
set -euo pipefail

source "$(dirname "${BASH_SOURCE[0]}")/apt.sh"
venv=${1:?usage: system-libraries.sh VENV}
[ "$(uname -s)" = Linux ] || exit 0

declare -A package_of=(
    [libusb-1.0.so.0]=libusb-1.0-0 [libudev.so.1]=libudev1 [libgomp.so.1]=libgomp1
    [libGL.so.1]=libgl1 [libEGL.so.1]=libegl1 [libOpenGL.so.0]=libopengl0 [libGLX.so.0]=libglx0
    [libGLdispatch.so.0]=libglvnd0
    [libX11.so.6]=libx11-6 [libXrender.so.1]=libxrender1 [libXfixes.so.3]=libxfixes3 [libXi.so.6]=libxi6
    [libXext.so.6]=libxext6 [libXxf86vm.so.1]=libxxf86vm1 [libXt.so.6]=libxt6
    [libxkbcommon.so.0]=libxkbcommon0 [libSM.so.6]=libsm6 [libICE.so.6]=libice6
    [libxcb.so.1]=libxcb1 [libXau.so.6]=libxau6 [libXdmcp.so.6]=libxdmcp6
    [libbsd.so.0]=libbsd0 [libmd.so.0]=libmd0 [libuuid.so.1]=libuuid1
    [libidn2.so.0]=libidn2-0 [libunistring.so.2]=libunistring2 [libstdc++.so.6]=libstdc++6
)

entry_libraries() { # what Python loads when it imports the wheels
    find "$venv"/lib/python*/site-packages \( -path '*/bpy/__init__*.so' -o -path '*/bpy/lib/*.so*' \
        -o -path '*/open3d/pybind*.so' -o -path '*/open3d/cpu/pybind*.so' -o -path '*/open3d/libOpen3D.so*' \
        -o -path '*/torch/lib/libtorch_cpu.so' \) -type f 2>/dev/null || true
}

missing_packages() {
    entry_libraries | while read -r library; do
        { ldd "$library" 2>/dev/null || true; } | awk '/not found/ { print $1 }'
    done | sort -u | while read -r soname; do
        if [ -n "${package_of[$soname]:-}" ]; then echo "${package_of[$soname]}"; fi
    done | sort -u
}

mapfile -t packages < <(missing_packages)
[ "${#packages[@]}" -gt 0 ] || exit 0

install_packages "${packages[@]}"
