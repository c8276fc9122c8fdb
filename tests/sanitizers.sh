#!/usr/bin/env bash
# Runs the tests of all that threads share (channels, the simulation's own thread, servo loops, the C interface) under ThreadSanitizer and under
# AddressSanitizer. Rust's standard library is built with them, for a thread that it starts is otherwise a data race to the one and a stranger to the other;
# Debian ships a compiler with its sources. Needs Debian and the right to install packages of it, and takes an hour and more on two cores for each of them.
#
#   tests/sanitizers.sh [thread|address] [argument of cargo test ...]
set -euo pipefail
cd "$(dirname "$0")/.."

packages=(rustc-web cargo-web rust-web-src clang-22 libclang-rt-22-dev)
missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f '${db:Status-Status}\n' "$package" 2>/dev/null | grep -qx installed || missing+=("$package")
done
if ((${#missing[@]})); then
    as_root=()
    if [[ "$(id -u)" != 0 ]]; then as_root=(sudo); fi
    "${as_root[@]}" apt-get update -q
    "${as_root[@]}" apt-get install -qy --no-install-recommends "${missing[@]}"
fi

# Debian's compiler, whatever rustup has put before it. Parts of it that are not stable are asked for by name.
# Checks are put into the code as it stands before it is optimised: at level 3 the compiler takes an hour over them.
export PATH="/usr/bin:/bin" RUSTC_BOOTSTRAP=1 CARGO_TERM_COLOR=never CARGO_PROFILE_DEV_OPT_LEVEL=1
target="$(uname -m)-unknown-linux-gnu"
# What is tested where nothing is said: the library's own tests of channels, simulation and C interface, and those from outside.
sanitize() {
    local name="$1"
    shift
    echo "==== $name sanitizer"
    export CARGO_TARGET_DIR="$PWD/target/sanitize-$name"
    export RUSTFLAGS="-Zsanitizer=$name -Zexternal-clangrt -Clinker=clang-22 -Clink-arg=-fsanitize=$name"
    # A finding ends the program, so that its test fails.
    export TSAN_OPTIONS="halt_on_error=1" ASAN_OPTIONS="detect_stack_use_after_return=1"
    if (($#)); then
        cargo test --locked -Zbuild-std --target "$target" "$@"
        return
    fi
    cargo test --locked -Zbuild-std --target "$target" --lib -- channel:: sim:: servo:: capi::
    cargo test --locked -Zbuild-std --target "$target" --test drive --test servo --test haptic_port
    programs "$name"
}

# C programs against the library of that build: ports on threads of the host's own, handles that die under them.
programs() {
    local deps="$CARGO_TARGET_DIR/$target/debug/deps" program
    ln -sf libpalpate.so "$deps/$(readelf -d "$deps/libpalpate.so" | sed -n 's/.*SONAME.*\[\(.*\)\]/\1/p')"
    for program in threads servo destroy_order; do
        clang-22 -std=c11 -g -O1 -fsanitize="$1" -Iinclude -Itests/c "tests/c/$program.c" \
            -L"$deps" -lpalpate -Wl,-rpath,"$deps" -lpthread -lm -o "$CARGO_TARGET_DIR/$program"
        "$CARGO_TARGET_DIR/$program"
    done
}

sanitizers=(thread address)
if (($#)); then
    case "$1" in
        thread | address) sanitizers=("$1") ;;
        *) echo "sanitizers.sh: there is no sanitizer $1; thread and address are" >&2 && exit 2 ;;
    esac
    shift
fi
for sanitizer in "${sanitizers[@]}"; do sanitize "$sanitizer" "$@"; done
