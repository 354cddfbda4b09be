#!/usr/bin/env python3
"""A host of the cluster that only intersects: it holds parts of triangles, and answers for them with Embree for Python.

Written from src/wire/README.md and src/parts/README.md. Run tools/python_host/prepare.sh first; it prints the python to
use. Such a host computes other bits than the C++ ones, says so (fingerprint 0, allow_inexact), and the report says
bit_exact: false.
"""
import argparse
import asyncio
import collections
import os
import pathlib
import resource
import secrets
import signal
import sys
import time

import numpy as np

import frames
from frames import Link, Manifest, WireError, pb
from intersect import Hits, Part, bits, occluded
from part_file import PartError
from tls import Tls

CATEGORIES = [pb.LOADER, pb.UNLOADER, pb.INTERSECTION]
FEATURES = ["triangles"]
CHUNK = 1 << 20     # of a blob
AHEAD = 4           # requests on the way
OTHERS_TURN = 3     # seconds in which the other host with the larger number connects
ATTEMPTS = 1        # seconds between attempts
RETURNS = 1.5       # seconds in which a manager waits for a host whose connection broke
MAX_COORDINATE = 1e18


class Refused(Exception):
    pass


def say(text):
    print(text, file=sys.stderr, flush=True)


class Peer:
    """Another worker, or the manager (number 0)."""

    def __init__(self, host, own_incarnation, incarnation, address=""):
        self.host, self.incarnation, self.address = host, incarnation, address
        self.link = Link(own_incarnation, incarnation)
        self.writer = None
        self.sent = 0  # bytes
        self.connector = None
        self.ack_timer = None

    def send(self, name, control, bulk=b""):
        self.link.unsent.append(frames.encode(name, control, bulk))
        self.pump()

    def pump(self):
        if self.writer is None:
            return
        data = b"".join(self.link.outgoing())
        if data:
            self.writer.write(data)
            self.sent += len(data)
        if self.link.unreported_frames and self.ack_timer is None:
            self.ack_timer = asyncio.get_running_loop().call_later(frames.ACK_DELAY, self.acknowledge)

    def acknowledge(self):
        self.ack_timer = None
        if self.writer is not None and self.link.unreported_frames:
            self.writer.write(self.link.acknowledgement())

    def attach(self, writer):
        if self.writer is not None:
            self.writer.close()
        self.writer = writer
        for f in self.link.reconnected():
            writer.write(f)
        self.pump()


class Host:
    def __init__(self, options, token):
        self.options, self.token, self.tls = options, token, Tls(options.tls)
        self.incarnation = secrets.randbits(63) | 1
        self.manager, self.number = None, 0
        self.heartbeat = 0.5
        self.peers = {}
        self.server = None
        self.over = asyncio.Event()
        self.ended_well = self.leaving = False
        self.work = asyncio.Queue()  # blocks, and what must not overtake them
        self.queued_rays, self.open_blocks = 0, 0
        self.blobs, self.next_request = {}, 1  # futures by request
        self.counters = pb.Counters()
        self.rays_per_s = self.busy_s = self.load_s = 0.0
        self.forget_job()

    def forget_job(self):
        self.job = self.manifest = None
        self.parts, self.wanted = {}, set()
        self.to_load = collections.deque()
        self.epoch = self.generation = self.refuse_below = 0
        self.early = []
        self.bytes_used = 0

    # ---- connections ----
    async def run(self):
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGTERM, self.leave)
        loop.add_signal_handler(signal.SIGINT, self.leave)
        host, port = self.options.listen.rsplit(":", 1)
        self.server = await asyncio.start_server(self.accept, host, int(port))
        self.address = "%s:%d" % self.server.sockets[0].getsockname()[:2]
        tasks = [asyncio.create_task(t) for t in (self.stay_with_manager(), self.beat(), self.work_off())]
        await asyncio.wait([*tasks, asyncio.create_task(self.over.wait())], return_when=asyncio.FIRST_COMPLETED)
        for t in tasks:
            if t.done() and t.exception():
                raise t.exception()
        return 0 if self.ended_well else 4

    async def stay_with_manager(self):
        host, port = self.options.manager.rsplit(":", 1)
        patience = time.monotonic() + self.options.wait
        while not self.over.is_set():
            try:
                reader, writer = await asyncio.open_connection(host, int(port))
                reader = await self.meet_manager(reader, writer)
                patience = None
                await self.listen_to(self.manager, reader)
            except (OSError, asyncio.IncompleteReadError, WireError) as e:
                why = str(e) or "closed"
                if self.manager:
                    self.manager.writer = None
                if self.ended_well:
                    return
                patience = patience or time.monotonic() + RETURNS
                if time.monotonic() > patience:
                    raise Refused(f"the manager at {self.options.manager} does not answer: {why}") from e
            await asyncio.sleep(0.2)

    async def meet_manager(self, reader, writer):
        reader, writer, binding = await self.tls.opened(reader, writer, server=False)
        await frames.greet(reader, writer, "connects", self.token, binding)
        hello = pb.Hello(protocol=frames.VERSION, incarnation=self.incarnation, name=self.options.name, listen=self.address,
                         memory=self.options.memory, threads=1, categories=CATEGORIES, features=FEATURES,
                         instruction_set="embreex", fingerprint=0, allow_inexact=True, version="python_host")
        if self.manager:
            hello.manager = self.manager.incarnation
        writer.write(frames.frame(frames.encode("Hello", hello)))
        _, payload = await frames.read_frame(reader)
        answer = frames.decode(payload)
        if answer.name == "Refused":
            raise Refused(f"the manager refuses this host: {answer.control.reason}")
        if answer.name != "Welcome":
            raise WireError(f"{answer.name} instead of Welcome")
        if not self.manager:
            self.number, self.heartbeat = answer.control.host, max(0.05, answer.control.heartbeat_s)
            self.manager = Peer(0, self.incarnation, answer.control.incarnation)
            say(f"this is host {self.number}")
        self.manager.attach(writer)
        return reader

    async def listen_to(self, peer, reader):
        while True:
            header, payload = await frames.read_frame(reader)
            self.counters.bytes_received += frames.HEADER_BYTES + len(payload)
            if payload:
                frames.decode(payload)  # altered ones must not be acknowledged
            for ready in peer.link.receive(header, payload):
                self.handle(peer, frames.decode(ready))
            peer.pump()

    async def meet_peer(self, reader, writer, role):
        """The peer is known only by what it says of itself."""
        reader, writer, binding = await self.tls.opened(reader, writer, server=role == "accepts")
        await frames.greet(reader, writer, role, self.token, binding)
        hello = pb.PeerHello(protocol=frames.VERSION, host=self.number, incarnation=self.incarnation)
        writer.write(frames.frame(frames.encode("PeerHello", hello)))
        _, payload = await frames.read_frame(reader)
        answer = frames.decode(payload)
        peer = self.peers.get(answer.control.host) if answer.name == "PeerHello" else None
        if not peer or peer.incarnation != answer.control.incarnation:
            raise WireError(f"{answer.name} of a host that is not on the list")
        peer.attach(writer)
        try:
            await self.listen_to(peer, reader)
        finally:
            if peer.writer is writer:
                peer.writer = None

    async def accept(self, reader, writer):
        try:
            await self.meet_peer(reader, writer, "accepts")
        except (OSError, asyncio.IncompleteReadError, WireError) as e:
            if not isinstance(e, asyncio.IncompleteReadError):
                say(f"a connection was closed: {e}")
        finally:
            writer.close()

    async def keep_connected(self, peer):
        if self.number < peer.host:
            await asyncio.sleep(OTHERS_TURN)
        host, port = peer.address.rsplit(":", 1)
        while self.peers.get(peer.host) is peer:
            if peer.writer is None:
                try:
                    reader, writer = await asyncio.open_connection(host, int(port))
                    await self.meet_peer(reader, writer, "connects")
                except (OSError, asyncio.IncompleteReadError, WireError) as e:
                    say(f"host {peer.host}: {e or 'closed'}")
            await asyncio.sleep(ATTEMPTS)

    def update_hosts(self, entries):
        there = {e.host: e for e in entries if e.host not in (0, self.number)}
        for number in [n for n in self.peers if n not in there]:
            peer = self.peers.pop(number)
            peer.connector.cancel()
            if peer.writer is not None:
                peer.writer.close()
        for number, e in there.items():
            if number not in self.peers:
                peer = self.peers[number] = Peer(number, self.incarnation, e.incarnation, e.address)
                peer.connector = asyncio.create_task(self.keep_connected(peer))

    # ---- messages ----
    def handle(self, peer, m):
        handler = getattr(self, "on_" + m.name, None)
        if handler and (peer.host == 0 or m.name == "SubmitTask"):
            return handler(peer, m)
        self.counters.dropped_messages += 1

    def on_JobStart(self, _, m):
        self.forget_job()
        self.job = m.control.job
        asyncio.create_task(self.load(m.control))

    def on_LoadParts(self, _, m):
        self.wanted.update(m.control.parts)
        self.to_load.extend(m.control.parts)

    def on_UnloadParts(self, _, m):
        self.refuse_below = max(self.refuse_below, m.control.epoch)
        self.work.put_nowait(("unload", list(m.control.parts)))

    def on_BlobChunk(self, _, m):
        waiting = self.blobs.pop(m.control.request, None)
        if waiting and not waiting.done():
            waiting.set_result(m.control)

    def on_HostList(self, _, m):
        self.update_hosts(m.control.hosts)

    def on_SceneHostMap(self, _, m):
        if m.control.epoch <= self.epoch:
            return
        again = self.generation not in (0, m.control.generation)
        self.epoch, self.generation = m.control.epoch, m.control.generation
        self.update_hosts(m.control.hosts)
        if self.leaving and not any(h.host == self.number for h in m.control.holdings):
            self.refuse_below = max(self.refuse_below, self.epoch)
        if again:
            for drops in m.control.drops:
                if drops.host == self.number:
                    self.work.put_nowait(("unload", list(drops.parts)))
        early, self.early = self.early, []
        for peer, submit in early:
            self.on_SubmitTask(peer, submit)

    def on_SubmitTask(self, peer, m):
        c = m.control
        if c.category != pb.INTERSECTION or self.job is None:
            self.counters.dropped_messages += 1
            return
        if c.generation < self.generation:
            return
        if c.generation > self.generation or self.epoch == 0:
            self.early.append((peer, m))
            return
        if c.epoch < self.refuse_below or self.manifest is None:
            peer.send("Reply", pb.ReplyControl(id=c.id, refused=True, epoch=self.epoch))
            return
        width = 8 if c.times else 7
        if c.count == 0 or len(m.bulk) != 4 * width * c.count:
            raise WireError("rays have the wrong length")
        rays = np.frombuffer(m.bulk, "<f4", 7 * c.count).reshape(c.count, 7)
        near = (np.abs(rays[:, 0:3]) <= MAX_COORDINATE).all()  # NaN fails every comparison
        with np.errstate(all="ignore"):
            length = (rays[:, 3:6] ** 2).sum(1)
        if not (near and ((length > 0.98) & (length < 1.02)).all() and (rays[:, 6] >= 0).all()):
            raise WireError("a ray that is none")
        self.counters.blocks_received += 1
        self.queued_rays += c.count
        self.open_blocks += 1
        self.work.put_nowait(("block", peer, c, rays))

    def on_JobEnd(self, _, m):
        say(f"the job is over{': ' + m.control.reason if m.control.reason else ''}")
        self.ended_well = True
        self.manager.send("Status", self.status(final=True))
        self.forget_job()
        asyncio.get_running_loop().call_later(5, self.over.set)  # at the latest; the manager closes before

    def on_CancelJob(self, _, m):
        if m.control.job == self.job:
            self.on_JobEnd(_, m)

    # ---- work ----
    async def work_off(self):
        """One after the other, so that no part goes while a block before its unloading is open."""
        loop = asyncio.get_running_loop()
        while True:
            what, *more = await self.work.get()
            began = time.monotonic()
            if what == "block":
                peer, control, rays = more
                self.queued_rays -= len(rays)
                if control.generation == self.generation and self.job is not None:
                    held = list(self.parts.values())
                    reply, bulk = await loop.run_in_executor(None, self.answer, control, rays, held)
                    reply.epoch = self.epoch
                    if control.generation == self.generation and self.peers.get(peer.host) is peer:
                        peer.send("Reply", reply, bulk)
                    took = max(time.monotonic() - began, 1e-6)
                    self.busy_s += took
                    speed = len(rays) / took
                    self.rays_per_s = speed if self.rays_per_s == 0 else 0.9 * self.rays_per_s + 0.1 * speed
                    self.counters.tasks_intersection += 1
                self.open_blocks -= 1
            elif what == "part":
                number, data, done = more
                try:
                    if number in self.wanted:
                        self.parts[number] = await loop.run_in_executor(None, Part, data)
                    done.set_result(None)
                except PartError as e:
                    done.set_exception(e)
            elif what == "unload":
                for number in more[0]:
                    self.wanted.discard(number)
                    if self.parts.pop(number, None):
                        self.bytes_used -= self.manifest.parts[number].loaded_bytes
                        self.counters.parts_loaded -= 1
                self.counters.tasks_unloader += 1
                self.report(unloaded=more[0])

    @staticmethod
    def answer(control, rays, parts):
        """(ReplyControl, columns). On another thread."""
        reply = pb.ReplyControl(id=control.id, category=pb.INTERSECTION, count=control.count)
        if not control.nearest:
            return reply, bits(occluded(parts, rays))
        hits = Hits(parts, rays)
        reply.nearest, reply.hits, reply.normals, reply.uvs = True, hits.count, hits.normals, hits.uvs
        return reply, hits.bulk()

    async def fetch(self, kind, index=0):
        """A blob from the manager, some chunks at a time."""
        async def chunk(offset):
            request = pb.BlobRequest(request=self.next_request, kind=kind, index=index, offset=offset, bytes=CHUNK)
            self.next_request += 1
            waiting = self.blobs[request.request] = asyncio.get_running_loop().create_future()
            self.manager.send("BlobRequest", request)
            got = await waiting
            if got.error:
                raise PartError(got.error)
            return got

        first = await chunk(0)
        data = [first.data]
        offsets = range(len(first.data), first.total, CHUNK)
        for i in range(0, len(offsets), AHEAD):
            data += [c.data for c in await asyncio.gather(*map(chunk, offsets[i:i + AHEAD]))]
        return b"".join(data)

    async def load(self, start):
        """What a job needs, and then parts as they are asked for."""
        job, began = start.job, time.monotonic()
        try:
            manifest = Manifest.FromString(await self.fetch(pb.BLOB_MANIFEST))
            if manifest.content_hash != start.content_hash or len(manifest.parts) != start.part_count:
                raise PartError("the manifest is not that of the job")
            if self.job != job:
                return
            self.manifest = manifest
            self.load_s += time.monotonic() - began
            self.report()
            while self.job == job:
                if not self.to_load:
                    await asyncio.sleep(0.01)
                    continue
                number, began = self.to_load.popleft(), time.monotonic()
                size = manifest.parts[number].loaded_bytes
                if number not in self.wanted or number in self.parts:
                    continue
                if self.bytes_used + size > self.options.memory:
                    self.wanted.discard(number)
                    self.report(declined=[number])
                    continue
                data = await self.fetch(pb.BLOB_PART, number)
                done = asyncio.get_running_loop().create_future()
                self.work.put_nowait(("part", number, data, done))
                await done
                if self.job != job or number not in self.parts:
                    continue
                self.bytes_used += size
                self.load_s += time.monotonic() - began
                self.counters.tasks_loader += 1
                self.counters.parts_loaded += 1
                self.report(loaded=[number])
        except PartError as e:
            self.report(error=f"a part cannot be loaded: {e}")

    def report(self, **what):
        if self.job is not None:
            self.manager.send("LoadReport", pb.LoadReport(job=self.job, bytes_used=self.bytes_used, **what))

    # ---- heartbeat ----
    def leave(self):
        if self.leaving or not self.manager or self.job is None:  # asked twice, or nobody to be told
            self.ended_well = True
            self.over.set()
            return
        self.leaving = True
        self.manager.send("Leave", pb.Leave(reason="asked to leave"))

    def status(self, final=False):
        c, usage = self.counters, resource.getrusage(resource.RUSAGE_SELF)
        c.cpu_s, c.busy_s, c.load_s = usage.ru_utime + usage.ru_stime, self.busy_s, self.load_s
        c.peak_rss, c.memory_used = usage.ru_maxrss * 1024, self.bytes_used
        c.memory_peak = max(c.memory_peak, self.bytes_used)
        c.bytes_sent = self.manager.sent + sum(p.sent for p in self.peers.values())
        drained = all(p.link.drained() for p in self.peers.values())
        return pb.Status(load_s=self.queued_rays / self.rays_per_s if self.rays_per_s else 0, segments_per_s=self.rays_per_s,
                         queued_segments=self.queued_rays, epoch=self.epoch, generation=self.generation, final=final,
                         idle=self.open_blocks == 0 and not self.early and drained, counters=c)

    async def beat(self):
        while True:
            await asyncio.sleep(self.heartbeat)
            if self.manager and self.manager.writer is not None and not self.ended_well:
                self.manager.send("Status", self.status())


def read_token(path):
    token = pathlib.Path(path).read_text() if path else os.environ.get("CLOUDRENDERER_TOKEN", "")
    return token.strip(" \t\r\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--manager", required=True, metavar="HOST:PORT")
    parser.add_argument("--listen", default="127.0.0.1:0", metavar="HOST:PORT", help="where other workers reach this host")
    parser.add_argument("--memory", type=int, default=1 << 30, metavar="BYTES", help="of parts")
    parser.add_argument("--name", default="python")
    parser.add_argument("--token-file", metavar="FILE", help="else of the environment: CLOUDRENDERER_TOKEN")
    parser.add_argument("--tls", choices=("auto", "on", "off"), default="auto", help="auto: on connections that leave this machine")
    parser.add_argument("--wait", type=float, default=30, metavar="SECONDS", help="for a manager")
    parser.add_argument("--allow-inexact", action="store_true", help="as every host of this kind does")
    options = parser.parse_args()

    async def run():
        return await Host(options, read_token(options.token_file)).run()

    try:
        code = asyncio.run(run())
    except Refused as e:
        say(str(e))
        code = 4
    sys.stdout.flush()
    os._exit(code)  # not waiting for what the thread still does


if __name__ == "__main__":
    main()
