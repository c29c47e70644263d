#!/usr/bin/env bash
# Install a Chromium for the tests of the web page, unless there is one. Where that cannot be done the tests skip, so
# this says what to type and does not fail.
set -euo pipefail

source "$(dirname "${BASH_SOURCE[0]}")/apt.sh"
for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null 2>&1; then exit 0; fi
done
install_packages chromium || echo "without a browser the tests of the web page are skipped" >&2
