#!/usr/bin/env bash
# Make a virtual environment of Python 3.11 (bpy is built for 3.11 alone) unless there is one. Usage: make-venv.sh FOLDER
set -euo pipefail

folder=${1:?usage: make-venv.sh FOLDER}

is_python_3_11() {
    command -v "$1" >/dev/null 2>&1 &&
        "$1" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' >/dev/null 2>&1
}

if is_python_3_11 "$folder/bin/python"; then
    exit 0
fi

for candidate in python3.11 python3 python; do
    if is_python_3_11 "$candidate"; then
        if "$candidate" -m venv --clear "$folder"; then
            exit 0
        fi
        echo "Python 3.11 is here but cannot make a virtual environment. Type: apt-get install python3.11-venv" >&2
        exit 1
    fi
done

echo "Python 3.11 is needed and was not found (python3 is $(python3 --version 2>/dev/null || echo absent))." \
    "Install it, for example: apt-get install python3.11 python3.11-venv" >&2
exit 1
