"""Frames of the wire format (src/wire/README.md), made by hand: for peers that do not keep to it."""
import ctypes
import hashlib
import hmac
import socket
import struct

XXHASH = ctypes.CDLL("libxxhash.so.0")
XXHASH.XXH3_64bits_withSeed.restype = ctypes.c_uint64
XXHASH.XXH3_64bits_withSeed.argtypes = (ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64)

VERSION = 2
(CHALLENGE, PROOF, HELLO, WELCOME, REFUSED, PEER_HELLO) = range(6)
JOB_START, LOAD_REPORT, SUBMIT_TASK, REPLY, PATH_ENDS, STATUS, LEAVE = 8, 13, 16, 17, 18, 19, 20


def payload(kind, control, bulk=b"", version=VERSION):
    """A message with the checksum that belongs to it."""
    head = struct.pack("<HHI", kind, version, len(control))
    body = control + bulk
    return head + struct.pack("<Q", XXHASH.XXH3_64bits_withSeed(body, len(body), int.from_bytes(head, "little"))) + body


def frame(message, incarnation=0, sequence=0, length=None):
    head = struct.pack("<5I", len(message) + 20 if length is None else length, incarnation, sequence, 0, 0)
    return head + struct.pack("<I", XXHASH.XXH3_64bits_withSeed(head, len(head), 0) & 0xffffffff) + message


def varint(n):
    out = bytearray()
    while n > 127:
        out.append(n & 127 | 128)
        n >>= 7
    return bytes(out) + bytes((n,))


def field(number, value):
    """One field of a protobuf message: varint, or bytes."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    return varint(number << 3 | 2) + varint(len(value)) + value


def fixed64(number, value):
    return varint(number << 3 | 1) + struct.pack("<Q", value)


def fields(control):
    """[(number, wire type, value)] of a protobuf message; the wire types that ours have."""
    found, at = [], 0

    def number():
        nonlocal at
        value = shift = 0
        while True:
            byte = control[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(control):
        key = number()
        if key & 7 == 0:
            value = number()
        else:
            size = 8 if key & 7 == 1 else number()
            value = control[at:at + size]
            at += size
        found.append((key >> 3, key & 7, value))
    return found


class Peer:
    """One end of a connection that does what it is told."""

    def __init__(self, sock):
        self.sock = sock
        sock.settimeout(5)

    @classmethod
    def connect(cls, port):
        return cls(socket.create_connection(("127.0.0.1", port), timeout=5))

    @property
    def name(self):
        """As the other end logs it."""
        return "%s:%d" % self.sock.getsockname()

    def send(self, data):
        try:
            self.sock.sendall(data)
            return True
        except OSError:  # closed at the other end
            return False

    def exactly(self, n):
        data = b""
        while len(data) < n:
            piece = self.sock.recv(n - len(data))
            if not piece:
                raise ConnectionError("closed")
            data += piece
        return data

    def receive(self):
        """(type, control) of the next message; acknowledgements are skipped."""
        while True:
            message = self.exactly(struct.unpack("<I20x", self.exactly(24))[0] - 20)
            if message:
                kind, _, length = struct.unpack_from("<HHI", message)
                return kind, message[16:16 + length]

    def prove(self, secret, role="connects"):
        """Answers the other end's challenge."""
        kind, control = self.receive()
        while kind != CHALLENGE:
            kind, control = self.receive()
        code = hmac.digest(secret.encode(), role.encode() + fields(control)[0][2], hashlib.sha256)
        self.send(frame(payload(PROOF, field(1, code))))

    def wait_closed(self, seconds):
        """Whether the other end closes; what it still says is read and dropped."""
        self.sock.settimeout(seconds)
        try:
            while self.sock.recv(65536):
                pass
            return True
        except ConnectionError:
            return True
        except OSError:
            return False

    def close(self):
        self.sock.close()
