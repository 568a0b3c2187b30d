#!/usr/bin/env python3
"""Sends the eyes of a Pupil Labs Neon to eyebox. It needs no package.

The Companion app has to compute the eye state. The program follows the documents and the code of the maker and is not
yet tested on a Neon. Run neon.py --simulate to test the connection without one.
"""

import http.client, json, math, socket, statistics, struct, sys, threading, time, urllib.request
from place import Eyes, add_arguments
from rtsp import Refused, Stream
from sender import Age, Sender, arguments, simulate

ENCODING = "com.pupillabs.gaze1"
PORT = 8080
# Payloads by length, bytes, and whether they have the eye state and the lids. Numbers are big-endian. Each begins with
# the gaze in pixels of the scene camera and one byte, which is 255 if the glasses are worn.
WITHOUT_STATE, WITH_STATE, WITH_LIDS = (False, False), (True, False), (True, True)
PAYLOADS = {9: WITHOUT_STATE, 17: WITHOUT_STATE, 25: WITHOUT_STATE, 65: WITH_STATE, 89: WITH_LIDS, 105: WITH_LIDS}
STATE = struct.Struct("!14f")
LIDS = struct.Struct("!6f")
WORN, AFTER_WORN, AFTER_STATE = 8, 9, 65
# The time echo has steps of 1 ms, so the median of this number of echoes is used.
ECHOES = 25
# The clocks of phone and computer drift, so the echo is repeated after this time, seconds.
ECHO_S = 60.0
# A stream that ended is requested again after this time, seconds.
AGAIN_S = 1.0
# Reports of the sender come every few seconds.
REPORT_S = 15.0


def note(text):
    """Prints a note."""
    print(f"neon: {text}", file=sys.stderr)


def add(parser):
    """Adds the arguments of this sender."""
    about = "address of the phone [default: neon.local]"
    parser.add_argument("--phone", default="neon.local", metavar="HOST[:PORT]", help=about)
    parser.add_argument("--over", choices=("udp", "tcp"), default="udp", help="transport of the samples [default: udp]")
    about = "an eye is not seen if its lids are less than this apart, if the app measures them [default: 3]"
    parser.add_argument("--closed", type=float, default=3.0, metavar="MM", help=about)
    add_arguments(parser)


class Phone:
    """The addresses of the gaze stream and of the time echo, from the status of the phone."""

    def __init__(self, address, timeout=5.0):
        """Requests the status. Raises OSError if nothing answers, and Refused if the answer has no gaze."""
        host, _, port = address.partition(":")
        url = f"http://{host}:{port or PORT}/api/status"
        # A proxy does not reach a phone in the local network.
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(url, timeout=timeout) as answer:
                text = answer.read(1 << 20)
            parts = [(part["model"], part["data"]) for part in json.loads(text)["result"]]
            sensors = [data for model, data in parts if model == "Sensor" and data["sensor"] == "gaze"]
            direct = [sensor for sensor in sensors if sensor["conn_type"] == "DIRECT"]
            phone = next((data for model, data in parts if model == "Phone"), {})
            self.echo = (phone.get("ip") or host, port) if (port := phone.get("time_echo_port")) else None
            connected = [sensor for sensor in direct if sensor.get("connected")]
            form = "{protocol}://{ip}:{port}/?{params}"
            urls = [form.format(**{"protocol": "rtsp", **sensor}) for sensor in connected]
        except (ValueError, KeyError, TypeError, AttributeError, http.client.HTTPException):
            raise Refused(f"{url} is not the status of a Companion app") from None
        if not urls:
            state = "is not connected to the phone" if direct else "has no direct gaze stream"
            raise Refused(f"the Neon {state}, by {url}")
        self.url = urls[0]


def echo(address, count=ECHOES, timeout=5.0, now=time.time):
    """Returns the seconds to add to the phone's time for the time of this computer.

    Each echo has the time of the request and the time of the phone, milliseconds.
    """
    offsets = []
    with socket.create_connection(address, timeout) as phone:
        phone.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(count + 1):
            begun = now()
            sent = struct.pack("!Q", int(1e3 * begun))
            phone.sendall(sent)
            answer = b""
            while len(answer) < 16:
                more = phone.recv(16 - len(answer))
                if not more:
                    raise OSError("the time echo was closed")
                answer += more
            if answer[:8] == sent:
                offsets.append((begun + now()) / 2 - struct.unpack("!Q", answer[8:])[0] / 1e3)
    if len(offsets) < 2:
        raise OSError("the time echo does not answer with the time of the request")
    # The first echo is slower, because it opens the connection.
    return statistics.median(offsets[1:])


class Echo:
    """The offset of the phone's clock. It is measured at the start and then by a thread."""

    def __init__(self, address):
        self.address, self.offset = address, None
        self.measure()
        if self.offset is None:
            note("the phone has no time echo: times stay on its clock")
        else:
            threading.Thread(target=self.repeat, daemon=True).start()

    def measure(self):
        """Measures the offset. The last one stays if the phone does not answer."""
        try:
            self.offset = echo(self.address) if self.address else None
        except OSError:
            pass

    def repeat(self):
        """Measures the offset again and again."""
        while True:
            time.sleep(ECHO_S)
            self.measure()


class Payload:
    """One sample of the app. `eyes` has the center, the axis, the diameter and the aperture of each eye, mm."""

    def __init__(self, data):
        """Reads a payload. Raises Refused if it has no eye state."""
        if len(data) not in PAYLOADS:
            raise Refused(f"samples of {len(data)} bytes are unknown (known: {', '.join(map(str, PAYLOADS))})")
        has_state, has_lids = PAYLOADS[len(data)]
        if not has_state:
            need = "turn on 'Compute eye state' in the Companion app"
            raise Refused(f"samples of {len(data)} bytes have the gaze in pixels and no eye state: {need}")
        self.worn = data[WORN] == 255
        state = STATE.unpack_from(data, AFTER_WORN)
        lids = LIDS.unpack_from(data, AFTER_STATE) if has_lids else (math.nan,) * 6
        halves = zip(("left", "right"), (state[:7], state[7:]), (lids[2], lids[5]))
        self.eyes = {side: (one[1:4], one[4:7], one[0], aperture) for side, one, aperture in halves}

    def describe(self, eyes, closed):
        """Describes the eyes for eyebox. An eye with unknown lids is not closed."""
        found = {}
        for side, (center, axis, diameter, aperture) in self.eyes.items():
            found[side] = eyes.ball(side, center, axis, self.worn and not aperture < closed, diameter)
        return {side: eye for side, eye in found.items() if eye}


def samples(phone, args, eyes, clock):
    """Yields the samples of one stream for eyebox, until it ends with OSError."""
    stream, begun, seen = Stream(phone.url, ENCODING, args.over), time.monotonic(), False
    try:
        for seconds, data in stream.payloads():
            if seconds is None:
                # Packets before the first report have no time.
                if time.monotonic() > begun + REPORT_S:
                    raise Refused(f"no RTCP report of the phone came within {REPORT_S:g} s, so samples have no time")
                continue
            try:
                sample, seen = Payload(data).describe(eyes, args.closed), True
            except Refused:
                # The user may turn the eye state off and on again.
                if not seen:
                    raise
                continue
            yield {"t": seconds + (clock.offset or 0), "t_unit": "s", **sample}
    finally:
        stream.close()


def main():
    args = arguments(__doc__, add)
    sender = Sender(args)
    if args.simulate:
        return simulate(sender.send)
    eyes, age, clock, played, noted = Eyes(args), Age("neon"), None, False, None
    while True:
        try:
            phone = Phone(args.phone)
            clock = clock or Echo(phone.echo)
            for sample in samples(phone, args, eyes, clock):
                played, noted = True, None
                if clock.offset is not None:
                    age.add(time.time() - sample["t"])
                if not sender.send(sample):
                    return
        except (Refused, OSError) as error:
            # A stream that once played returns when phone and glasses are connected again.
            if not played:
                raise SystemExit(f"neon: {args.phone}: {error}")
            if noted != str(error):
                noted = str(error)
                note(f"{args.phone}: {error}. Trying again")
            time.sleep(AGAIN_S)


if __name__ == "__main__":
    main()
