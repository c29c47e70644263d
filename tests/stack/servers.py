"""A PostgreSQL and a Redis of the test's own: private folders, free ports, loopback only.

Their programs come from Debian's packages `postgresql` and `redis-server`. PostgreSQL refuses to run as root, so there
it runs as the package's user `postgres`.
"""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

POSTGRES_HOMES = "/usr/lib/postgresql/*/bin"
START_S = 20.0


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def postgres_program(name: str) -> str | None:
    """The newest installed `initdb`, `pg_ctl` or `postgres`."""
    found = sorted(Path("/").glob(f"{POSTGRES_HOMES[1:]}/{name}"), key=lambda path: int(path.parts[4]))
    return str(found[-1]) if found else shutil.which(name)


class Postgres:
    """One cluster."""

    def __init__(self) -> None:
        # not in pytest's folder, which pytest closes to other users, such as the one that PostgreSQL runs as
        self.folder = Path(tempfile.mkdtemp(prefix="nerfmodal-postgres-"))
        self.port = free_port()
        if os.geteuid() == 0:
            shutil.chown(self.folder, "postgres")
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
        options = f"-c listen_addresses=127.0.0.1 -p {self.port} -k {self.folder} -c fsync=off"
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

    def _run(self, name: str, *arguments: str) -> None:
        program = postgres_program(name)
        assert program is not None
        subprocess.run(
            [program, *arguments],
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            cwd="/",
            user="postgres" if os.geteuid() == 0 else None,
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
        self._process = subprocess.Popen(["redis-server", *options], stdout=subprocess.DEVNULL)
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
