#!/usr/bin/env bash
# Tests the Python package, by its wheel in a virtual environment under target/python. The wheel is
# built in the profile of the tests, whose build it shares.
#
#   ci.sh [install | build | test]    one step; all three without an argument
#
# Python 3 with venv is needed: without it, apt-get is tried, and else the script fails.
#
# PYTHON       the interpreter [default: python3]
# DSDF_TORCH   arguments of pip that install PyTorch; without it, the tests of PyTorch are skipped
#              unless the package index has a build without CUDA for this machine
# The method of nerfbaselines is tested where that package is; else its tests are skipped.
# Files are checked by USD's validators (usd-core) and, where npm is there, by that of Khronos.
#
# DSDF_XTASK   `xtask`, which builds the wheel [default: cargo xtask]
# DSDF_PROGRAM the program whose bits the commands must repeat [default: target/ci/dsdf, which
#              `cargo build --profile ci` builds]; without it, these tests are skipped
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$PWD/target/python
pip() { "$out/venv/bin/python" -m pip --quiet --disable-pip-version-check "$@"; }

install() {
  python=${PYTHON:-python3}
  if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    echo "Python 3 with venv is missing: trying apt-get" >&2
    { apt-get update && apt-get install --yes python3 python3-venv; } >&2 || true
    "$python" -c 'import ensurepip, venv' || {
      echo "error: the Python package is not tested: Python 3 with venv is missing" >&2
      exit 1
    }
  fi
  [ -x "$out/venv/bin/python" ] || "$python" -m venv "$out/venv"
  pip install 'maturin>=1.8,<2' numpy pytest 'jax[cpu]' tensorboard usd-core
  case "$(uname -s)-$(uname -m)" in
    Linux-x86_64) torch=${DSDF_TORCH:-} ;;
    *) torch=${DSDF_TORCH:-torch} ;;
  esac
  # The validator of Khronos is a package of npm, which not every machine has.
  if command -v npm >/dev/null; then
    npm install --silent --prefix "$out/npm" gltf-validator >/dev/null || true
  fi
  if [ -n "$torch" ]; then
    # shellcheck disable=SC2086
    pip install $torch
  fi
  "$out/venv/bin/python" -c 'import torch' 2>/dev/null ||
    echo "SKIPPED: the tests of PyTorch, which is not installed (see DSDF_TORCH in crates/python/ci.sh)" >&2
}

build() {
  rm -rf "$out/wheels"
  # It tries the wheel in a fresh environment, too.
  PYO3_PYTHON="$out/venv/bin/python" PYTHON="$out/venv/bin/python" MATURIN="$out/venv/bin/maturin" \
    ${DSDF_XTASK:-cargo xtask} dist --only wheel --profile ci --output "$out/wheels"
  pip install --force-reinstall --no-deps "$out"/wheels/*.whl
}

run_tests() {
  export DSDF_PROGRAM="${DSDF_PROGRAM:-$PWD/target/ci/dsdf}"
  export DSDF_NODE_MODULES="$out/npm/node_modules"
  "$out/venv/bin/python" -m pytest -q -rs --durations=5 crates/python/tests \
    integrations/nerfbaselines
}

case ${1:-all} in
  install) install ;;
  build) build ;;
  test) run_tests ;;
  all) install; build; run_tests ;;
  *) echo "error: step: found $1, expected install, build or test" >&2; exit 2 ;;
esac
