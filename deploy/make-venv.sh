#!/usr/bin/env bash
# Make a virtual environment of Python 3.11 (bpy is built for 3.11 alone) unless there is one. Usage: make-venv.sh FOLDER
set -euo pipefail

source "$(dirname "${BASH_SOURCE[0]}")/apt.sh"
folder=${1:?usage: make-venv.sh FOLDER}

is_python_3_11() {
    command -v "$1" >/dev/null 2>&1 &&
        "$1" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' >/dev/null 2>&1
}

if is_python_3_11 "$folder/bin/python"; then
    exit 0
fi

make_venv() {
    "$1" -m venv --clear "$folder" >/dev/null 2>&1
}

for candidate in python3.11 python3 python; do
    is_python_3_11 "$candidate" || continue
    # Debian packs venv apart from Python itself.
    make_venv "$candidate" || { install_packages python3.11-venv && make_venv "$candidate"; } && exit 0
    echo "$candidate cannot make a virtual environment in $folder." >&2
    exit 1
done

echo "Python 3.11 is needed and was not found (python3 is $(python3 --version 2>/dev/null || echo absent))." \
    "Install it, for example: apt-get install python3.11 python3.11-venv" >&2
exit 1
