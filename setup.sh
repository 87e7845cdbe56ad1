#!/usr/bin/env bash
# Installs the Debian 12 packages that dials-traffic needs, and checks the Rust toolchain. You may run it again at any time.
# You may name further packages: `./setup.sh xvfb ffmpeg` installs all that `replay --video` can use.
# `./setup.sh mpi` installs what the feature `mpi` needs to compile, and `mpirun`.
set -euo pipefail

more=()
for word in "$@"; do
  case "$word" in
    mpi) more+=(openmpi-bin libopenmpi-dev) ;;
    *) more+=("$word") ;;
  esac
done

packages=(
  sumo                  # simulator, netconvert, sumo-gui, libsumo with its headers
  libtorch-dev          # for TorchScript export, and as the yardstick of `bench`
  libopenblas0-pthread  # libtorch's BLAS: with the reference BLAS that yardstick is many times slower
  libclang-dev g++      # to bind libsumo: bindgen needs libclang, the shim needs a C++17 compiler
  pkg-config
  python3               # sumo_nets/make.py makes the shipped scenarios again; a test runs it
  python3-venv          # for `pip install ./python` in an environment of its own
  "${more[@]}"
)

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
