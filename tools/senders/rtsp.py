"""Receives one RTP stream by RTSP, over UDP or inside the RTSP connection (RFC 2326, 3550 and 4566).

It reads the streams of trackers, which have one medium of interest and no password. Reports of the sender give the
times of the packets.
"""

import collections, os, re, select, socket, struct, time
from urllib.parse import urlsplit

# Seconds between 1900, where NTP begins, and 1970.
NTP_UNIX = 2208988800
# A longer header or body is no answer of a tracker, bytes.
LONGEST = 65536
# Unsupported transport.
NOT_THIS_TRANSPORT = 461


class Refused(Exception):
    """An answer that another attempt does not change."""


class Medium:
    """The payload type, the clock rate and the address of one medium in a session description."""

    def __init__(self, description, encoding):
        """Finds the medium of an encoding. Raises Refused if there is none."""
        encodings, self.control = [], "*"
        # The first part belongs to the whole session.
        for part in re.split(r"^m=", description, flags=re.MULTILINE)[1:]:
            match = re.search(r"^a=rtpmap: *(\d+) +([^/\s]+)/(\d+)", part, re.MULTILINE)
            encodings += [match[2]] if match else []
            if match and match[2].lower() == encoding.lower() and int(match[3]) > 0:
                self.payload_type, self.rate = int(match[1]), int(match[3])
                control = re.search(r"^a=control:(\S+)", part, re.MULTILINE)
                self.control = control[1] if control else "*"
                return
        raise Refused(f"its stream is {', '.join(encodings) or 'empty'}, and not {encoding}")

    def address(self, base):
        """Returns the address of the medium. A relative address follows the base, as in the programs of the maker."""
        if self.control == "*":
            return base
        if "://" in self.control:
            return self.control
        return base + ("" if base.endswith("/") or self.control.startswith("/") else "/") + self.control


class Packet:
    """An RTP packet. `payload` is None if the bytes are no RTP packet."""

    def __init__(self, data):
        self.payload = None
        if len(data) < 12 or data[0] >> 6 != 2:
            return
        self.payload_type = data[1] & 0x7F
        self.sequence, self.stamp = struct.unpack("!HI", data[2:8])
        begin, end = 12 + 4 * (data[0] & 0x0F), len(data)
        if data[0] & 0x10:
            if end < begin + 4:
                return
            begin += 4 + 4 * struct.unpack("!H", data[begin + 2 : begin + 4])[0]
        if data[0] & 0x20:
            end -= data[-1]
        if begin <= end:
            self.payload = data[begin:end]


def reports(data):
    """Yields the parts of an RTCP packet that matter, as ("report", Unix seconds, RTP time) or ("bye", 0, 0)."""
    while len(data) >= 4 and data[0] >> 6 == 2:
        end = 4 + 4 * struct.unpack("!H", data[2:4])[0]
        if end > len(data):
            return
        if data[1] == 200 and end >= 28:
            seconds, fraction, stamp = struct.unpack("!III", data[8:20])
            # The seconds of NTP start again in 2036.
            seconds += 0 if seconds >= NTP_UNIX else 1 << 32
            yield "report", seconds - NTP_UNIX + fraction / 2**32, stamp
        elif data[1] == 203:
            yield "bye", 0, 0
        data = data[end:]


class RtpClock:
    """Gives the Unix time of packets. RTP times have 32 bits, so they are read from the last report of the sender."""

    def __init__(self, rate):
        self.rate, self.report = rate, None

    def set(self, seconds, stamp):
        """Takes a report of the sender."""
        self.report = (seconds, stamp)

    def time(self, stamp):
        """Returns Unix seconds, or None before the first report."""
        if self.report is None:
            return None
        seconds, at = self.report
        difference = (stamp - at + (1 << 31)) % (1 << 32) - (1 << 31)
        return seconds + difference / self.rate


class Answer:
    """An answer to an RTSP request, or a request of the other side, which has status 0."""

    def __init__(self, head, body):
        first, *lines = head.decode("utf-8", "replace").split("\r\n")
        match = re.fullmatch(r"RTSP/\d\.\d (\d{3}).*", first)
        self.status, self.body = int(match[1]) if match else 0, body.decode("utf-8", "replace")
        pairs = (line.split(":", 1) for line in lines if ":" in line)
        self.headers = {key.strip().lower(): value.strip() for key, value in pairs}


class Connection:
    """A TCP connection with RTSP messages and, between them, frames of RTP and RTCP."""

    def __init__(self, host, port, timeout):
        self.socket = socket.create_connection((host, port), timeout)
        self.timeout, self.data, self.sequence, self.session = timeout, b"", 0, None
        self.frames = collections.deque()

    def receive(self):
        """Reads more bytes. Raises OSError at the end of the connection."""
        data = self.socket.recv(LONGEST)
        if not data:
            raise OSError("the connection was closed")
        self.data += data

    def next(self):
        """Returns the next Answer of the received bytes, or None. Frames go to `frames` as (channel, bytes)."""
        while self.data:
            if self.data[0] == 0x24:
                if len(self.data) < 4:
                    return None
                channel, size = struct.unpack("!BH", self.data[1:4])
                if len(self.data) < 4 + size:
                    return None
                self.frames.append((channel, self.data[4 : 4 + size]))
                self.data = self.data[4 + size :]
                continue
            head, found, rest = self.data.partition(b"\r\n\r\n")
            if not found:
                if len(self.data) > LONGEST:
                    raise OSError("the other side does not speak RTSP")
                return None
            size = re.search(rb"\r\ncontent-length: *(\d{1,9}) *(?:\r\n|$)", head, re.IGNORECASE)
            size = int(size[1]) if size else 0
            if size > LONGEST:
                raise OSError(f"an answer of {size} bytes is too long")
            if len(rest) < size:
                return None
            self.data = rest[size:]
            return Answer(head, rest[:size])
        return None

    def send(self, method, address, **headers):
        """Sends a request."""
        self.sequence += 1
        headers = {"CSeq": self.sequence, "User-Agent": "eyebox", **headers}
        if self.session:
            headers["Session"] = self.session
        lines = (f"{key.replace('_', '-')}: {value}\r\n" for key, value in headers.items())
        self.socket.sendall(f"{method} {address} RTSP/1.0\r\n{''.join(lines)}\r\n".encode())

    def request(self, method, address, **headers):
        """Sends a request and returns its Answer. Raises Refused for all statuses but 2xx and 461."""
        self.send(method, address, **headers)
        until = time.monotonic() + self.timeout
        while True:
            while answer := self.next():
                if answer.status == 0 or answer.headers.get("cseq") != str(self.sequence):
                    continue
                if answer.status // 100 != 2 and answer.status != NOT_THIS_TRANSPORT:
                    raise Refused(f"it answers {method} with status {answer.status}")
                return answer
            if time.monotonic() > until:
                raise OSError(f"no answer to {method} within {self.timeout:g} s")
            self.receive()


def two_ports(address):
    """Returns two UDP sockets at ports next to each other. The first port is even, as servers expect."""
    for _ in range(20):
        first = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            first.bind((address, 0))
            port = first.getsockname()[1]
            second.bind((address, port ^ 1))
            return (first, second) if port % 2 == 0 else (second, first)
        except OSError:
            first.close()
            second.close()
    raise OSError("no two UDP ports next to each other are free")


class Stream:
    """A playing stream. `over` is "udp" or "tcp". If the server refuses UDP, the stream comes by TCP."""

    def __init__(self, url, encoding, over="udp", timeout=5.0):
        parts = urlsplit(url)
        self.url, self.timeout, self.sockets, self.channels, self.ports = url, timeout, (), (0, 1), ()
        self.source = struct.unpack("!I", os.urandom(4))[0]
        self.connection = Connection(parts.hostname, parts.port or 554, timeout)
        try:
            self.begin(encoding, over)
        except BaseException:
            self.close()
            raise

    def begin(self, encoding, over):
        """Requests the stream."""
        request = self.connection.request
        public = request("OPTIONS", self.url).headers.get("public", "")
        self.keeps = "GET_PARAMETER" if "GET_PARAMETER" in public.upper() else "OPTIONS"
        answer = request("DESCRIBE", self.url, Accept="application/sdp")
        base = answer.headers.get("content-base", "")
        # Phones may leave out the scheme.
        self.url = base if base.startswith("rtsp://") else self.url
        self.medium = Medium(answer.body, encoding)
        setup = self.medium.address(self.url)
        if over == "udp":
            self.sockets = two_ports(self.connection.socket.getsockname()[0])
            ports = "-".join(str(s.getsockname()[1]) for s in self.sockets)
            answer = request("SETUP", setup, Transport=f"RTP/AVP;unicast;client_port={ports}")
            if answer.status == NOT_THIS_TRANSPORT:
                self.close_sockets()
        if not self.sockets:
            answer = request("SETUP", setup, Transport="RTP/AVP/TCP;unicast;interleaved=0-1")
        if answer.status == NOT_THIS_TRANSPORT:
            raise Refused("it offers neither UDP nor TCP")
        transport = answer.headers.get("transport", "")
        pair = re.search(r"(?:interleaved|server_port)=(\d+)-(\d+)", transport)
        pair = (int(pair[1]), int(pair[2])) if pair else ()
        self.channels, self.ports = (self.channels, pair) if self.sockets else (pair or (0, 1), ())
        self.connection.session, _, options = answer.headers.get("session", "").partition(";")
        lasts = re.search(r"timeout=(\d+)", options)
        # Most servers end a session that is silent for 60 s.
        self.every = max(1.0, 0.5 * int(lasts[1]) if lasts else 25.0)
        request("PLAY", self.url, Range="npt=now-")
        self.keep()

    def keep(self):
        """Sends an empty report of a receiver to both ports. It opens firewalls for the datagrams of the server."""
        self.kept = time.monotonic()
        report = struct.pack("!BBHI", 0x80, 201, 1, self.source)
        report += struct.pack("!BBHIBB6sxxxx", 0x81, 202, 4, self.source, 1, 6, b"eyebox")
        for ours, port in zip(self.sockets, self.ports):
            ours.sendto(report, (self.connection.socket.getpeername()[0], port))

    def received(self):
        """Waits for bytes and yields them as (0 for RTP or 1 for RTCP, bytes). Raises OSError after a silence."""
        tcp = self.connection.socket
        # Frames may arrive together with an answer. They are yielded before a wait that could end with the connection.
        pending = bool(self.connection.frames)
        ready, _, _ = ([], [], []) if pending else select.select([tcp, *self.sockets], [], [], self.timeout)
        if not ready and not pending:
            over = "UDP (a firewall may stop it, then TCP passes)" if self.sockets else "TCP"
            raise OSError(f"no data for {self.timeout:g} s over {over}")
        if tcp in ready:
            self.connection.receive()
            while self.connection.next():
                pass
        # Reports come first, because they give the times of the packets.
        for kind in (1, 0):
            if self.sockets and self.sockets[kind] in ready:
                data, (host, _) = self.sockets[kind].recvfrom(LONGEST)
                if host == tcp.getpeername()[0]:
                    yield kind, data
        while self.connection.frames:
            channel, data = self.connection.frames.popleft()
            if channel in self.channels:
                yield self.channels.index(channel), data

    def payloads(self):
        """Yields payloads with their Unix times, without end. The time is None before the first report.

        Late packets are left out, because newer samples were already read. Raises OSError if the stream ends.
        """
        clock, last = RtpClock(self.medium.rate), None
        while True:
            for kind, data in self.received():
                if kind == 1:
                    for what, seconds, stamp in reports(data):
                        if what == "bye":
                            raise OSError("the stream was ended")
                        clock.set(seconds, stamp)
                    continue
                packet = Packet(data)
                if packet.payload is None or packet.payload_type != self.medium.payload_type:
                    continue
                if last is not None and (packet.sequence - last) % 65536 not in range(1, 32768):
                    continue
                last = packet.sequence
                yield clock.time(packet.stamp), packet.payload
            if time.monotonic() > self.kept + self.every:
                self.connection.send(self.keeps, self.url)
                self.keep()

    def close_sockets(self):
        """Closes the sockets of UDP."""
        for ours in self.sockets:
            ours.close()
        self.sockets = ()

    def close(self):
        """Ends the session. Errors do not matter then."""
        try:
            if self.connection.session:
                self.connection.send("TEARDOWN", self.url)
        except OSError:
            pass
        self.connection.socket.close()
        self.close_sockets()
