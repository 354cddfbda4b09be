#!/usr/bin/env python3
"""Plays a manager, and another worker, against a host that only intersects, and says what the host does wrong.

    play_manager.py SPLIT_FOLDER [--secret TEXT] -- COMMAND THAT STARTS THE HOST

{manager} in the command becomes the address to join, {token} a file with the secret. The split must have parts of triangles
only, and nothing in the main scene, which hosts may test as well (for example: cloudrenderer split
tools/conformance/scene.pbrt -o FOLDER --part-size 512KiB). What is expected is in
src/wire/README.md. The exit code is 0 when everything is as it should be.
"""
import argparse
import asyncio
import os
import pathlib
import signal
import sys
import tempfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "python_host"))
import frames  # noqa: E402
from frames import Header, Link, Manifest, pb  # noqa: E402
from part_file import Arrays  # noqa: E402
from truth import Failed, Truth, expect  # noqa: E402

MANAGER, WORKER = 0x1111111100000011, 0x2222222200000022  # our incarnations
HEARTBEAT, LOST_AFTER = 0.2, 3.0
HOST, OTHER = 1, 2  # host numbers: the host under test, and the worker that we play
PATIENCE = 15.0


class End:
    """Our end of a pair with the host, through all its connections."""

    def __init__(self, incarnation, takes=lambda m: False):
        """takes: whether a message is dealt with already."""
        self.incarnation, self.takes = incarnation, takes
        self.link = self.reader = self.writer = None
        self.inbox, self.closed, self.task = asyncio.Queue(), asyncio.Event(), None

    def attach(self, reader, writer, host_incarnation):
        if self.link is None:
            self.link = Link(self.incarnation, host_incarnation)
        self.reader, self.writer = reader, writer
        self.closed.clear()
        for f in self.link.reconnected():
            writer.write(f)
        self.task = asyncio.create_task(self.listen())

    async def listen(self):
        try:
            while True:
                header, payload = await frames.read_frame(self.reader)
                expect(header.incarnation == self.link.peer, "a frame has another incarnation than its host")
                for ready in self.link.receive(header, payload):
                    m = frames.decode(ready)
                    if not self.takes(m):
                        await self.inbox.put(m)
                if payload:
                    self.writer.write(self.link.acknowledgement())
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            self.closed.set()

    def send(self, name, control, bulk=b""):
        self.link.unsent.append(frames.encode(name, control, bulk))
        for f in self.link.outgoing():
            self.writer.write(f)

    async def receive(self, name, condition=lambda m: True, seconds=PATIENCE):
        """The next message of this name for which the condition holds; others are skipped."""
        try:
            async with asyncio.timeout(seconds):
                while True:
                    m = await self.inbox.get()
                    if m.name == name and condition(m):
                        return m
        except TimeoutError:
            raise Failed(f"no {name} came within {seconds:g} seconds") from None

    async def silence(self, name, seconds):
        try:
            await self.receive(name, seconds=seconds)
        except Failed:
            return
        raise Failed(f"a {name} came that should not")

    async def acknowledged(self, seconds=2):
        end = asyncio.get_running_loop().time() + seconds
        while self.link.unacknowledged:
            expect(asyncio.get_running_loop().time() < end, "a frame was not acknowledged")
            await asyncio.sleep(0.02)

    async def wait_closed(self, why):
        try:
            await asyncio.wait_for(self.closed.wait(), 5)
        except TimeoutError:
            raise Failed(f"the connection stays open after {why}") from None

    def close(self):
        self.writer.close()


class Play(Truth):
    def __init__(self, folder, secret, command):
        self.folder, self.secret, self.command = pathlib.Path(folder), secret, command
        self.manifest_bytes = (self.folder / "manifest.bin").read_bytes()
        self.manifest = Manifest.FromString(self.manifest_bytes)
        super().__init__({p: Arrays(self.part_file(p)) for p in range(1, len(self.manifest.parts))})
        expect(len(self.parts) >= 3, "the split has fewer than three parts")
        expect(not self.manifest.parts[0].features, "the split has a main scene that is not empty")
        self.connections = asyncio.Queue()
        self.manager, self.worker = End(MANAGER, self.answer_blob), End(WORKER)
        self.epoch = self.generation = 0
        self.task_number = 0

    def part_file(self, part):
        return (self.folder / "parts" / f"{part:05d}.part").read_bytes()

    # ---- the manager's end ----
    async def next_connection(self):
        try:
            return await asyncio.wait_for(self.connections.get(), PATIENCE)
        except TimeoutError:
            raise Failed("the host does not connect") from None

    async def welcome(self, comes_back=False):
        """Greets the next connection and takes the host in."""
        reader, writer = await self.next_connection()
        await frames.greet(reader, writer, "accepts", self.secret)
        header, payload = await frames.read_frame(reader)
        expect(header == Header(0, 0, 0, 0), "Hello has a link header that is not 0")
        m = frames.decode(payload)
        expect(m.name == "Hello", f"{m.name} instead of Hello")
        if comes_back:
            expect(m.control.incarnation == self.hello.incarnation, "it comes back with another incarnation")
            expect(m.control.manager == MANAGER, "Hello does not name the manager that it comes back to")
        self.hello = m.control
        answer = pb.Welcome(host=HOST, incarnation=MANAGER, heartbeat_s=HEARTBEAT, lost_after_s=LOST_AFTER)
        writer.write(frames.frame(frames.encode("Welcome", answer)))
        self.manager.attach(reader, writer, m.control.incarnation)

    def answer_blob(self, m):
        """True if the message was a request for a blob."""
        if m.name != "BlobRequest":
            return False
        r = m.control
        ok = r.kind in (pb.BLOB_MANIFEST, pb.BLOB_PART) and 1 <= r.bytes <= 1 << 20
        data = b"" if not ok else self.manifest_bytes if r.kind == pb.BLOB_MANIFEST else self.part_file(r.index)
        chunk = pb.BlobChunk(request=r.request, offset=r.offset, total=len(data), data=data[r.offset:r.offset + r.bytes])
        if not ok:
            chunk.error = "no such blob, or too much of it at a time"
        self.manager.send("BlobChunk", chunk)
        return True

    def send_map(self, holdings=True, generation=None, drops=()):
        self.epoch += 1
        self.generation = generation or self.generation
        m = pb.SceneHostMap(epoch=self.epoch, generation=self.generation, part_count=len(self.manifest.parts))
        h = self.hello
        m.hosts.add(host=HOST, name=h.name, address=h.listen, incarnation=h.incarnation, memory=h.memory, threads=h.threads,
                    only_intersects=True)
        m.hosts.add(host=OTHER, name="other", address="127.0.0.1:9", incarnation=WORKER, memory=1, threads=1)
        if holdings:
            m.holdings.add(host=HOST, parts=sorted(self.held))
        if drops:
            m.drops.add(host=HOST, parts=drops)
        self.manager.send("SceneHostMap", m)

    # ---- the other worker's end ----
    async def meet(self):
        host, port = self.hello.listen.rsplit(":", 1)
        for attempt in range(20):  # its list may be late
            reader, writer = await asyncio.open_connection(host, int(port))
            try:
                await frames.greet(reader, writer, "connects", self.secret)
                mine = pb.PeerHello(protocol=frames.VERSION, host=OTHER, incarnation=WORKER)
                writer.write(frames.frame(frames.encode("PeerHello", mine)))
                _, payload = await frames.read_frame(reader)
                break
            except (OSError, asyncio.IncompleteReadError):
                expect(attempt < 19, "the host closes the connection of a worker that is on its list")
                await asyncio.sleep(0.2)
        m = frames.decode(payload)
        expect(m.name == "PeerHello" and m.control.host == HOST and m.control.incarnation == self.hello.incarnation,
               "its PeerHello does not say who it is")
        self.worker.attach(reader, writer, self.hello.incarnation)

    def submit(self, rays, nearest, times=False, **other):
        self.task_number += 1
        given = dict(epoch=self.epoch, generation=self.generation) | other
        c = pb.SubmitControl(id=pb.TaskId(origin=WORKER, number=self.task_number), category=pb.INTERSECTION, count=len(rays),
                             nearest=nearest, times=times, **given)
        bulk = rays.astype("<f4").tobytes() + (np.zeros(len(rays), "<f4").tobytes() if times else b"")
        return c, bulk

    async def reply_to(self, c):
        m = await self.worker.receive("Reply", lambda m: m.control.id == c.id)
        expect(m.control.refused or m.control.category == pb.INTERSECTION, "a reply of another category")
        return m

    async def ask(self, rays, nearest, **other):
        c, bulk = self.submit(rays, nearest, **other)
        self.worker.send("SubmitTask", c, bulk)
        m = await self.reply_to(c)
        expect(not m.control.refused, "a block was refused")
        return self.check_nearest(rays, m) if nearest else self.check_blocked(rays, m)

    # ---- the play ----
    async def a_wrong_proof(self):
        """Closes the connection of a manager that does not know the secret."""
        reader, writer = await self.next_connection()
        writer.write(frames.frame(frames.encode("Challenge", pb.Challenge(nonce=bytes(32)))))
        challenged = False
        try:
            while True:
                header, payload = await asyncio.wait_for(frames.read_frame(reader), 5)
                m = frames.decode(payload)
                expect(header == Header(0, 0, 0, 0), "a message of the greeting has a link header that is not 0")
                expect(m.name in ("Challenge", "Proof"), f"{m.name} to somebody who has proved nothing")
                if m.name == "Proof":
                    expect(m.control.code == frames.proof(self.secret.encode(), "connects", bytes(32)), "its proof is wrong")
                if m.name == "Challenge":
                    challenged = True
                    writer.write(frames.frame(frames.encode("Proof", pb.Proof(code=bytes(32)))))
        except (OSError, asyncio.IncompleteReadError):
            expect(challenged, "it closed the connection before anything was wrong")
        except TimeoutError:
            expect(not challenged, "it does not close")  # a host need not challenge
        writer.close()

    async def joining(self):
        """Says Hello as it should."""
        await self.welcome()
        h = self.hello
        expect(h.protocol == frames.VERSION, f"protocol {h.protocol}")
        expect(h.incarnation & 0xffffffff, "the low half of the incarnation is 0")
        expect(h.memory > 0 and h.threads > 0, "no memory or no threads")
        expect({pb.LOADER, pb.UNLOADER, pb.INTERSECTION} <= set(h.categories), f"categories {list(h.categories)}")
        expect(pb.TRACER not in h.categories, "it traces: this program is for hosts that only intersect")
        expect(not h.features or "triangles" in h.features, f"features {list(h.features)}")
        expect(h.fingerprint != 0 or h.allow_inexact, "it has no fingerprint, and does not allow for that")

    async def loading(self):
        """Loads what it is told to, and says so."""
        start = pb.JobStart(job=77, scene="conformance", manifest_bytes=len(self.manifest_bytes),
                            content_hash=self.manifest.content_hash, part_count=len(self.manifest.parts), width=8, height=8, x1=8, y1=8,
                            spp=1, k=30)
        self.manager.send("JobStart", start)
        m = await self.manager.receive("LoadReport")
        expect(m.control.job == 77 and not m.control.loaded and not m.control.error, f"the first LoadReport: {m.control}")
        # One of them with uvs, if there is one.
        self.held = set(sorted(self.parts, key=lambda p: len(self.parts[p].uvs) == 0)[:3])
        self.manager.send("LoadParts", pb.LoadParts(parts=sorted(self.held)))
        loaded = set()
        while loaded != self.held:
            m = await self.manager.receive("LoadReport")
            expect(m.control.job == 77 and not m.control.error, f"LoadReport: {m.control}")
            expect(set(m.control.loaded) <= self.held, "it reports parts that were not ordered")
            loaded |= set(m.control.loaded)
        expect(m.control.bytes_used > 0, "three parts take no bytes")
        await self.manager.acknowledged()

    async def heartbeats(self):
        """Beats its heart."""
        began = asyncio.get_running_loop().time()
        for _ in range(5):
            m = await self.manager.receive("Status", seconds=LOST_AFTER)
            expect(not m.control.final and not m.control.live_paths, f"Status: {m.control}")
        expect(asyncio.get_running_loop().time() - began < 5 * HEARTBEAT + LOST_AFTER / 2, "its heart beats too slowly")

    async def early_blocks(self):
        """Keeps a block of a generation that it does not know yet until it does."""
        self.send_map(generation=1)
        await self.meet()
        rays = self.rays(10)
        c, bulk = self.submit(rays, False, generation=2, epoch=2)
        self.worker.send("SubmitTask", c, bulk)
        await self.worker.silence("Reply", 0.5)
        self.send_map(generation=2)
        self.check_blocked(rays, await self.reply_to(c))

    async def occlusion(self):
        """Says which rays are blocked."""
        for n in (1, 64, 65, 150):
            await self.ask(self.rays(n), False)
        await self.ask(self.rays(70), False, times=True)

    async def nearest_hits(self):
        """Finds nearest hits, and describes what was hit."""
        for n in (1, 64, 65, 150):
            await self.ask(self.rays(n), True)
        rays = self.rays(5)
        rays[:, 0] += 1e6  # nothing at all
        await self.ask(rays, True)

    async def old_generations(self):
        """Drops blocks of older generations."""
        c, bulk = self.submit(self.rays(3), True, generation=self.generation - 1)
        self.worker.send("SubmitTask", c, bulk)
        await self.worker.silence("Reply", 0.5)

    async def twice_and_disordered(self):
        """Takes frames in the order of their numbers, each once."""
        link, given = self.worker.link, []
        for _ in range(3):
            c, bulk = self.submit(self.rays(4), False)
            link.unsent.append(frames.encode("SubmitTask", c, bulk))
            given.append(c)
        made = link.outgoing()
        for f in (made[2], made[0], made[0], made[1], made[1], made[2]):
            self.worker.writer.write(f)
        order = [(await self.worker.receive("Reply")).control.id.number for _ in given]
        expect(sorted(order) == [c.id.number for c in given], f"replies to {order}")
        await self.worker.silence("Reply", 0.5)
        await self.worker.acknowledged()

    async def altered_on_the_way(self):
        """Closes the connection when a frame was altered, and takes it when it comes again."""
        rays = self.rays(6)
        c, bulk = self.submit(rays, True)
        self.worker.link.unsent.append(frames.encode("SubmitTask", c, bulk))
        for f in self.worker.link.outgoing():
            self.worker.writer.write(f[:-3] + bytes((f[-3] ^ 8,)) + f[-2:])
        await self.worker.wait_closed("an altered frame")
        await self.meet()
        self.check_nearest(rays, await self.reply_to(c))

    async def absurd_rays(self):
        """Closes the connection when a ray is none, and goes on with the next one."""
        for column, value in ((0, np.nan), (4, np.inf), (3, 30.0), (6, -1.0), (1, 1e19)):
            rays = self.rays(3)
            rays[1, column] = value
            c, bulk = self.submit(rays, True)
            self.worker.send("SubmitTask", c, bulk)
            await self.worker.wait_closed(f"a ray with {value} in column {column}")
            await self.meet()
        await self.ask(self.rays(20), True)

    async def coming_back(self):
        """Comes back when the connection to the manager breaks, as who it was."""
        self.manager.close()
        try:
            await asyncio.wait_for(self.welcome(comes_back=True), 1.5)
        except TimeoutError:
            raise Failed("it does not come back within 1.5 seconds") from None
        await self.manager.receive("Status")
        await self.ask(self.rays(5), False)

    async def unloading(self):
        """Unloads, and refuses what was routed by an older map."""
        gone = min(self.held)
        old = self.epoch
        self.manager.send("UnloadParts", pb.UnloadParts(parts=[gone], epoch=old + 1))
        m = await self.manager.receive("LoadReport")
        expect(list(m.control.unloaded) == [gone], f"LoadReport: {m.control}")
        c, bulk = self.submit(self.rays(4), True, epoch=old)
        self.worker.send("SubmitTask", c, bulk)
        expect((await self.reply_to(c)).control.refused, "a block of an older epoch was answered")
        self.held.remove(gone)
        self.send_map()
        await self.ask(self.rays(60), True)

    async def dropping(self):
        """Drops copies that a new generation names, and reports it."""
        gone = min(self.held)
        self.held.remove(gone)
        self.send_map(generation=self.generation + 1, drops=[gone])
        m = await self.manager.receive("LoadReport")
        expect(list(m.control.unloaded) == [gone], f"LoadReport: {m.control}")
        await self.ask(self.rays(40), False)

    async def leaving(self):
        """Leaves when it is asked to (SIGTERM), after others have taken over."""
        self.process.send_signal(signal.SIGTERM)
        await self.manager.receive("Leave")
        await self.ask(self.rays(5), True)  # still a holder
        old, self.held = self.epoch, set()
        self.send_map(holdings=False)
        await self.manager.receive("Status", lambda m: m.control.epoch == self.epoch and m.control.idle)
        c, bulk = self.submit(self.rays(4), True, epoch=old)
        self.worker.send("SubmitTask", c, bulk)
        expect((await self.reply_to(c)).control.refused, "a host that is leaving takes blocks of older maps")
        self.manager.send("JobEnd", pb.JobEnd(job=77, reason="the host leaves"))
        m = await self.manager.receive("Status", lambda m: m.control.final)
        expect(m.control.counters.tasks_intersection > 0, "its counters have no intersection tasks")
        await asyncio.sleep(0.1)
        self.manager.close()
        try:
            code = await asyncio.wait_for(self.process.wait(), 8)
        except TimeoutError:
            raise Failed("the program does not end") from None
        expect(code == 0, f"the program ends with {code}")

    async def run(self):
        server = await asyncio.start_server(lambda r, w: self.connections.put_nowait((r, w)), "127.0.0.1", 0)
        address = "127.0.0.1:%d" % server.sockets[0].getsockname()[1]
        with tempfile.NamedTemporaryFile("w", suffix=".token") as token:
            token.write(self.secret + "\n")
            token.flush()
            command = [a.replace("{manager}", address).replace("{token}", token.name) for a in self.command]
            self.process = await asyncio.create_subprocess_exec(*command, stdin=asyncio.subprocess.DEVNULL)
            try:
                return await self.acts()
            finally:
                if self.process.returncode is None:
                    self.process.kill()
                    await self.process.wait()

    async def acts(self):
        for act in (self.a_wrong_proof, self.joining, self.loading, self.heartbeats, self.early_blocks, self.occlusion, self.nearest_hits,
                    self.old_generations, self.twice_and_disordered, self.altered_on_the_way, self.absurd_rays, self.coming_back,
                    self.unloading, self.dropping, self.leaving):
            try:
                await act()
            except Failed as e:
                print(f"FAILED {act.__doc__} - {e}", flush=True)
                return 1
            print(f"ok     {act.__doc__}", flush=True)
        return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("split")
    parser.add_argument("--secret", default="conformance")
    parser.add_argument("command", nargs="+")
    options = parser.parse_args()

    async def run():
        return await Play(options.split, options.secret, options.command).run()

    code = asyncio.run(run())
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
