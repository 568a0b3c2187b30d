"""Measures the number of workers that a far field can use.

The script begins a solve in regions, takes the graph of its visits, and simulates them on 1 to 1,000 workers. Each
visit takes one unit of time. The first free worker takes the first visit that may begin.

    python3 tools/python/measure/far_field_graph.py [DISPLAY] [SIDE] [PASSES] [PUPIL_MM]
"""

import heapq
import os
import sys
import tempfile

import eyebox
from eyebox import _arguments, _eyebox
from eyebox._display import engine_of


def units(after, workers):
    """Returns the units of time that all visits take on ``workers`` workers."""
    waiting = [len(before) for before in after]
    then = [[] for _ in after]
    for visit, before in enumerate(after):
        for one in before:
            then[one].append(visit)
    ready = [visit for visit, count in enumerate(waiting) if count == 0]
    heapq.heapify(ready)
    time, done = 0, 0
    while done < len(after):
        now = [heapq.heappop(ready) for _ in range(min(workers, len(ready)))]
        time, done = time + 1, done + len(now)
        for visit in now:
            for one in then[visit]:
                waiting[one] -= 1
                if waiting[one] == 0:
                    heapq.heappush(ready, one)
    return time


def main():
    name, side, passes, pupil = (sys.argv[1:] + ["far-field-16k", "0", "3", "4"][len(sys.argv) - 1 :])[:4]
    side, most = int(side), float(pupil) * 1e-3
    display = eyebox.Display(name, size=(side, side)) if side else eyebox.Display(name)
    settings = _arguments.toml(dict(frames=1, steps=1, diameter=(most / 4, most)))
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "far.zarr")
        native = _eyebox.Display.of_toml(display.to_toml())
        field = _eyebox.FarField("builtin:plane", native, ["green"], settings, (int(passes), 4 << 30, 64), out)
        _, after, longest = field.begin(engine_of("cpu"))
    rows, columns = display.resolution
    print(f"{rows} x {columns}, pupils to {pupil} mm, {passes} passes: {len(after)} visits, {longest} in the longest chain")
    for workers in (1, 2, 10, 100, 1000):
        took = units(after, workers)
        print(f"{workers:5} workers: {len(after) / took:6.1f} times as fast as one, {100 * len(after) / took / workers:3.0f} % busy")


if __name__ == "__main__":
    main()
