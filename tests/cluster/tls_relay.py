"""A machine in the middle: takes encrypted connections, makes one of its own to the other end, and passes on what it reads.

tls_relay.py FOLDER_OF_PYTHON_HOST LISTEN_PORT PORT"""
import asyncio
import sys

sys.path.insert(0, sys.argv[1])
from tls import CHUNK, Tls  # noqa: E402


async def main():
    tls = Tls("on")

    async def pump(source, target):
        """Byte by byte, as far as anybody can tell."""
        try:
            while True:
                data = await source.readexactly(1)
                data += bytes(source.waiting)
                source.waiting.clear()
                target.write(data)
        except (OSError, asyncio.IncompleteReadError):
            target.close()

    async def relay(reader, writer):
        near, _, _ = await tls.opened(reader, writer, server=True)
        far, _, _ = await tls.opened(*await asyncio.open_connection("127.0.0.1", int(sys.argv[3])), server=False)
        await asyncio.gather(pump(near, far), pump(far, near))

    server = await asyncio.start_server(relay, "127.0.0.1", int(sys.argv[2]), limit=CHUNK)
    await server.serve_forever()


asyncio.run(main())
