"""Strangers, and hosts that know the secret and keep to nothing else, at a cluster that renders: the picture is the
same, every attempt is logged once, memory stays flat."""
import os
import pathlib
import random
import re
import socket
import struct
import time

import numpy as np
import support
import wire_support as wire
from support import measure

SIZE = "160x160"
SEED = 20
FRAMES = 2000
CORPUS = support.ROOT / "tests" / "fuzz" / "corpus" / "wire_payload"
TOKEN = "the secret of this test"
SECRETS = (TOKEN, None, TOKEN, None, TOKEN, "another secret")
# Why a manager closes connections: all of it must have come up, or the test does not send what it means to.
REASONS = ("End of file", "it does not know the cluster's secret", "before it had proved who it is", "it speaks TLS",
           "the frame's length is out of range", "a stranger's message of", "the checksum does not match",
           "a payload is shorter than its header", "protocol version 3, this host speaks 2", "unknown message type",
           "instead of Hello", "this cluster speaks protocol version 2, the host speaks 3", "1048576 TiB of memory",
           "has 0 threads", "is too long, or no text", "cannot be parsed", "numeric fingerprint", "has ended")
MOST_GROWTH = 24 << 20  # a session that is never freed holds 64 KiB


def resident(process):
    text = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+) kB", text)[1]) << 10


class Hostile(support.ClusterTest):
    def setUp(self):
        super().setUp()
        os.environ["CLOUDRENDERER_TOKEN"] = TOKEN
        self.addCleanup(os.environ.pop, "CLOUDRENDERER_TOKEN", None)
        self.dice = random.Random(SEED)
        self.attempts = []  # (process, name of our end)
        self.scene = self.split()
        self.ports = support.free_ports(4)
        self.out = self.folder / "out.exr"

    # ---- the cluster ----

    def start_cluster(self, seconds):
        self.spp = self.spp_for_frame(seconds, self.scene, SIZE, most=1 << 16)
        self.manager = self.start_manager(self.scene, self.out, self.ports[0], "--spp", self.spp, "--resolution", SIZE,
                                          "--min-hosts", 2, "--quiet", "--log-level", "info")
        self.worker = self.join("worker0", self.ports[1])
        self.join("worker1", self.ports[2])
        self.wait_until_all_joined(self.ports[0], 2)
        self.wait_for_words(self.worker, "this is host")

    def join(self, name, port):
        return self.start_worker(name, self.ports[0], port, "512MiB", "--log-level", "info")

    def wait_for_words(self, process, words, seconds=20):
        end = time.monotonic() + seconds
        while words not in process.text():
            self.assertLess(time.monotonic(), end, f"no '{words}':\n{self.logs()}")
            time.sleep(0.05)

    def finish(self):
        self.assertEqual(self.manager.wait(240), 0, self.logs())
        for process in self.processes[1:]:
            self.assertEqual(process.wait(20), 0, process.text()[-3000:])
        wanted, _ = self.render("wanted", self.scene, "--spp", self.spp, "--resolution", SIZE, "--threads", 2,
                                timeout=240)
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), wanted), "the picture differs from one host's")
        self.assert_none_left()

    def assert_each_logged_once(self):
        for process in (self.manager, self.worker):
            logged = re.findall(r"127\.0\.0\.1:\d+", process.text())
            wanted = sorted(name for p, name in self.attempts if p is process)
            ours = set(wanted)
            self.assertEqual(sorted(name for name in logged if name in ours), wanted, f"seed {SEED}: {process.name}")

    # ---- strangers ----

    def attempt(self, process):
        peer = wire.Peer.connect(self.ports[0] if process is self.manager else self.ports[1])
        self.attempts.append((process, peer.name))
        return peer

    def real_hello(self):
        """What a real worker says of itself, read by a manager that is none."""
        with socket.create_server(("127.0.0.1", self.ports[3])) as server:
            server.settimeout(20)
            worker = self.start("model", "worker", "--manager", f"127.0.0.1:{self.ports[3]}", "--threads", 1)
            peer = wire.Peer(server.accept()[0])
            peer.send(wire.frame(wire.payload(wire.CHALLENGE, wire.field(1, b"n" * 32))))
            peer.prove(TOKEN, "accepts")
            kind, control = peer.receive()
            while kind != wire.HELLO:
                kind, control = peer.receive()
            peer.close()
        worker.kill()
        worker.child.wait()
        self.processes.remove(worker)
        return control

    def hello(self, **changes):
        """The real one, but for some fields (by number: `f6=...`) and its incarnation."""
        changes = {"f2": struct.pack("<Q", self.dice.getrandbits(64) | 1)} | changes
        control = b""
        for number, kind, value in wire.fields(self.model):
            value = changes.pop(f"f{number}", value)
            control += wire.varint(number << 3 | kind)
            control += wire.varint(value) if kind == 0 else value if kind == 1 else wire.varint(len(value)) + value
        return control

    def mutated(self, data):
        data = bytearray(data)
        for _ in range(self.dice.randint(1, 4)):
            at = self.dice.randrange(len(data)) if data else 0
            match self.dice.randrange(5):
                case 0:
                    del data[at:]
                case 1:
                    data[at:at] = self.dice.randbytes(self.dice.randint(1, 40))
                case 2:
                    data[at:at + 4] = b"\xff\xff\xff\xff"
                case _:
                    data[at:at + 1] = bytes(((data[at] if data else 0) ^ 1 << self.dice.randrange(8),))
        return bytes(data)

    def one_frame(self):
        """Some frame that is wrong, or comes at the wrong time."""
        dice = self.dice
        message = dice.choice(self.payloads)
        hello = self.hello()
        return dice.choice((
            lambda: wire.frame(message),                                                   # the wrong one now
            lambda: self.mutated(wire.frame(message)),                                     # flips, cuts
            lambda: wire.frame(message, length=dice.choice((0, 15, 60_000, 1 << 20, (1 << 32) - 1))),
            lambda: wire.frame(wire.payload(dice.randrange(70), message[16:])),            # of another type
            lambda: wire.frame(wire.payload(wire.HELLO, self.mutated(hello))),
            lambda: wire.frame(wire.payload(wire.HELLO, hello, version=3)),
            lambda: wire.frame(wire.payload(wire.HELLO, self.hello(f1=3))),                # another protocol
            lambda: wire.frame(wire.payload(wire.HELLO, self.hello(f10=dice.randbytes(8)))),  # computes other bits
            lambda: wire.frame(wire.payload(wire.HELLO, self.hello(f5=1 << 60))),          # memory
            lambda: wire.frame(wire.payload(wire.HELLO, self.hello(f6=1 << 60))),          # threads
            lambda: wire.frame(wire.payload(wire.HELLO, self.hello(f3=dice.choice((b"a\nb", b"\xff")) * dice.randrange(1, 9000)))),
            lambda: wire.frame(wire.payload(wire.PEER_HELLO, wire.field(1, 1) + wire.field(2, dice.randrange(4)))),
            lambda: dice.randbytes(dice.randrange(1, 2000)),
        ))()

    def send_one(self, secret):
        peer = self.attempt(self.dice.choice((self.manager, self.worker)))
        try:
            if secret:
                peer.prove(secret)
            peer.send(self.one_frame())
            if self.dice.random() < 0.3:
                peer.send(self.one_frame())
            if self.dice.random() < 0.1:
                peer.wait_closed(0.02)
        except ConnectionError:
            pass
        finally:
            peer.close()

    def join_and_lie(self):
        """A host with the secret and the right numbers: it is let in, says that it holds parts, and then garbage."""
        peer = self.attempt(self.manager)
        try:
            peer.prove(TOKEN)
            incarnation = self.dice.getrandbits(32) | 1
            peer.send(wire.frame(wire.payload(wire.HELLO, self.hello(f2=struct.pack("<Q", incarnation)))))
            job = b""
            while not job:
                kind, control = peer.receive()
                self.assertNotEqual(kind, wire.REFUSED, control)
                if kind == wire.JOB_START:
                    job = next(value for number, _, value in wire.fields(control) if number == 1)
            report = wire.varint(1 << 3 | 1) + job + wire.field(2, bytes(range(1, 9)))
            peer.send(wire.frame(wire.payload(wire.LOAD_REPORT, report), incarnation, 1))
            for sequence in range(2, 12):
                bad = self.dice.choice(self.payloads)
                peer.send(wire.frame(bad, incarnation, sequence))
            peer.send(wire.frame(self.mutated(self.dice.choice(self.payloads)), incarnation, 12))
            peer.wait_closed(0.5)
        except ConnectionError:
            pass
        finally:
            peer.close()

    def scan(self, process):
        for data in (b"", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"r" * 500,
                     b"SSH-2.0-x\r\n", b"\0", b"\0" * 4096):
            peer = self.attempt(process)
            peer.send(data)
            peer.close()

    def test_frames_and_scans_change_nothing(self):
        self.model = self.real_hello()
        self.payloads = [p.read_bytes() for p in sorted(CORPUS.iterdir())]
        self.start_cluster(12)
        print(f"seed {SEED}", flush=True)
        begun = time.monotonic()
        for i in range(FRAMES // 10):  # buffers and tables have got their size after these
            self.send_one(SECRETS[i % len(SECRETS)])
        before = {p: resident(p) for p in (self.manager, self.worker)}
        for i in range(FRAMES - FRAMES // 10):
            self.send_one(SECRETS[i % len(SECRETS)])
            if i % 100 == 0:
                for process in (self.manager, self.worker):
                    self.scan(process)
            if i % 450 == 0:
                self.join_and_lie()
        took = time.monotonic() - begun
        self.assertTrue(self.manager.running(), f"the render was over before the attack:\n{self.logs()}")
        time.sleep(2)
        after = {p: resident(p) for p in before}
        for process in before:
            print(f"{process.name}: {before[process] >> 20} MiB before, {after[process] >> 20} MiB after "
                  f"{len(self.attempts)} attempts in {took:.1f} s", flush=True)
            self.assertLess(after[process] - before[process], MOST_GROWTH, process.name)
        self.finish()
        self.assert_each_logged_once()
        text = self.manager.text()
        print({reason: text.count(reason) for reason in REASONS}, flush=True)
        self.assertEqual([reason for reason in REASONS if reason not in text], [], f"never said, seed {SEED}")

    def test_silent_connections_keep_nobody_out(self):
        self.start_cluster(16)
        silent = [self.attempt(process) for process, count in ((self.manager, 400), (self.worker, 120))
                  for _ in range(count)]
        half = [self.attempt(self.manager) for _ in range(20)]
        for peer in half:
            peer.send(struct.pack("<I", 40))  # a frame that never goes on
        late = self.join("late", self.ports[3])
        self.wait_for_words(late, "this is host")
        deadline = time.monotonic() + 15
        for peer in silent + half:
            self.assertTrue(peer.wait_closed(max(0.1, deadline - time.monotonic())), "a silent connection stays open")
            peer.close()
        self.assertTrue(self.manager.running(), "the render was over before that")
        self.finish()
        self.assert_each_logged_once()
        self.assertIn("did not introduce itself in time", self.manager.text())
        self.assertIn("too many connections", self.manager.text())


if __name__ == "__main__":
    support.main()
