"""Serves as the command of a camera for a calibration whose camera is a function of another process.

It passes lines on in both directions. It does not import the package, so it starts at once.
"""

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
