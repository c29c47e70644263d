"""The socket of `nerfmodal up`: answers on a kept connection do not wait for the reader's acknowledgement."""

import asyncio
import socket
from contextlib import closing

import pytest

from services.cli.up import PortTaken, listen


def test_connections_send_at_once() -> None:
    """Seen to fail: without IPPROTO_TCP in `listen` the option is 0, and GET /healthz takes 44 ms, not 1.4 ms."""

    async def option_of_a_connection(listener: socket.socket) -> int:
        found: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        def accept(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            found.set_result(writer.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()

        async with await asyncio.start_server(accept, sock=listener):
            _, writer = await asyncio.open_connection(*listener.getsockname()[:2])
            option = await asyncio.wait_for(found, 5)
            writer.close()
            await writer.wait_closed()
        return option

    with closing(listen(0)) as listener:
        assert asyncio.run(option_of_a_connection(listener)) != 0


def test_a_port_that_is_taken_is_refused() -> None:
    with closing(listen(0)) as first, pytest.raises(PortTaken, match="cannot listen at"):
        listen(first.getsockname()[1])
