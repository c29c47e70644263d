"""The supervisor's process stays light: the science's wheels are loaded by runners alone."""

import subprocess
import sys

HEAVY = ("torch", "bpy", "open3d", "numba", "trimesh", "scipy")


def test_worker_imports_nothing_heavy() -> None:
    program = (
        "import sys, services.worker.main, scanjobs.fsck, scanjobs.control\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
