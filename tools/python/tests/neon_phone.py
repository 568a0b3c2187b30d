"""A phone with a Neon, as its Companion app is in the network. It has the status, the gaze stream and the time echo.

It is as strict as the protocols are. The tests also read it with the client of the maker, if that is installed.
"""

import http.server
import json
import re
import socket
import struct
import threading
import time

NTP_UNIX = 2208988800
RATE = 90000
PAYLOAD_TYPE = 99
SESSION = "1185d20035702ca"
# The example of the maker's document: centers of both eyeballs, mm.
LEFT, RIGHT = (-29.3, 11.7, -42.2), (33.2, 12.8, -45.3)


DIAMETERS = (4.5, 3.5)


def payload(left=(0.0, 0.0, 1.0), right=(0.6, 0.0, 0.8), *, length=89, worn=255, apertures=(9.0, 9.5)):
    """Packs a sample of one of the app's lengths. `left` and `right` are optical axes."""
    gaze = struct.pack("!ffB", 800.5, 600.25, worn)
    eyes = (struct.pack("!7f", d, *c, *a) for d, c, a in zip(DIAMETERS, (LEFT, RIGHT), (left, right)))
    state = b"".join(eyes)
    lids = b"".join(struct.pack("!3f", 0.3, -0.3, aperture) for aperture in apertures)
    second, both = struct.pack("!ff", 801.0, 601.0), struct.pack("!4f", 799.0, 599.0, 801.0, 601.0)
    parts = {9: (), 17: (second,), 25: (both,), 65: (state,), 89: (state, lids), 105: (state, lids, both)}
    return gaze + b"".join(parts.get(length, (bytes(max(0, length - 9)),)))


class Phone:
    """Serves until the end of its block. The samples are pairs of Unix seconds and payloads.

    The phone reports its clock before the sample with index `report`, unless this is None. The time between samples is
    `pace` seconds. The stream ends after the samples with `goodbye`, and starts again with `again`. The phone closes
    the first connection after `drop_after` samples. The RTP time of the first sample is `first`.
    """

    def __init__(self, samples, **settings):
        self.samples, self.sessions, self.requests, self.receiver_reports = samples, 0, [], []
        defaults = {"report": 0, "goodbye": False, "again": False, "first": 2**32 - 100, "base": "full"}
        defaults |= {"udp": True, "tcp": True, "connected": True, "encoding": "com.pupillabs.gaze1", "behind": 0.0}
        defaults |= {"has_echo": True, "status": None, "drop_after": None, "pace": 0.0}
        assert not set(settings) - set(defaults), settings
        self.__dict__.update(defaults | settings)
        self.ended, self.threads = threading.Event(), []

    def __enter__(self):
        self.rtsp, self.echo = (socket.create_server(("127.0.0.1", 0)) for _ in range(2))
        self.ports = [server.getsockname()[1] for server in (self.rtsp, self.echo)]
        phone = self

        class Status(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                text = phone.status or json.dumps(phone.answer())
                self.send_response(200 if self.path == "/api/status" else 404)
                self.send_header("Content-Type", "application/json")
                self.end_headers()
                self.wfile.write(text.encode())

            def log_message(self, *_):
                pass

        self.http = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Status)
        self.address = f"127.0.0.1:{self.http.server_address[1]}"
        self.start(self.http.serve_forever)
        self.start(self.accept, self.rtsp, self.serve)
        self.start(self.accept, self.echo, self.answer_echo)
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.http.shutdown()
        for server in (self.http, self.rtsp, self.echo):
            server.close() if server is not self.http else server.server_close()

    def start(self, *call):
        thread = threading.Thread(target=call[0], args=call[1:], daemon=True)
        thread.start()

    def accept(self, server, serve):
        while not self.ended.is_set():
            try:
                connection, _ = server.accept()
            except OSError:
                return
            self.start(serve, connection)

    def answer(self):
        """The answer of /api/status. A sensor of the other kind of connection comes first."""
        phone = {"battery_level": 80, "battery_state": "OK", "device_id": "d", "device_name": "Neon", "ip": "127.0.0.1"}
        phone |= {"memory": 1 << 35, "memory_state": "OK"}
        phone |= {"time_echo_port": self.ports[1]} if self.has_echo else {}
        sensor = {"sensor": "gaze", "ip": "127.0.0.1", "port": self.ports[0], "protocol": "rtsp", "stream_error": False}
        sensor |= {"params": "camera=gaze&audioenable=on", "connected": self.connected}
        sensors = [{**sensor, "sensor": "world", "conn_type": "DIRECT", "port": 1, "params": "camera=world"}]
        sensors += [{**sensor, "conn_type": "WEBSOCKET", "protocol": "ws", "port": 1}]
        sensors += [{**sensor, "conn_type": "DIRECT"}]
        hardware = {"version": "2", "module_serial": "1", "world_camera_serial": "1", "glasses_serial": "unknown"}
        parts = [("Phone", phone), ("Hardware", hardware), *(("Sensor", s) for s in sensors)]
        return {"message": "Success", "result": [{"model": model, "data": data} for model, data in parts]}

    def answer_echo(self, connection):
        """Answers the time of the request and the time of the phone, which is `behind` the time of this computer."""
        with connection:
            while len(sent := connection.recv(8)) == 8:
                connection.sendall(sent + struct.pack("!Q", int(1e3 * (time.time() - self.behind))))

    def serve(self, connection):
        """Serves one RTSP connection. A request that breaks the protocol ends with a status of 4xx."""
        with connection:
            text, state = b"", {"session": False, "send": None}
            while True:
                while b"\r\n\r\n" not in text:
                    try:
                        more = connection.recv(4096)
                    except OSError:
                        return
                    if not more:
                        return
                    text += more
                head, _, text = text.partition(b"\r\n\r\n")
                # Frames of the client, such as reports, may stand before a request.
                while head[:1] == b"$":
                    size = 4 + struct.unpack("!H", head[2:4])[0]
                    head = head[size:]
                if not self.respond(connection, state, head.decode()):
                    return

    def respond(self, connection, state, head):
        """Answers one request. Returns False after the end of the session."""
        first, *lines = head.split("\r\n")
        match = re.fullmatch(r"([A-Z_]+) ((?:rtsp://)?127\.0\.0\.1:\d+/\S*) RTSP/1\.0", first)
        headers = {k.lower(): v.strip() for k, v in (line.split(":", 1) for line in lines)}
        sequence = headers.get("cseq")
        if not match or not sequence:
            connection.sendall(b"RTSP/1.0 400 Bad Request\r\n\r\n")
            return False
        method, address = match.groups()
        self.requests.append((method, address))
        status, extra, body = "200 OK", {}, ""
        if method not in ("OPTIONS", "DESCRIBE", "SETUP") and headers.get("session", "").split(";")[0] != SESSION:
            status = "454 Session Not Found"
        elif method == "OPTIONS":
            extra["Public"] = "DESCRIBE,SETUP,TEARDOWN,PLAY,PAUSE"
        elif method == "DESCRIBE":
            status, extra, body = self.describe(headers)
        elif method == "SETUP":
            status, extra = self.set_up(connection, state, headers["transport"])
        elif method == "PLAY" and not state["send"]:
            status = "455 Method Not Valid In This State"
        pairs = "".join(f"{key}: {value}\r\n" for key, value in {"CSeq": sequence, **extra}.items())
        connection.sendall(f"RTSP/1.0 {status}\r\n{pairs}\r\n{body}".encode())
        if method == "PLAY" and status.startswith("200"):
            self.start(self.play, state["send"], connection)
        return method != "TEARDOWN"

    def describe(self, headers):
        """Describes the gaze and the audio, as the app does if the address asks for both."""
        if headers.get("accept") != "application/sdp":
            return "406 Not Acceptable", {}, ""
        body = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=Unnamed\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\na=recvonly\r\n"
        body += f"m=application 0 RTP/AVP {PAYLOAD_TYPE}\r\na=rtpmap:{PAYLOAD_TYPE} {self.encoding}/{RATE}\r\n"
        body += "a=control:trackID=2\r\n"
        body += "m=audio 0 RTP/AVP 96\r\na=rtpmap:96 mpeg4-generic/48000\r\na=control:trackID=0\r\n"
        # Some servers on phones leave out the scheme, and the client of the maker then sends addresses without it.
        bases = {"short": f"127.0.0.1:{self.ports[0]}/", "full": f"rtsp://127.0.0.1:{self.ports[0]}/gaze/", None: None}
        base = {"Content-Base": bases[self.base]} if self.base else {}
        return "200 OK", {**base, "Content-Type": "application/sdp", "Content-Length": len(body)}, body

    def set_up(self, connection, state, transport):
        """Prepares to send RTP (0) and RTCP (1) by UDP or inside the connection."""
        session = {"Session": f"{SESSION};timeout=60"}
        ports = re.fullmatch(r"RTP/AVP(?:/UDP)?;unicast;client_port=(\d+)-(\d+)", transport)
        channels = re.fullmatch(r"RTP/AVP/TCP;unicast;interleaved=(\d+)-(\d+)", transport)
        if ports and self.udp:
            first, second = map(int, ports.groups())
            if first % 2 or second != first + 1:
                return "400 Bad Request", {}
            ours = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
            for one in ours:
                one.bind(("127.0.0.1", 0))
            self.start(self.hear, ours[1])
            to = [("127.0.0.1", first), ("127.0.0.1", second)]
            state["send"] = lambda kind, data: ours[kind].sendto(data, to[kind])
            served = "-".join(str(one.getsockname()[1]) for one in ours)
            return "200 OK", {"Transport": f"{transport};server_port={served};mode=play", **session}
        if channels and self.tcp:
            numbers = [int(number) for number in channels.groups()]
            frame = struct.Struct("!cBH")
            state["send"] = lambda kind, data: connection.sendall(frame.pack(b"$", numbers[kind], len(data)) + data)
            return "200 OK", {"Transport": f"RTP/AVP/TCP;unicast;interleaved={numbers[0]}-{numbers[1]}", **session}
        return "461 Unsupported Transport", {}

    def hear(self, ours):
        """Collects the reports of the receiver."""
        while True:
            self.receiver_reports.append(ours.recv(4096))

    def play(self, send, connection):
        """Sends the samples with the header that the app has, and reports."""
        self.sessions += 1
        sequence, begun = 65530, self.samples[0][0]
        while not self.ended.is_set():
            try:
                for i, (seconds, data) in enumerate(self.samples):
                    stamp = (self.first + round((seconds - begun) * RATE)) % 2**32
                    if i == self.report:
                        send(1, sender_report(seconds, stamp))
                    header = struct.pack("!BBHII", 0x80, 0x80 | PAYLOAD_TYPE, sequence % 65536, stamp, 7)
                    send(0, header + data)
                    sequence += 1
                    self.ended.wait(self.pace)
                    if self.drop_after == i + 1 and self.sessions == 1:
                        connection.shutdown(socket.SHUT_RDWR)
                        return
                if self.goodbye:
                    send(1, struct.pack("!BBHI", 0x81, 203, 1, 7))
                if not self.again:
                    return
                self.ended.wait(0.005)
            except OSError:
                return


def sender_report(seconds, stamp):
    """Packs a report of the sender with Unix seconds and the RTP time of the same moment, and its name."""
    whole, part = divmod(seconds + NTP_UNIX, 1)
    report = struct.pack("!BBHIIIIII", 0x80, 200, 6, 7, int(whole), int(part * 2**32), stamp, 0, 0)
    return report + struct.pack("!BBHIBB1sxxxxx", 0x81, 202, 3, 7, 1, 1, b"p")
