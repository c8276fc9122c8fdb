#!/usr/bin/env bash
# All GPU tests, the sanitizers and the benches, for machines that have a GPU but no Rust.
#
#   tests/gpu.sh pack [FOLDER]         where Rust is: builds what is needed and puts it into FOLDER, target/gpu when left out
#   FOLDER/gpu.sh run OUT [PART]...    where the GPU is: runs it; parts are tests, sanitizers and benches, all when left out
#
# `run` writes logs and JSON lines into OUT, prints a short table last, and fails when anything did. The anatomy that PALPATE_DATA names is
# packed too.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"

# What the sanitizers look at, as program:test. Each tool slows a kernel down by ten to a hundred.
sanitized=(
    cuda:two_tools_and_a_reset_leave_no_trace
    cuda:a_press_feels_and_looks_as_on_the_processor
    cuda:a_tip_smaller_than_a_cell_feels_as_on_the_processor
    cuda:sleep::a_body_at_rest_on_a_gpu_sleeps_and_wakes_where_it_is_touched
    cuda:outside::settling_sees_the_peaks_that_the_processor_sees
    cuda:outside::tissue_that_loads_or_bones_carry_to_a_tool_is_seen_in_time
    cuda:efg::a_press_inside_the_implicit_step_feels_as_on_the_processor
    cuda:efg::loads_and_driven_bones_act_as_on_the_processor
    cuda:cutting::copies_on_a_gpu_are_held_freed_and_weighed_as_on_the_processor
    cuda:cutting::a_blade_on_a_gpu_meets_the_toughness_that_it_meets_on_the_processor
    cuda:cutting::a_cut_on_a_gpu_is_seen_and_touched_as_on_the_processor
    lattice_bench:a_sphere_in_a_held_block_is_felt_by_the_baseline
)
tools=(memcheck initcheck synccheck)
# racecheck takes far longer: it looks at the first launches of each of these groups of kernels, which are those that have shared memory, in the smallest
# test.
raced=cuda:a_moment_of_everything_is_that_of_the_processor
kernels=(kns=lattice kne=contact kns=contact_ kne=report kne=judge)
raced_implicit=cuda:efg::bone_is_the_same_wall_on_both
launches=100

fail() {
    echo "gpu.sh: $*" >&2
    exit 2
}

# Builds with cargo and copies the programs into a folder, under their targets' names: built FOLDER ARGUMENTS...
built() {
    local folder="$1" line source program
    shift
    mkdir -p "$folder"
    # cargo says: Executable tests/cuda.rs (target/debug/deps/cuda-0123456789abcdef)
    cargo "$@" --no-run 2>&1 | tee /dev/stderr | sed -n 's/^ *Executable \(unittests \)\{0,1\}\([^ ]*\) (\(.*\))$/\2 \3/p' |
        while read -r source program; do
            source="${source%/main.rs}"
            # Programs travel: what only debuggers read stays.
            strip --strip-debug -o "$folder/$(basename "$source" .rs)" "$program"
        done
}

pack() {
    cd "$here/.."
    local folder="${1:-target/gpu}" targets=() target pair
    # Tests that need a GPU ask for one by that function.
    while read -r target; do
        targets+=(--test "$target")
    done < <(grep -rl 'has_gpu(' tests --include='*.rs' | sed 's|^tests/||; s|/.*||; s|\.rs$||' | grep -vx support | sort -u)
    rm -rf "$folder"
    built "$folder/tests" test "${targets[@]}"
    built "$folder/benches" bench --bench lattice --bench efg --bench cutting
    for pair in "${sanitized[@]}" "$raced" "$raced_implicit"; do
        "$folder/tests/${pair%%:*}" --list | grep -x "${pair#*:}: test" >/dev/null || fail "there is no test $pair"
    done
    if [[ -n "${PALPATE_DATA:-}" ]]; then
        mkdir -p "$folder/data"
        install -m 644 "$PALPATE_DATA/thorax_labels.nii.gz" "$folder/data/"
    fi
    cp "$here/gpu.sh" "$folder/"
    du -sh "$folder"
}

# Runs a command with its output in files, and notes how it went: attempt NAME COMMAND...
attempt() {
    local name="$1" started="$SECONDS" status=passed
    shift
    "$@" >"$out/$name.jsonl" 2>"$out/$name.log" || status=failed
    # Only benches print JSON lines; what others print is part of their log.
    if [[ "$name" != bench-* ]]; then
        cat "$out/$name.jsonl" >>"$out/$name.log"
        rm "$out/$name.jsonl"
    fi
    if [[ "$status" == failed ]]; then
        tail -n 20 "$out/$name.log" >&2
        failures=$((failures + 1))
    fi
    printf '{"name":"%s","status":"%s","seconds":%d}\n' "$name" "$status" "$((SECONDS - started))" >>"$out/results.jsonl"
    echo "$status: $name"
}

run_tests() {
    local program
    for program in "$here"/tests/*; do
        attempt "test-$(basename "$program")" "$program"
    done
}

run_sanitizers() {
    local sanitizer tool pair name
    sanitizer="$(command -v compute-sanitizer || echo "${CUDA_HOME:-/usr/local/cuda}/bin/compute-sanitizer")"
    for tool in "${tools[@]}"; do
        for pair in "${sanitized[@]}"; do
            name="${pair#*:}"
            attempt "$tool-$name" "$sanitizer" --tool "$tool" --error-exitcode 1 "$here/tests/${pair%%:*}" --exact "$name"
        done
    done
    for pair in "${kernels[@]/%/ $raced}" "kns=efg $raced_implicit"; do
        name="${pair%% *}" pair="${pair#* }"
        attempt "racecheck-${name#*=}" "$sanitizer" --tool racecheck --kernel-name "$name" --launch-count "$launches" --error-exitcode 1 \
            "$here/tests/${pair%%:*}" --exact "${pair#*:}"
    done
}

run_benches() {
    local bench="$here/benches/lattice"
    attempt bench-ellipsoid "$bench" --backend cuda --json --scene ellipsoid
    attempt bench-thorax "$bench" --backend cuda --json \
        --scene lung-4.5mm --scene thorax-4.5mm --scene thorax-3mm --scene thorax-1.5mm
    attempt bench-still "$bench" --backend cuda --json --still
    attempt bench-latency "$bench" --backend cuda --json --latency
    local precision
    for precision in f32 f64; do
        attempt "bench-efg-$precision" "$here/benches/efg" --backend cuda --json --precision "$precision" \
            --cells 1000 --cells 8000 --cells 80000 --cells 1000000
    done
    local model
    for model in efg lattice; do
        attempt "bench-cutting-$model" "$here/benches/cutting" --backend cuda --json --model "$model" --figure torus --figure servo --figure anew
    done
    attempt bench-cutting-thorax "$here/benches/cutting" --backend cuda --json --figure thorax
}

# The value of a key in a JSON line, cut to what a table can show; nothing where it is absent.
value() {
    sed -n "s/.*\"$2\":\"\{0,1\}\([^,\"}]*\).*/\1/p" <<<"$1" | cut -c 1-12
}

# Rows of the named keys, from the benches' JSON lines that have a certain one: table CERTAIN KEY...
table() {
    local certain="$1" line key
    shift
    printf '%-14s' "${@//_per_step/}"
    echo
    cat "$out"/bench-*.jsonl | { grep "\"$certain\":" || true; } | while read -r line; do
        for key in "$@"; do
            printf '%-14s' "$(value "$line" "$key")"
        done
        echo
    done
}

run() {
    [[ $# -ge 1 ]] || fail "run needs the folder that results go to"
    mkdir -p "$1"
    out="$(cd "$1" && pwd)"
    shift
    [[ $# -ge 1 ]] || set -- tests sanitizers benches
    failures=0
    : >"$out/results.jsonl"
    # A GPU must be there: what would be skipped without one fails.
    export PALPATE_GPU=1
    if [[ -d "$here/data" ]]; then
        export PALPATE_DATA="$here/data"
    fi
    local part
    for part in "$@"; do
        case "$part" in
            tests | sanitizers | benches) "run_$part" ;;
            *) fail "there is no part $part" ;;
        esac
    done

    echo
    if compgen -G "$out/bench-*.jsonl" >/dev/null; then
        table substeps scene nodes poisson sleeping substeps us_per_step baseline_us_per_step ratio rtf awake_nodes max_force_n
        echo
        table cg_iterations scene cells precision us_per_step device_us_per_step p99_us cg_iterations us_per_iteration true_residual rtf max_force_n
        echo
        table max_us scene nodes poisson p50_us p99_us p999_us max_us min_force_n max_force_n
        echo
    fi
    grep -h SKIPPED "$out"/*.log || true
    sed 's/[{}"]//g; s/,/  /g' "$out/results.jsonl"
    ((failures == 0)) || fail "$failures failed"
}

case "${1:-}" in
    pack) pack "${@:2}" ;;
    run) run "${@:2}" ;;
    *) fail "pack [FOLDER], or run OUT [tests|sanitizers|benches]..." ;;
esac
