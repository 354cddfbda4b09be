"""Frames of the wire format, version 1 (src/wire/README.md): bytes <-> messages, and delivery in order, once."""
import collections
import hashlib
import hmac
import pathlib
import secrets
import struct
import sys

import xxhash

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "build" / "python_host" / "generated"))
from parts.manifest_pb2 import Manifest  # noqa: E402,F401
from wire import messages_pb2 as pb  # noqa: E402

VERSION = 2
HEADER_BYTES, LINK_BYTES = 24, 20
MAX_FRAME = 16 << 20
WINDOW = 256  # frames on the way
ACK_FRAMES, ACK_BYTES = 16, 1 << 20
ACK_DELAY = 0.02

# By type number; None: the message has columns, and its control part the type that follows.
NAMES = ("Challenge Proof Hello Welcome Refused PeerHello HostList SceneHostMap JobStart JobEnd CancelJob LoadParts "
         "UnloadParts LoadReport BlobRequest BlobChunk SubmitTask Reply PathEnds Status Leave Error CancelTask "
         "PoolWelcome PoolOrders PoolStatus").split()
CONTROL = {"SubmitTask": pb.SubmitControl, "Reply": pb.ReplyControl, "PathEnds": pb.EndsControl}


class WireError(Exception):
    """What the other end sent breaks the format: the connection is to be closed."""


Header = collections.namedtuple("Header", "incarnation sequence ack window")
Message = collections.namedtuple("Message", "name control bulk")


def control_class(name):
    return CONTROL.get(name) or getattr(pb, name)


def encode(name, control, bulk=b""):
    """The payload of a message."""
    body = control.SerializeToString()
    head = struct.pack("<HHI", NAMES.index(name), VERSION, len(body))
    body += bulk
    return head + struct.pack("<Q", xxhash.xxh3_64_intdigest(body, int.from_bytes(head, "little"))) + body


def decode(payload):
    if len(payload) < 16:
        raise WireError("a payload is too short")
    kind, version, length, checksum = struct.unpack_from("<HHIQ", payload)
    if xxhash.xxh3_64_intdigest(payload[16:], int.from_bytes(payload[:8], "little")) != checksum:
        raise WireError("the checksum of a payload does not match")
    if version != VERSION:
        raise WireError(f"version {version} instead of {VERSION}")
    if kind >= len(NAMES):
        raise WireError(f"unknown type {kind}")
    if length > len(payload) - 16:
        raise WireError("the control part is longer than its frame")
    control = control_class(NAMES[kind])()
    try:
        control.ParseFromString(bytes(payload[16:16 + length]))
    except Exception as e:  # protobuf's own type differs between its versions
        raise WireError(f"{NAMES[kind]} cannot be read: {e}") from e
    return Message(NAMES[kind], control, bytes(payload[16 + length:]))


def frame(payload, header=Header(0, 0, 0, 0)):
    head = struct.pack("<5I", LINK_BYTES + len(payload), *header)
    return head + struct.pack("<I", xxhash.xxh3_64_intdigest(head) & 0xffffffff) + payload


def decode_header(data):
    """(bytes of the payload, Header) of 24 bytes."""
    if xxhash.xxh3_64_intdigest(data[:20]) & 0xffffffff != struct.unpack_from("<I", data, 20)[0]:
        raise WireError("the check of a frame header does not match")
    length, *link = struct.unpack_from("<5I", data)
    if not LINK_BYTES <= length <= MAX_FRAME - 4:
        raise WireError(f"a frame of {length} bytes")
    return length - LINK_BYTES, Header(*link)


async def read_frame(reader):
    """(Header, payload) of the next frame; the payload is empty in acknowledgements."""
    size, header = decode_header(await reader.readexactly(HEADER_BYTES))
    return header, await reader.readexactly(size)


def proof(secret, role, nonce):
    """role: "connects" or "accepts", of who proves."""
    return hmac.digest(secret.encode(), role.encode() + nonce, hashlib.sha256) if secret else b""


async def greet(reader, writer, role, secret):
    """Both ends prove that they know the secret."""
    nonce = secrets.token_bytes(32)
    writer.write(frame(encode("Challenge", pb.Challenge(nonce=nonce))))
    other = "accepts" if role == "connects" else "connects"
    proved = answered = False
    while not (proved and answered):
        _, payload = await read_frame(reader)
        message = decode(payload)
        if message.name == "Challenge":
            if not 32 <= len(message.control.nonce) <= 64:
                raise WireError("a challenge has a wrong length")
            writer.write(frame(encode("Proof", pb.Proof(code=proof(secret, role, message.control.nonce)))))
            answered = True
        elif message.name == "Proof":
            if not hmac.compare_digest(message.control.code, proof(secret, other, nonce)):
                raise WireError("it does not know the cluster's secret")
            proved = True
        else:
            raise WireError(f"{message.name} before the proof")


class Link:
    """Numbered frames between this host and another one, through all connections of the pair."""

    def __init__(self, own, peer):
        self.own, self.peer = own & 0xffffffff, peer & 0xffffffff
        self.next_sequence, self.received = 1, 0
        self.unsent, self.unacknowledged = collections.deque(), collections.deque()  # payloads; (sequence, payload)
        self.early = {}
        self.unreported_frames = self.unreported_bytes = 0

    def header(self, sequence):
        window = 0
        for early in self.early:
            if 0 <= early - self.received - 2 < 32:
                window |= 1 << (early - self.received - 2)
        self.unreported_frames = self.unreported_bytes = 0
        return Header(self.own, sequence, self.received, window)

    def drained(self):
        return not self.unsent and not self.unacknowledged

    def reconnected(self):
        """Frames that must be sent again over a new connection."""
        return [frame(payload, self.header(sequence)) for sequence, payload in self.unacknowledged]

    def outgoing(self):
        """Frames to be sent now."""
        frames = []
        while self.unsent and len(self.unacknowledged) < WINDOW:
            payload = self.unsent.popleft()
            self.unacknowledged.append((self.next_sequence, payload))
            frames.append(frame(payload, self.header(self.next_sequence)))
            self.next_sequence += 1
        if self.unreported_frames >= ACK_FRAMES or self.unreported_bytes >= ACK_BYTES:
            frames.append(self.acknowledgement())
        return frames

    def acknowledgement(self):
        return frame(b"", self.header(0))

    def receive(self, header, payload):
        """Payloads that are now in order."""
        if header.incarnation != self.peer:
            return []
        if header.ack < self.next_sequence:
            while self.unacknowledged and self.unacknowledged[0][0] <= header.ack:
                self.unacknowledged.popleft()
        if header.sequence == 0 or not payload:
            return []
        self.unreported_frames += 1
        self.unreported_bytes += len(payload)
        if header.sequence <= self.received:
            self.unreported_frames = ACK_FRAMES  # the acknowledgement must have been lost
            return []
        if header.sequence - self.received > WINDOW:
            return []
        self.early.setdefault(header.sequence, payload)
        in_order = []
        while self.received + 1 in self.early:
            self.received += 1
            in_order.append(self.early.pop(self.received))
        return in_order
