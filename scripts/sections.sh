# Sourced by scripts/test_all.sh and .ci/run: named steps, all of which run, also after a failure. What a failed one said is
# printed again at the end, where a reader of a long log looks first.
failed=()
said=$(mktemp -d)
trap 'rm -rf "$said"' EXIT

# section NAME COMMAND [ARGUMENT...]
section() {
    local name=$1 start=$SECONDS
    shift
    printf '\n==== %s\n$ %s\n' "$name" "$*"
    if "$@" 2>&1 | tee "$said/now"; then
        printf -- '---- %s: ok, %d s\n' "$name" $((SECONDS - start))
    else
        failed+=("$name")
        mv "$said/now" "$said/${#failed[@]}"
        printf -- '---- %s: FAILED, %d s\n' "$name" $((SECONDS - start))
    fi
}

# Ends the script: exit code 1 when a section has failed.
sections_end() {
    echo
    if [ ${#failed[@]} -gt 0 ]; then
        local i
        for i in "${!failed[@]}"; do
            printf '==== failed: %s\n' "${failed[i]}"
            { grep -aE '^(test .* FAILED|error|FAILED )|panicked at' "$said/$((i + 1))" | head -n 20; tail -n 20 "$said/$((i + 1))"; } |
                cut -c 1-300
        done
        printf 'FAILED: %s (%d s)\n' "$(IFS=,; echo "${failed[*]}")" "$SECONDS"
        exit 1
    fi
    printf 'all sections passed (%d s)\n' "$SECONDS"
    exit 0
}
