"""TLS 1.3 between hosts (src/wire/README.md, TLS). Python's own ssl module gives no keying material of a channel (RFC 9266),
to which the proof of the secret is bound; pyOpenSSL does."""
import datetime
import ipaddress

from OpenSSL import SSL, crypto

BINDING = b"EXPORTER-Channel-Binding", 32  # RFC 9266: label, bytes
CHUNK = 1 << 16


def own_key_and_certificate():
    """Made anew in every process and naming nobody: the secret's proof says who is there."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([])
    now = datetime.datetime.now(datetime.timezone.utc)
    certificate = (x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
                   .serial_number(x509.random_serial_number()).not_valid_before(now - datetime.timedelta(days=1))
                   .not_valid_after(now + datetime.timedelta(days=3650)).sign(key, hashes.SHA256()))
    return crypto.PKey.from_cryptography_key(key), crypto.X509.from_cryptography(certificate)


class Tls:
    """Which connections are encrypted, and with what."""

    def __init__(self, mode="auto"):
        self.mode = mode
        if mode == "off":
            return
        self.context = SSL.Context(SSL.TLS_METHOD)
        self.context.set_min_proto_version(SSL.TLS1_3_VERSION)
        self.context.set_options(SSL.OP_NO_TICKET)
        self.context.set_session_cache_mode(SSL.SESS_CACHE_OFF)
        self.context.set_verify(SSL.VERIFY_NONE, lambda *_: True)
        key, certificate = own_key_and_certificate()
        self.context.use_privatekey(key)
        self.context.use_certificate(certificate)

    def encrypts(self, writer):
        if self.mode != "auto":
            return self.mode == "on"
        address = ipaddress.ip_address(writer.get_extra_info("peername")[0].partition("%")[0])
        return not (getattr(address, "ipv4_mapped", None) or address).is_loopback

    async def opened(self, reader, writer, server):
        """(reader, writer, binding): the same pair and b"" where nothing is encrypted."""
        if not self.encrypts(writer):
            return reader, writer, b""
        channel = Channel(self.context, reader, writer)
        await channel.shake_hands(server)
        return channel, channel, channel.connection.export_keying_material(*BINDING)


class Channel:
    """A StreamReader and a StreamWriter, as far as hosts need them, over an encrypted connection."""

    def __init__(self, context, reader, writer):
        self.reader, self.writer = reader, writer
        self.connection = SSL.Connection(context, None)
        self.waiting = bytearray()

    async def shake_hands(self, server):
        (self.connection.set_accept_state if server else self.connection.set_connect_state)()
        while True:
            try:
                self.connection.do_handshake()
                return self.flush()
            except SSL.WantReadError:
                self.flush()
                await self.take()
            except SSL.Error as e:
                self.flush()
                raise ConnectionError(f"no TLS connection: {e}") from e

    async def take(self):
        data = await self.reader.read(CHUNK)
        if not data:
            raise ConnectionError("closed")
        self.connection.bio_write(data)

    def flush(self):
        while True:
            try:
                self.writer.write(self.connection.bio_read(CHUNK))
            except SSL.WantReadError:
                return

    async def readexactly(self, count):
        while len(self.waiting) < count:
            try:
                self.waiting += self.connection.recv(CHUNK)
            except SSL.WantReadError:
                await self.take()
            except SSL.Error as e:
                raise ConnectionError(f"the encrypted connection ends: {e}") from e
        data = bytes(self.waiting[:count])
        del self.waiting[:count]
        return data

    def write(self, data):
        data = memoryview(data)
        while data:
            data = data[self.connection.send(data[:CHUNK]):]
            self.flush()

    def close(self):
        self.writer.close()
