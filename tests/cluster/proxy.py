"""A proxy that does to connections what bad networks do: delays bytes, resets connections, flips bits. Seeded."""
import asyncio
import random
import threading
import time


class Proxy:
    """Runs in a thread of its own; use it as a context. Everything that is forwarded suffers from the same faults."""

    def __init__(self, seed, delay=0.0, bytes_to_flip=0, seconds_to_reset=0.0):
        """`bytes_to_flip`: a bit is flipped about once in so many bytes. `seconds_to_reset`: a connection lives for about so
        long. 0: never."""
        self.dice = random.Random(seed)
        self.delay, self.bytes_to_flip, self.seconds_to_reset = delay, bytes_to_flip, seconds_to_reset
        self.connections = self.bytes = self.flips = self.resets = 0
        self.loop = asyncio.new_event_loop()
        self.servers = []
        self.thread = threading.Thread(target=self.loop.run_forever)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        asyncio.run_coroutine_threadsafe(self.end(), self.loop).result(10)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()

    async def end(self):
        for server in self.servers:
            server.close()
        tasks = [t for t in asyncio.all_tasks() if t is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def forward(self, port, to):
        """Connections to `port` go on to the port `to`, both on the loopback."""
        async def listen():
            async def accepted(reader, writer):
                await self.connection(reader, writer, to)
            self.servers.append(await asyncio.start_server(accepted, "127.0.0.1", port))
        asyncio.run_coroutine_threadsafe(listen(), self.loop).result(10)

    async def connection(self, reader, writer, to):
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", to)
        except OSError:
            writer.transport.abort()
            return
        self.connections += 1
        pumps = [asyncio.ensure_future(self.pump(reader, far_writer)), asyncio.ensure_future(self.pump(far_reader, writer))]
        life = self.dice.uniform(0.2, 2) * self.seconds_to_reset or None
        try:
            done, _ = await asyncio.wait(pumps, timeout=life, return_when=asyncio.FIRST_COMPLETED)
            self.resets += not done
        finally:
            for pump in pumps:
                pump.cancel()
            for w in (writer, far_writer):
                w.transport.abort()

    async def pump(self, reader, writer):
        """Bytes leave `delay` after they came, however many are on the way."""
        chunks = asyncio.Queue(maxsize=1000)

        async def read():
            while data := await reader.read(1 << 16):
                await chunks.put((time.monotonic() + self.delay, self.flipped(data)))
            await chunks.put((time.monotonic() + self.delay, b""))

        reading = asyncio.ensure_future(read())
        try:
            while True:
                due, data = await chunks.get()
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                if not data:
                    return
                writer.write(data)
                await writer.drain()
        except OSError:
            return
        finally:
            reading.cancel()

    def flipped(self, data):
        self.bytes += len(data)
        if not self.bytes_to_flip or self.dice.random() >= len(data) / self.bytes_to_flip:
            return data
        self.flips += 1
        data = bytearray(data)
        data[self.dice.randrange(len(data))] ^= 1 << self.dice.randrange(8)
        return bytes(data)
