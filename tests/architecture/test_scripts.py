"""The scripts that prepare a machine, run against a machine made of fakes."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def fake(folder: Path, command: str, body: str) -> None:
    path = folder / command
    path.write_text(f"#!/bin/bash\n{body}\n")
    path.chmod(0o755)


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A venv with one wheel, and commands that write down how they were called."""
    wheel = tmp_path / "venv/lib/python3.11/site-packages/open3d"
    wheel.mkdir(parents=True)
    (wheel / "pybind.cpython-311-x86_64-linux-gnu.so").touch()
    commands = tmp_path / "bin"
    commands.mkdir()
    fake(commands, "ldd", "printf '\\tlibc.so.6 => /lib/libc.so.6 (0x0)\\n'")
    fake(commands, "apt-get", f'echo "apt-get $*" >> {tmp_path}/calls')
    fake(commands, "id", "echo 0")
    fake(commands, "sudo", "exit 1")
    return tmp_path


def libraries(machine: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PATH": f"{machine / 'bin'}:{os.environ['PATH']}"}
    command = [str(ROOT / "deploy/system-libraries.sh"), str(machine / "venv")]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def lacks(machine: Path, *sonames: str) -> None:
    fake(machine / "bin", "ldd", "\n".join(f"printf '\\t{soname} => not found\\n'" for soname in sonames))


def calls(machine: Path) -> list[str]:
    path = machine / "calls"
    return path.read_text().splitlines() if path.exists() else []


def test_nothing_missing_does_and_says_nothing(machine: Path):
    done = libraries(machine)
    assert (done.returncode, done.stdout, done.stderr, calls(machine)) == (0, "", "", [])


def test_root_installs_the_packages_of_what_is_missing_after_one_update(machine: Path):
    lacks(machine, "libusb-1.0.so.0", "libGL.so.1", "libGL.so.1")
    assert libraries(machine).returncode == 0
    update, install = calls(machine)
    assert update.startswith("apt-get update")
    assert install.split()[-2:] == ["libgl1", "libusb-1.0-0"]


def test_drivers_of_graphics_cards_are_not_asked_for(machine: Path):
    lacks(machine, "libcuda.so.1", "libamdhip64.so.6", "libze_loader.so.1")
    assert libraries(machine).returncode == 0
    assert calls(machine) == []


def test_without_rights_one_line_says_what_to_type(machine: Path):
    lacks(machine, "libGL.so.1")
    fake(machine / "bin", "id", "echo 1000")
    done = libraries(machine)
    assert done.returncode == 1
    assert calls(machine) == []
    assert len(done.stderr.strip().splitlines()) == 1
    assert "apt-get install -y --no-install-recommends libgl1" in done.stderr


def test_passwordless_sudo_is_used(machine: Path):
    lacks(machine, "libGL.so.1")
    fake(machine / "bin", "id", "echo 1000")
    fake(machine / "bin", "sudo", 'shift; exec "$@"')
    assert libraries(machine).returncode == 0
    assert len(calls(machine)) == 2


def test_a_machine_without_python_3_11_is_told_what_to_install(tmp_path: Path):
    for command in ("python3.11", "python3", "python"):
        fake(tmp_path, command, "exit 1")
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    command = [str(ROOT / "deploy/make-venv.sh"), str(tmp_path / "venv")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "python3.11-venv" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_venv_that_debian_packs_apart_is_installed_and_tried_again(machine: Path):
    python = f'case "$*" in *venv*) [ -e {machine}/calls ] && mkdir -p "${{@: -1}}";; *) exit 0;; esac'
    fake(machine / "bin", "python3.11", python)
    environment = os.environ | {"PATH": f"{machine / 'bin'}:{os.environ['PATH']}"}
    command = [str(ROOT / "deploy/make-venv.sh"), str(machine / "new")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, (machine / "new").is_dir()) == (0, True)
    assert calls(machine)[-1].endswith("python3.11-venv")


def browser(machine: Path, *found: str) -> subprocess.CompletedProcess[str]:
    """deploy/browser.sh on a machine whose commands are the fakes, the shell's own and these."""
    for command in found:
        fake(machine / "bin", command, "exit 0")
    fake(machine / "bin", "dirname", 'echo "${1%/*}"')
    environment = {"PATH": str(machine / "bin")}
    command = ["/bin/bash", str(ROOT / "deploy/browser.sh")]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_browser_is_installed_once(machine: Path):
    assert browser(machine).returncode == 0
    assert [call.split()[-1] for call in calls(machine)] == ["-qq", "chromium"]
    done = browser(machine, "chromium")
    assert (done.returncode, done.stdout, len(calls(machine))) == (0, "", 2)


def test_without_rights_the_page_s_tests_are_skipped_and_a_line_says_what_to_type(machine: Path):
    fake(machine / "bin", "id", "echo 1000")
    done = browser(machine)
    assert (done.returncode, calls(machine)) == (0, [])
    assert "apt-get install -y --no-install-recommends chromium" in done.stderr


@pytest.mark.parametrize(("check", "test", "code"), [(0, 0, 0), (2, 0, 2), (0, 1, 1), (2, 1, 1)])
def test_continuous_integration_fails_with_what_failed_and_tests_speak_last(
    tmp_path: Path, check: int, test: int, code: int
):
    body = f'case $1 in check) echo checked; exit {check};; test) echo "== 3 passed in 1s =="; exit {test};; esac'
    fake(tmp_path, "make", body)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run([str(ROOT / ".ci/run")], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert done.stdout.splitlines() == ["checked", "== 3 passed in 1s =="]
