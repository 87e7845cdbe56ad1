#!/usr/bin/env bash
# Installs the Debian 12 packages that dials-traffic needs, and checks the Rust toolchain. You may run it again at any time.
#
#   ./setup.sh          what building and training need
#   ./setup.sh torch    also libtorch, for the feature `torch`: `export`, and a figure of `bench`
#   ./setup.sh mpi      also Open MPI, for the feature `mpi`: training over several machines
#   ./setup.sh all      also all that the tests need, torch and mpi included
#
# Other words are names of packages: `./setup.sh xvfb ffmpeg` installs all that `replay --video` can use.
set -euo pipefail

packages=(
  sumo     # simulator, netconvert, sumo-gui, libsumo; its headers for a test
  g++      # the shim over libsumo needs a C++17 compiler
  python3  # sumo_nets/make.py makes the shipped scenarios again
)
torch=(
  libtorch-dev          # TorchScript, and the yardstick of `bench`
  libopenblas0-pthread  # libtorch's BLAS: with the reference BLAS that yardstick is many times slower
)
mpi=(
  openmpi-bin libopenmpi-dev  # mpirun, the library with its headers
  libclang-dev                # bindgen, which binds the library, needs libclang
)
tests=(
  xvfb xauth  # a screen in memory, for sumo-gui
  strace      # for the test of power loss
)

for word in "$@"; do
  case "$word" in
    torch) packages+=("${torch[@]}") ;;
    mpi) packages+=("${mpi[@]}") ;;
    all) packages+=("${torch[@]}" "${mpi[@]}" "${tests[@]}") ;;
    *) packages+=("$word") ;;
  esac
done

say() { printf 'setup: %s\n' "$*"; }
fail() { say "$*" >&2; exit 1; }

command -v apt-get >/dev/null || fail "no apt-get here: install by hand the packages that correspond to: ${packages[*]}"

missing=()
for package in "${packages[@]}"; do
  [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
done

if [ "${#missing[@]}" -eq 0 ]; then
  say "all Debian packages are installed: ${packages[*]}"
else
  if [ "$(id -u)" -eq 0 ]; then as_root=(); else
    command -v sudo >/dev/null || fail "run me as root, or install sudo; missing: ${missing[*]}"
    as_root=(sudo)
  fi
  say "installing ${missing[*]}"
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
  say "installed ${missing[*]}"
fi

needed=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' "$(dirname "$0")/Cargo.toml")
command -v cargo >/dev/null ||
  fail "no cargo on the PATH: install Rust $needed or newer with rustup (https://rustup.rs), then open a new shell"
have=$(rustc --version | cut -d ' ' -f 2)
[ "$(printf '%s\n' "$needed" "$have" | sort -V | head -n 1)" = "$needed" ] ||
  fail "Rust $have is too old: this needs $needed or newer; run: rustup update"
say "Rust $have; ready: cargo run --release -- train configs/smoke_traffic.toml"
