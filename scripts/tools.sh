# Sourced by .ci/run, .ci/release and the scripts that need them: tools that cargo and apt do not bring along, below target/ci-tools.
DENY_VERSION=0.20.2
MDBOOK_VERSION=0.5.4
tools="${CARGO_TARGET_DIR:-$PWD/target}/ci-tools"
export PATH="$tools/bin:$PATH"

# `cargo deny check advisories` would clone a database from GitHub, which cannot be reached from CI: run it by hand.
install_cargo_deny() {
    if [ "$(cargo deny --version 2>/dev/null)" != "cargo-deny $DENY_VERSION" ]; then
        # Unoptimized: it runs for a second.
        CARGO_PROFILE_DEV_DEBUG=false cargo install --debug cargo-deny --version "$DENY_VERSION" --locked --root "$tools" || return
    fi
    cargo deny --version
}

install_mdbook() {
    if [ "$(mdbook --version 2>/dev/null)" != "mdbook v$MDBOOK_VERSION" ]; then
        # Without its web server.
        cargo install --debug mdbook --version "$MDBOOK_VERSION" --locked --no-default-features --features search --root "$tools"
    fi
}

# Tests of videos are skipped without it.
install_ffmpeg() {
    command -v ffmpeg || { apt-get update -qq && apt-get install -y -qq --no-install-recommends ffmpeg; } ||
        echo "skipped: ffmpeg cannot be installed, and tests of videos need it"
}
