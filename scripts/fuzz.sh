#!/usr/bin/env bash
# Fuzzes every target for some seconds: scripts/fuzz.sh SECONDS [TARGET ...]. Needs a nightly compiler and cargo-fuzz. What
# is found lies in fuzz/artifacts; the corpus in fuzz/corpus is not committed. Ends with the number of executions of each
# target, and with an error where one has failed. With QUADLIFT_FUZZ_SEED each run starts alike. Without a sanitizer:
# there is no unsafe code, and it is twice as fast.
set -uo pipefail
cd "$(dirname "$0")/.."

seconds="${1:?usage: scripts/fuzz.sh SECONDS [TARGET ...]}"
shift
if ! cargo +nightly fuzz --version >/dev/null 2>&1; then
    echo "fuzzing needs a nightly compiler and cargo-fuzz: rustup toolchain install nightly && cargo install cargo-fuzz" >&2
    exit 2
fi
targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
    mapfile -t targets < <(basename -a fuzz/seeds/* | sort)
fi
for target in "${targets[@]}"; do
    if [ ! -d "fuzz/seeds/$target" ]; then
        echo "there is no target $target; the targets are $(basename -a fuzz/seeds/* | tr '\n' ' ')" >&2
        exit 2
    fi
done
# The examples on the pages of formats.
QUADLIFT_WRITE_SEEDS=1 cargo test -q -p quadlift-io --test fuzz_seeds examples_of_formats >/dev/null || exit 1
summary=""
failed=0
for target in "${targets[@]}"; do
    mkdir -p "fuzz/corpus/$target" "fuzz/artifacts/$target"
    log="fuzz/artifacts/$target.log"
    if ! QUADLIFT_FUZZ_TARGET="$target" cargo +nightly fuzz run -s none --codegen-units 16 quadlift "fuzz/corpus/$target" "fuzz/seeds/$target" -- \
        -artifact_prefix="fuzz/artifacts/$target/" -seed="${QUADLIFT_FUZZ_SEED:-0}" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 -max_len=20000 -print_final_stats=1 >"$log" 2>&1; then
        failed=1
        tail -n 40 "$log"
    fi
    executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    summary+=$(printf '%-16s %12s executions' "$target" "${executions:-none}")$'\n'
done
printf '%s' "$summary"
exit $failed
