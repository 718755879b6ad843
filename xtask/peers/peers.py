"""What the scripts of this folder share: pinned versions, the protocol of timing, the output."""

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time

# The versions that the scripts were written for.
PINNED = {
    "mitsuba": "3.9.1",
    "drjit": "1.5.0",
    "jax": "0.10.2",
    "jaxlib": "0.10.2",
    "numpy": "2.4.6",
    "opencv-python-headless": "5.0.0.93",
    "open3d-cpu": "0.20.0",
}

# LLVM 15 fails with Mitsuba 3.9; 19 is the version that was tried.
OLDEST_LLVM = 19

# The exit status of a script that cannot run here. 0 means done, 2 means wrong arguments.
SKIPPED = 3

# The networks and batches of `crates/sdf-nn/benches/machine/passes.rs`.
POINTS = 8192
BANDS = 6
FEATURES = 3 + 6 * BANDS
BETA = 100.0
SECONDS = 0.15
TRIES = 10


def skip(reason):
    """Says in one line why there is no result, and ends the program."""
    print("SKIPPED: " + " ".join(str(reason).split()), flush=True)
    sys.exit(SKIPPED)


def progress(text):
    """Prints a line that is no result."""
    print(text, file=sys.stderr, flush=True)


def write(result):
    """Prints the result: one JSON object, whose numbers are finite."""
    print(json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False), flush=True)


def number(text):
    """A whole number from 1, for argparse."""
    value = int(text)
    if value < 1:
        raise ValueError(text)
    return value


def kernel_options(doc):
    """The options of a script that measures passes of networks; its docstring describes it."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--threads", type=number, default=1, help="threads [default: 1]")
    parser.add_argument("--points", type=number, nargs="+", default=[POINTS, 262144],
                        help="points of a batch, one or more [default: 8192 262144]")
    parser.add_argument("--seconds", type=float, default=SECONDS,
                        help="least duration of a try [default: 0.15]")
    parser.add_argument("--tries", type=number, default=TRIES, help="tries [default: 10]")
    parser.add_argument("--seed", type=int, default=1, help="seed of the weights [default: 1]")
    return parser.parse_args()


def pin(threads):
    """Keeps the process, and all that it starts, on the first `threads` of its cores.

    Call it before an import that starts threads. Returns the number of cores, or None where the
    system knows no affinity.
    """
    if not hasattr(os, "sched_setaffinity"):
        return None
    cores = sorted(os.sched_getaffinity(0))[:threads]
    os.sched_setaffinity(0, cores)
    return len(cores)


def machine():
    """The processor, its cores, and the load when the script starts."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.split(":", 1)[1] for line in file if line.startswith("model name")]
        name = names[0].strip() if names else name
    except OSError:
        pass
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"processor": name, "cores": os.cpu_count(), "load": load}


def versions(*names):
    """The installed versions of packages, and of Python."""
    from importlib import metadata

    found = {name: metadata.version(name) for name in names}
    for name, version in found.items():
        if version != PINNED.get(name, version):
            progress(f"{name} {version} is installed, {PINNED[name]} is pinned")
    return {"python": platform.python_version(), **found}


def import_drjit():
    """Dr.Jit with a backend for CPUs, or the end of the program."""
    try:
        import drjit
    except ImportError as error:
        skip(f"{error}: run install.py, and use the Python of its folder")
    if not drjit.has_backend(drjit.JitBackend.LLVM):
        skip("Dr.Jit finds no libLLVM: install LLVM, or set DRJIT_LIBLLVM_PATH to its library")
    # Older ones end the process: they have no instructions for some operations.
    if drjit.detail.llvm_version()[0] < OLDEST_LLVM:
        skip(f"libLLVM {drjit.detail.llvm_version()[0]} is too old, {OLDEST_LLVM} works:"
             " set DRJIT_LIBLLVM_PATH to its library")
    return drjit


def measure(work, points, seconds=SECONDS, tries=TRIES):
    """Points per second of `work`, which handles `points` points and waits for its results.

    Three calls warm up, so that compilation does not count. A try repeats `work` for at least
    `seconds`.
    """
    for _ in range(3):
        work()
    rates = []
    for _ in range(tries):
        start, rounds = time.perf_counter(), 0
        while (passed := time.perf_counter() - start) < seconds or rounds == 0:
            work()
            rounds += 1
        rates.append(rounds * points / passed)
    return {"best": max(rates), "median": statistics.median(rates), "worst": min(rates)}


def failed(error):
    """The row of a pass that the peer cannot run."""
    reason = " ".join(str(error).split())[:400]
    return {"points_per_second": None, "reason": f"{type(error).__name__}: {reason}"}


def positions(count):
    """The points of dsdf's benchmark."""
    import numpy as np

    i = np.arange(count, dtype=np.float64)
    points = [np.sin(i), np.cos(1.3 * i), np.full(count, 0.2)]
    return [(0.7 * x).astype(np.float32) for x in points]


def weights(sizes, seed):
    """Weights (outputs × inputs) and biases of a perceptron, normal with the variance 2/inputs."""
    import numpy as np

    rng = np.random.default_rng(seed)
    layers = []
    for inputs, outputs in zip(sizes, sizes[1:]):
        weight = rng.normal(0, math.sqrt(2 / inputs), (outputs, inputs))
        layers.append((weight.astype(np.float32), np.zeros(outputs, np.float32)))
    return layers


def run_dsdf(program, arguments):
    """The JSON report of a command of dsdf."""
    command = [program, *arguments, "--json", "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        skip(f"{program}: {error.strerror}")
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    return json.loads(done.stdout)
