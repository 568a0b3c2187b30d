"""Sends frames from a Python program to an eyebox display (docs/live-input.md).

The module needs Linux and only the standard library. It implements the format itself and is no binding of the Rust
crate, so a program needs only this file. `samples` and `dioptres` are objects with a buffer, such as bytes, array.array
or contiguous NumPy arrays. A program looks like this.

    with eyebox_live.Live("demo") as live:
        while request := live.wait(1.0):
            live.send(live.color_and_depth(), samples, dioptres, request=request)
"""

import ctypes, fcntl, mmap, os, platform, select, socket, struct, sys, threading, time
from collections import namedtuple

VIEWS, COLOR_AND_DEPTH, LAYERS = 1, 2, 4
U8, U16, F16, F32 = 1, 2, 3, 4
LINEAR, SRGB = 1, 2
SAMPLE_BYTES = {U8: 1, U16: 2, F16: 2, F32: 4}
MAGIC = b"EYELIVE1"

#: A request of the display. Times are nanoseconds of time.monotonic_ns().
Request = namedtuple(
    "Request",
    "number lit_ns period_ns pupil_x_mm pupil_y_mm pupil_diameter_mm focus_dioptres velocity_x_mm_s velocity_y_mm_s "
    "kind tracked view_rows view_columns pitch_mm center_x_mm center_y_mm",
)
#: The description of a frame.
Frame = namedtuple("Frame", "kind sample transfer view_rows view_columns pitch_mm dioptres")


try:
    from ._eyebox import EyeboxError as _Base
except ImportError: # The file is alone, without the package eyebox.
    _Base = Exception


class LiveError(_Base):
    """An error of live input, with a message of one line. In the package eyebox it is an EyeboxError."""


class Gone(LiveError):
    """The display is gone."""


_lock = threading.Lock()


def _barrier():
    """Takes a lock twice. No memory access moves past both rounds on x86-64 and AArch64."""
    for _ in range(2):
        with _lock:
            pass


def _folder():
    given = os.environ.get("XDG_RUNTIME_DIR", "")
    return os.path.join(given, "eyebox") if os.path.isabs(given) else f"/tmp/eyebox-{os.geteuid()}"


class Live:
    """A connection to the display that takes frames as live:NAME."""

    def __init__(self, name):
        if sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64"):
            raise LiveError("live input: supported only on Linux on x86-64 or AArch64")
        letters = name.replace("-", "a").replace("_", "a").replace(".", "a")
        if not (1 <= len(name) <= 64 and letters.isascii() and letters.isalnum()) or name.startswith("."):
            raise LiveError("a name has 1 to 64 letters, digits, '.', '_' and '-', and does not begin with '.'")
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._connect(os.path.join(_folder(), name + ".sock"))
        except BaseException:
            self.socket.close()
            raise

    def _connect(self, path):
        try:
            self.socket.settimeout(10)
            self.socket.connect(path)
            _, uid, _ = struct.unpack("iII", self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
            if uid != os.geteuid():
                raise LiveError(f"the display belongs to user {uid}, but only user {os.geteuid()} is accepted")
            message, fds, _, _ = socket.recv_fds(self.socket, 128, 1)
        except OSError as error:
            raise LiveError(f"no display takes frames there: {error}") from None
        try:
            if len(message) != 128 or message[:12] != MAGIC + b"\1\0\0\0":
                raise LiveError("no greeting of live input, version 1")
            refused, length = struct.unpack_from("=IQ", message, 12)
            if refused or not fds:
                raise LiveError("the display refused: " + message[24:].rstrip(b"\0").decode(errors="replace"))
            seals = fcntl.fcntl(fds[0], getattr(fcntl, "F_GET_SEALS", 1034))
            if seals & 6 != 6 or os.fstat(fds[0]).st_size != length or length < 4096:
                raise LiveError("the display's memory is not sealed, or has another length than announced")
            self._map = mmap.mmap(fds[0], length)
        finally:
            for fd in fds:
                os.close(fd)
        self.socket.setblocking(False)
        magic, version, self.slots, length_again, self._first, self._stride, self._room = struct.unpack_from("=8sII4Q", self._map)
        self.rows, self.columns, *self.most_views, self.most_layers, self.colors, self.kinds = struct.unpack_from("=7I", self._map, 48)
        self.pixel_angle, *self.eyebox_mm = struct.unpack_from("=3d", self._map, 80)
        fits = length == length_again == self._first + self.slots * self._stride and self._room + 512 <= self._stride
        if magic != MAGIC or version != 1 or not fits or not 3 <= self.slots <= 8 or self._first != 4096:
            raise LiveError("the display sent damaged data: its numbers do not fit each other")
        self.channels = bin(self.colors).count("1")
        self._newest, self._frames, self._seen = None, 0, 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Closes the connection to the display."""
        self.socket.close()
        self._map.close()

    def _get(self, at):
        return ctypes.c_uint64.from_buffer(self._map, at).value

    def _put(self, at, value):
        # The write must be atomic, and struct.pack_into writes byte by byte.
        ctypes.c_uint64.from_buffer(self._map, at).value = value

    def request(self):
        """Returns the current request of the display, or None before the first request."""
        for _ in range(1000):
            before = self._get(192)
            _barrier()
            words = struct.unpack_from("=QqQ6d4I3d", self._map, 200)
            _barrier()
            if before % 2 == 0 and before == self._get(192):
                return Request(*words) if before else None
        return None

    def wait(self, seconds):
        """Waits for a request that no earlier wait returned.

        Returns None if none arrived in `seconds`. Raises Gone if the display is gone.
        """
        until = time.monotonic() + seconds
        while True:
            left = until - time.monotonic()
            try:
                if self.socket.recv(4096) == b"":
                    raise Gone("the display is gone")
            except BlockingIOError:
                pass
            except ConnectionError: # The display ended before it had read all bytes from here.
                raise Gone("the display is gone") from None
            except OSError as error:
                raise Gone(f"the display is gone: {error}") from None
            request = self.request()
            if request and request.number != self._seen:
                self._seen = request.number
                return request
            if left <= 0:
                return None
            select.select([self.socket], [], [], left)

    def views(self, rows, columns, pitch_mm, sample=U8, transfer=SRGB):
        """Describes frames of (view row, view column, row, column, color)."""
        return Frame(VIEWS, sample, transfer, rows, columns, pitch_mm, ())

    def color_and_depth(self, sample=U8, transfer=SRGB):
        """Describes frames of (row, column, color), with float32 dioptres of (row, column)."""
        return Frame(COLOR_AND_DEPTH, sample, transfer, 1, 1, 0.0, ())

    def layers(self, dioptres, sample=U8, transfer=SRGB):
        """Describes frames of (layer, row, column, color and opacity), with the farthest layer first."""
        return Frame(LAYERS, sample, transfer, 1, 1, 0.0, tuple(dioptres))

    def _bytes(self, frame):
        pixels = self.rows * self.columns
        count = {VIEWS: frame.view_rows * frame.view_columns * self.channels, COLOR_AND_DEPTH: self.channels}
        count[LAYERS] = len(frame.dioptres) * (self.channels + 1)
        return pixels * count[frame.kind] * SAMPLE_BYTES[frame.sample], 4 * pixels * (frame.kind == COLOR_AND_DEPTH)

    def _slot(self):
        """Takes a slot that is neither the newest nor held, and makes its sequence odd."""
        while True:
            for slot in range(self.slots):
                at = self._first + slot * self._stride
                if slot == self._newest or self._get(128) == slot + 1:
                    continue
                before = self._get(at)
                self._put(at, before | 1)
                _barrier()
                if self._get(128) != slot + 1 or before % 2:
                    return slot, at
                self._put(at, before)

    def send(self, frame, samples, dioptres=b"", request=None, content_time_ns=None, center_mm=(0.0, 0.0)):
        """Sends a frame, as the answer to `request` if it is given. Returns the number of the frame."""
        samples, dioptres = memoryview(samples).cast("B"), memoryview(dioptres).cast("B")
        need, depth = self._bytes(frame)
        if not frame.kind & self.kinds or len(frame.dioptres) > min(64, self.most_layers):
            raise LiveError("the display takes no frame of this kind, or with this number of layers")
        if (len(samples), len(dioptres)) != (need, depth):
            raise LiveError(f"{len(samples)} bytes of samples and {len(dioptres)} of depths, but must be {need} and {depth}")
        total = (need + 63) // 64 * 64 + depth if depth else need
        if total > self._room:
            raise LiveError(f"{total} bytes, but the display takes at most {self._room}")
        if content_time_ns is None:
            content_time_ns = request.lit_ns if request else 0
        slot, at = self._slot()
        struct.pack_into(
            "=QQq8I3dIIQ24x64f", self._map, at + 8, self._frames + 1, request.number if request else 0, content_time_ns,
            frame.kind, frame.sample, frame.transfer, self.colors, self.rows, self.columns, frame.view_rows, frame.view_columns,
            frame.pitch_mm, *center_mm, len(frame.dioptres), 0, total, *frame.dioptres, *[0.0] * (64 - len(frame.dioptres)),
        )
        start = at + 512
        self._map[start : start + need] = samples
        if depth:
            self._map[start + total - depth : start + total] = dioptres
        _barrier()
        self._put(at, (self._get(at) | 1) + 1)
        self._newest, self._frames = slot, self._frames + 1
        try:
            self.socket.send(b"\1", socket.MSG_NOSIGNAL)
        except OSError:
            pass
        return self._frames
