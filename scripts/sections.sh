# Sourced by scripts/test_all.sh and .ci/run: named steps, all of which run, also after a failure.
failed=()

# section NAME COMMAND [ARGUMENT...]
section() {
    local name=$1 start=$SECONDS
    shift
    printf '\n==== %s\n$ %s\n' "$name" "$*"
    if "$@"; then
        printf -- '---- %s: ok, %d s\n' "$name" $((SECONDS - start))
    else
        failed+=("$name")
        printf -- '---- %s: FAILED, %d s\n' "$name" $((SECONDS - start))
    fi
}

# Ends the script: exit code 1 when a section has failed.
sections_end() {
    echo
    if [ ${#failed[@]} -gt 0 ]; then
        printf 'FAILED: %s (%d s)\n' "$(IFS=,; echo "${failed[*]}")" "$SECONDS"
        exit 1
    fi
    printf 'all sections passed (%d s)\n' "$SECONDS"
    exit 0
}
