#!/usr/bin/env bash
# Builds the wheel of the Python package without optimisation of most crates, and runs its tests in
# a virtual environment under target/python. Python 3 with venv is needed: without it, apt-get is
# tried, and else the script fails.
#
# PYTHON       the interpreter [default: python3]
# DSDF_TORCH   arguments of pip that install PyTorch; without it, the tests of PyTorch are skipped
#              unless the package index has a build without CUDA for this machine
# DSDF_PROGRAM the program whose bits the commands must repeat [default: target/debug/dsdf]
#
# With the argument "build" it only builds the wheel, with "test" it only runs the tests of one.
set -euo pipefail
cd "$(dirname "$0")/../.."
step=${1:-all}
python=${PYTHON:-python3}
out=target/python
if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
  echo "Python 3 with venv is missing: trying apt-get" >&2
  { apt-get update && apt-get install --yes python3 python3-venv; } >&2 || true
  "$python" -c 'import ensurepip, venv' || {
    echo "error: the Python package is not tested: Python 3 with venv is missing" >&2
    exit 1
  }
fi
build() {
  cargo fmt --manifest-path crates/python/Cargo.toml --check
  [ -x "$out/venv/bin/python" ] || "$python" -m venv "$out/venv"
  pip() { "$out/venv/bin/python" -m pip --quiet --disable-pip-version-check "$@"; }
  pip install 'maturin>=1.8,<2' numpy pytest 'jax[cpu]'
  case "$(uname -s)-$(uname -m)" in
    Linux-x86_64) torch=${DSDF_TORCH:-} ;;
    *) torch=${DSDF_TORCH:-torch} ;;
  esac
  if [ -n "$torch" ]; then
    # shellcheck disable=SC2086
    pip install $torch
  fi
  "$out/venv/bin/python" -c 'import torch' 2>/dev/null ||
    echo "SKIPPED: the tests of PyTorch, which is not installed (see DSDF_TORCH in crates/python/ci.sh)" >&2
  export PYO3_PYTHON="$PWD/$out/venv/bin/python" CARGO_TARGET_DIR="$PWD/$out"
  manifest=crates/python/Cargo.toml
  rm -rf "$out/wheels"
  # The build compiles the package with clippy in place of rustc, so that nothing is compiled twice.
  RUSTC_WORKSPACE_WRAPPER=$(command -v clippy-driver) RUSTFLAGS="-D warnings" \
    "$out/venv/bin/maturin" build --quiet --locked --manifest-path $manifest --out "$out/wheels"
  pip install --force-reinstall --no-deps "$out"/wheels/*.whl
}
if [ "$step" != test ]; then build; fi
if [ "$step" = build ]; then exit; fi
export DSDF_PROGRAM="${DSDF_PROGRAM:-$PWD/target/debug/dsdf}"
"$out/venv/bin/python" -m pytest -q -rs --durations=5 crates/python/tests
