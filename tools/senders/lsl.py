#!/usr/bin/env python3
"""Sends the eyes of a Lab Streaming Layer stream to eyebox (pip install pylsl).

It reads Pupil Capture's plugin, Neon's app, TittaLSL (Tobii Pro) and App-EyeLink. It finds the channels by label, type
and eye. The program follows the code and the documents of these senders and is not yet tested on their trackers. Run
lsl.py --simulate to test the connection without a stream.
"""

import math, sys, time
from lsl_channels import Unusable, layout
from place import Eyes, add_arguments, numbers
from sender import Age, Sender, arguments, simulate

# Streams may answer a search late, so the search continues for this time after the first answer, seconds.
MORE_S = 1.0
# The offset between the clocks drifts, so it is requested again after this time, seconds.
CORRECT_S = 5.0
# Longest wait for one answer of a stream, seconds.
ANSWER_S = 5.0
# A note is printed if no eye is seen in this number of samples.
UNSEEN = 500


def note(text):
    """Prints a note."""
    print(f"lsl: {text}", file=sys.stderr)


def add(parser):
    """Adds the arguments of this sender."""
    parser.add_argument("--stream", metavar="NAME", help="name or source ID of the stream [default: the usable one]")
    parser.add_argument("--wait", type=float, default=10, metavar="S", help="longest search for streams [default: 10]")
    about = "pixel of the screen straight ahead of the eye, for streams with pixels"
    parser.add_argument("--straight", type=lambda text: numbers(text, 2), metavar="X,Y", help=about)
    add_arguments(parser)


def search(lsl, name, wait):
    """Returns the gaze streams in the network, or those with a name or source ID."""
    quote = "'" if '"' in (name or "") else '"'
    wanted = " or ".join(f"{key}={quote}{name}{quote}" for key in ("name", "source_id")) if name else "type='Gaze'"
    found = lsl.resolve_bypred(wanted, 1, wait)
    # The first answer ends the search, so a second one collects the others.
    return lsl.resolve_bypred(wanted, 99, min(MORE_S, wait)) if found else []


def choose(lsl, args, eyes):
    """Opens the one usable stream. Returns its inlet and its layout.

    Raises Unusable if there is none, or if there are several.
    """
    usable, reasons = [], []
    for info in search(lsl, args.stream, args.wait):
        inlet = lsl.StreamInlet(info, max_buflen=1)
        try:
            usable.append((inlet, layout(inlet.info(ANSWER_S).as_xml(), eyes, args.straight)))
        except Unusable as reason:
            reasons.append(f"stream '{info.name()}': {reason}")
        except (RuntimeError, OSError) as error:
            reasons.append(f"stream '{info.name()}' does not answer ({error})")
    if len(usable) > 1:
        names = ", ".join(f"'{inlet.info(ANSWER_S).name()}'" for inlet, _ in usable)
        raise Unusable(f"{len(usable)} streams are usable ({names}): choose one with --stream")
    if not usable and not reasons:
        wanted = f"called '{args.stream}'" if args.stream else "of type Gaze"
        raise Unusable(f"no stream {wanted} was found within {args.wait:g} s")
    if not usable:
        raise Unusable(". ".join(reasons))
    return usable[0]


class Clock:
    """Moves the times of a stream to the clock of this computer, by LSL's estimate of the offset."""

    def __init__(self, inlet, now=time.monotonic):
        self.inlet, self.now, self.offset, self.next = inlet, now, 0.0, -math.inf

    def time(self, stamp):
        """Returns the time of a sample on the clock of this computer, seconds."""
        if self.now() >= self.next:
            try:
                self.offset = self.inlet.time_correction(ANSWER_S)
            except RuntimeError:
                # The last offset stays, because a stream that pauses answers later.
                pass
            self.next = self.now() + CORRECT_S
        return stamp + self.offset


def samples(inlet, found):
    """Yields the samples of a stream for eyebox, without end. A stream that stops and returns is continued."""
    clock, unseen = Clock(inlet), 0
    while True:
        values, stamp = inlet.pull_sample(timeout=1.0)
        eyes = {side: eye for side, eye in found.sample(values).items() if eye} if values else {}
        if not eyes:
            continue
        sure = found.channels.one(values, "confidence")
        if sure is not None:
            for eye in eyes.values():
                eye["confidence"] = sure
        unseen = 0 if any(eye["valid"] for eye in eyes.values()) else unseen + 1
        if unseen == UNSEEN:
            note(f"no eye is seen in {UNSEEN} samples: its channels are NaN or not valid")
        yield {"t": clock.time(stamp), "t_unit": "s", **eyes}


def main():
    args = arguments(__doc__, add)
    sender = Sender(args)
    if args.simulate:
        return simulate(sender.send)
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:
        # pylsl raises RuntimeError if it has no liblsl.
        raise SystemExit(f"lsl: pylsl is missing (pip install pylsl): {str(error).splitlines()[0]}")
    eyes, age = Eyes(args), Age("lsl")
    try:
        inlet, found = choose(pylsl, args, eyes)
    except Unusable as reason:
        raise SystemExit(f"lsl: {reason}")
    for sample in samples(inlet, found):
        age.add(pylsl.local_clock() - sample["t"])
        if not sender.send(sample):
            return


if __name__ == "__main__":
    main()
