#!/usr/bin/env bash
# Makes a wheel in target/wheels that other machines install without a compiler: Linux on x86-64 since 2018 (glibc 2.28).
#
# It needs a Rust toolchain, g++ and Python with venv, and no root. zig, from PyPI, links for an older C library than this
# system has. The C++ library stays the system's, because SUMO uses that one, too.
set -euo pipefail
cd "$(dirname "$0")/.."
glibc=2.28
target=x86_64-unknown-linux-gnu
export CARGO_TARGET_DIR=$PWD/target/wheel
tools=$CARGO_TARGET_DIR/tools
python3 -m venv "$tools"
export PATH=$tools/bin:$PATH
pip install -q 'auditwheel>=6' 'cargo-zigbuild>=0.20' 'maturin>=1.9.4,<2' 'ziglang>=0.13'

# zig takes the name `stdc++` for a library of its own.
mkdir -p "$tools/lib"
ln -sf "$(realpath "$(g++ -print-file-name=libstdc++.so)")" "$tools/lib/libsystem_stdcxx.so"
export CXXSTDLIB=system_stdcxx RUSTFLAGS="-L native=$tools/lib"
export CC_x86_64_unknown_linux_gnu=gcc CXX_x86_64_unknown_linux_gnu=g++

cargo zigbuild --release --locked --target "$target.$glibc" --bin dials-traffic
rm -rf target/wheels
DIALS_PROGRAM=$CARGO_TARGET_DIR/$target/release/dials-traffic pip wheel --no-build-isolation --no-deps -w target/wheels \
  --config-settings=build-args="--zig --target $target --compatibility manylinux_${glibc/./_}" ./python
said=$(auditwheel show target/wheels/*.whl)
echo "$said"
grep -q "manylinux_${glibc/./_}_x86_64" <<< "$said" || { echo "the wheel needs a newer glibc than $glibc" >&2; exit 1; }
find target/wheels -name '*.whl' -size +12M -exec sh -c 'echo "$1 has over 12 MB" >&2; exit 1' sh {} +
ls -lh target/wheels
