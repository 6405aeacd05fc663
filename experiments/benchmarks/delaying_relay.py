"""Relay between workers and a scheduler that hands each message on later; it prints its port."""

import asyncio
import sys


async def pass_on(reader, writer, delay):
    """Write what is read, each part `delay` seconds after it has come."""
    clock, waiting = asyncio.get_running_loop().time, asyncio.Queue()

    async def write():
        while (part := await waiting.get()) is not None:
            due, data = part
            await asyncio.sleep(max(0.0, due - clock()))
            writer.write(data)
            await writer.drain()
        writer.close()

    writing = asyncio.create_task(write())
    while data := await reader.read(1 << 20):
        waiting.put_nowait((clock() + delay, data))
    waiting.put_nowait(None)
    await writing


async def main(host, port, delay):
    async def connect(reader, writer):
        far_reader, far_writer = await asyncio.open_connection(host, int(port))
        both = (reader, far_writer), (far_reader, writer)
        await asyncio.gather(*(pass_on(*way, float(delay)) for way in both), return_exceptions=True)

    server = await asyncio.start_server(connect, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
