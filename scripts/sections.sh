# Sourced by .ci/run and .ci/release: named steps, all of which run, also after a failure. Steps may run in
# lanes beside each other; each has a log of its own, printed when it ends. What failed is printed again at the end, where a
# reader of a long log looks first.
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT

# section NAME COMMAND [ARGUMENT...]
section() {
    local name=$1 log="$logs/${1// /_}" start=$SECONDS verdict=ok
    shift
    if ! "$@" >"$log" 2>&1; then
        verdict=FAILED
        echo "$name" >>"$logs/failed"
    fi
    local seconds=$((SECONDS - start))
    printf '%5d s  %s\n' "$seconds" "$name" >>"$logs/times"
    # Whole logs, one after another, whatever the lanes.
    {
        flock 9
        printf '\n==== %s\n$ %s\n' "$name" "$*"
        cat "$log"
        printf -- '---- %s: %s, %d s\n' "$name" "$verdict" "$seconds"
    } 9>"$logs/printing"
    touch "$log.ended"
}

# after NAME...: waits until these sections of another lane have ended. Failures do not end the wait for good: what needs
# them says what is missing.
after() {
    local name
    for name in "$@"; do
        until [ -e "$logs/${name// /_}.ended" ]; do sleep 1; done
    done
}

# lanes FUNCTION...: runs these functions beside each other.
lanes() {
    local lane
    for lane in "$@"; do
        "$lane" &
    done
    wait
}

# Ends the script: exit code 1 when a section has failed.
sections_end() {
    echo
    cat "$logs/times"
    if [ -e "$logs/failed" ]; then
        local name log
        while read -r name; do
            log="$logs/${name// /_}"
            printf '==== failed: %s\n' "$name"
            { grep -aE '^(test .* FAILED|error|FAILED )|panicked at' "$log" | head -n 20; tail -n 20 "$log"; } | cut -c 1-300
        done <"$logs/failed"
        printf 'FAILED: %s (%d s)\n' "$(paste -sd, "$logs/failed")" "$SECONDS"
        exit 1
    fi
    printf 'all sections passed (%d s)\n' "$SECONDS"
    exit 0
}
