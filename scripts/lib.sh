# Shared by the scripts beside it; sourced, never run. Expects `set -euo pipefail` and the repository as directory.

say() { printf '== %s\n' "$*"; }

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

# A C compiler and linker, and what the NUMA package links to: name for apt, and how to tell that it is there.
install_missing() {
    local missing=()
    command -v gcc >/dev/null || missing+=(gcc libc6-dev)
    command -v pkg-config >/dev/null || missing+=(pkg-config)
    has_library hwloc || missing+=(libhwloc-dev)
    has_library libudev || missing+=(libudev-dev)
    [ ${#missing[@]} -eq 0 ] || apt_install "${missing[@]}" || exit 1
}

# Installs Debian packages as root or through sudo; where that cannot be, says what is missing and returns non-zero.
apt_install() {
    local root=() remedy=
    command -v apt-get >/dev/null || remedy="install with this system's package manager"
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || remedy="${remedy:-run as root: apt-get install $*}"
        root=(sudo)
    fi
    [ -z "$remedy" ] || { printf 'error: missing: %s; %s\n' "$*" "$remedy" >&2; return 1; }
    say "installing $*"
    # The lists of packages may be missing or old: refresh them, and let apt-get install say what is wrong.
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq update </dev/null || true
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get -qq -y --no-install-recommends install "$@" </dev/null
}

has_library() {
    command -v pkg-config >/dev/null && pkg-config --exists "$1"
}

need_rust() {
    if ! command -v cargo >/dev/null && [ -x "${CARGO_HOME:-$HOME/.cargo}/bin/cargo" ]; then
        PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
    fi
    command -v cargo >/dev/null || fail "no Rust toolchain found; install one from https://rustup.rs"
}

# The processor to build for. `.cargo/config.toml` says x86-64-v3; RUSTFLAGS takes its place where it is set.
choose_cpu() {
    [ -n "${RUSTFLAGS:-}" ] && [ -z "${WRAD_CPU:-}" ] && { say "building with RUSTFLAGS=$RUSTFLAGS"; return; }
    if [ -n "${WRAD_CPU:-}" ]; then
        export RUSTFLAGS="-C target-cpu=$WRAD_CPU"
        say "building for the processor $WRAD_CPU"
    elif [ "$(uname -m)" = x86_64 ] && ! has_v3; then
        export RUSTFLAGS="-C target-cpu=x86-64"
        say "this processor lacks AVX2, FMA or BMI2: building for any x86-64"
    fi
}

has_v3() {
    local flag
    for flag in avx2 fma bmi2; do
        grep -qw -m1 "$flag" /proc/cpuinfo || return 1
    done
}
