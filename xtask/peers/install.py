"""Installs the peers, with pinned versions, into a virtual environment of its own.

    python3 install.py FOLDER

It prints one JSON object with the versions and the path of the Python to use. Where it cannot
install, it prints one line that starts with SKIPPED, and ends with the exit status 3.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import venv

import peers

# Older versions of Python have no wheels of the pinned versions.
OLDEST_PYTHON = (3, 11)


def run(command):
    """The output of a command, or the end of the program."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()
        errors = [line for line in lines if "error" in line.lower()]
        peers.skip(f"{' '.join(map(str, command[:4]))} ...: {(errors or lines)[-1]}")
    return done.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path, help="folder of the virtual environment")
    folder = parser.parse_args().folder.resolve()
    if sys.version_info < OLDEST_PYTHON:
        peers.skip("the pinned versions need Python {}.{} or later".format(*OLDEST_PYTHON))
    try:
        venv.create(folder, with_pip=True)
    except (OSError, subprocess.CalledProcessError) as error:
        peers.skip(f"no virtual environment: {error}")
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    wanted = [f"{name}=={version}" for name, version in peers.PINNED.items()]
    peers.progress(f"installing {' '.join(wanted)}")
    options = ["--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
    run([python, "-m", "pip", "install", *options, *wanted])
    names = ", ".join(repr(name) for name in peers.PINNED)
    here = str(pathlib.Path(__file__).resolve().parent)
    check = (f"import json, sys; sys.path.insert(0, {here!r}); import peers; "
             f"print(json.dumps(peers.versions({names})))")
    found = json.loads(run([python, "-c", check]))
    # Dr.Jit finds its compiler when it runs. Without it the scripts of Dr.Jit and Mitsuba skip.
    backend = "drjit.detail.llvm_version() if drjit.has_backend(drjit.JitBackend.LLVM) else None"
    llvm = json.loads(run([python, "-c", f"import drjit, json; print(json.dumps({backend}))"]))
    peers.write({"python": str(python), "versions": found,
                 "llvm": llvm and ".".join(map(str, llvm)), "oldest_llvm": peers.OLDEST_LLVM})


if __name__ == "__main__":
    main()
