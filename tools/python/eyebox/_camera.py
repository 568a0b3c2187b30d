"""The camera's command of a calibration whose camera is a function of another process: it passes lines on, there and back. It imports nothing of
the package, so that it is there at once."""

import json
import sys
from multiprocessing.connection import Client


def main() -> None:
    family, address, secret = sys.argv[1:]
    with open(secret, "rb") as file:
        key = file.read()
    there = Client(tuple(json.loads(address)) if family == "AF_INET" else address, authkey=key)
    for line in sys.stdin:
        there.send_bytes(line.encode())
        print(there.recv_bytes().decode(), flush=True)


if __name__ == "__main__":
    main()
