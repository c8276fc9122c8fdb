#!/usr/bin/env bash
# Proves the channels under loom, then weakens each ordering in turn, in a copy, and demands that the proofs fail: proofs that cannot fail
# prove nothing. Needs the stable toolchain and, once, crates.io for loom.
set -euo pipefail
cd "$(dirname "$0")/.."

copy="$(mktemp -d)"
trap 'rm -rf "$copy"' EXIT
mkdir -p "$copy/src" "$copy/tests"
cp -r tests/channels "$copy/tests/"

# loom is built once and kept; a copy has nothing but the channels to compile.
export CARGO_TARGET_DIR="$PWD/target/loom"
export CARGO_TERM_COLOR=never
export RUSTFLAGS="--cfg loom"

fresh() {
    rm -rf "$copy/src/channel"
    cp -r src/channel "$copy/src/"
}

proofs() {
    # Cargo would look at the files of the last copy, which is gone, or of another checkout, and find nothing changed.
    cargo clean --quiet --manifest-path "$copy/tests/channels/Cargo.toml" -p channels
    cargo test --manifest-path "$copy/tests/channels/Cargo.toml" --lib --locked >"$copy/log" 2>&1
}

fresh
if ! proofs; then
    cat "$copy/log"
    exit 1
fi
grep '^test ' "$copy/log"

# weaken FILE OPERATION ORDERING: the one line of FILE that contains OPERATION gets ORDERING instead of its own.
weaken() {
    local file="$copy/src/channel/$1"
    fresh
    if [[ "$(grep -cF "$2" "$file")" != 1 ]]; then
        echo "$1: not one line contains '$2'"
        exit 1
    fi
    local line
    line="$(grep -nF "$2" "$file" | cut -d: -f1)"
    sed -i "${line}s/Ordering::[A-Za-z]*/Ordering::$3/" "$file"
    if cmp -s "src/channel/$1" "$file"; then
        echo "$1: '$2' is already $3"
        exit 1
    fi
    # A copy that does not compile fails for the wrong reason.
    if proofs || ! grep -q '^test result: FAILED' "$copy/log"; then
        cat "$copy/log"
        echo "$1: the proofs do not notice '$2' with $3"
        exit 1
    fi
    echo "noticed: $1, $2 with $3"
}

for ordering in Relaxed Acquire Release; do
    weaken latest.rs 'floating.swap(self.own | FRESH' "$ordering"
    weaken latest.rs 'floating.swap(self.own, ' "$ordering"
done
for operation in 'head.0.load' 'tail.0.store' 'tail.0.load' 'head.0.store'; do
    weaken ring.rs "$operation" Relaxed
done

# Every ordering that is not Relaxed is in the lists above.
if [[ "$(cat src/channel/latest.rs src/channel/ring.rs | grep -c 'Ordering::\(AcqRel\|Acquire\|Release\|SeqCst\)')" != 6 ]]; then
    echo "an ordering was added that nothing weakens"
    exit 1
fi
