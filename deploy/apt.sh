# Sourced by the scripts beside it: install_packages NAME... with apt-get, or say in one line what to type.

install_packages() {
    local by_hand="apt-get update && apt-get install -y --no-install-recommends $*"
    if ! command -v apt-get >/dev/null 2>&1; then
        echo "Something is missing; with your package manager install what Debian calls: $*" >&2
        return 1
    fi
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! sudo -n true 2>/dev/null; then
            echo "Something is missing. Type: sudo sh -c '$by_hand'" >&2
            return 1
        fi
        as_root=(sudo -n)
    fi
    echo "installing with apt-get: $*"
    export DEBIAN_FRONTEND=noninteractive
    if ! { "${as_root[@]}" apt-get update -qq &&
        "${as_root[@]}" apt-get install -y -qq --no-install-recommends "$@"; } >/dev/null; then
        echo "The installation failed. Type: sudo sh -c '$by_hand'" >&2
        return 1
    fi
}
