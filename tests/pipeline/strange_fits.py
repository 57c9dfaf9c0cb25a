"""Fits that end in other ways than fits do, by the names of their meshes; for the workers of a test.

A worker loads this where it is found as `sitecustomize`. Each try adds a letter to the file <mesh>.tries.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

SIGNALS = {"killed": signal.SIGKILL, "crashed": signal.SIGSEGV}


def strange(fit):
    def fit_spheres_file(mesh, *given, **options):
        name = Path(mesh).stem
        with Path(f"{mesh}.tries").open("a") as tries:
            tries.write("I")
        if name in SIGNALS:
            os.kill(os.getpid(), SIGNALS[name])
        if name == "once" and Path(f"{mesh}.tries").read_text() == "I":
            os.kill(os.getpid(), signal.SIGSEGV)
        if name == "left":
            print("first\nno wood; plant trees", file=sys.stderr, flush=True)
            os._exit(3)
        if name == "loud":
            os.write(1, b"a library says much\n" * 100_000)
        if name == "faulty":
            raise ZeroDivisionError(f"in {mesh}\nof two lines")
        if name == "endless":
            child = subprocess.Popen(["sleep", "600"])
            Path(f"{mesh}.new").write_text(f"{os.getpid()} {child.pid}")
            os.replace(f"{mesh}.new", f"{mesh}.pids")
            time.sleep(600)
        return fit(mesh, *given, **options)

    return fit_spheres_file


if "aoprecalc.pipeline.worker" in sys.orig_argv:
    from aoprecalc.pipeline import jobs

    jobs.fit_spheres_file = strange(jobs.fit_spheres_file)
