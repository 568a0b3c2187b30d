#!/usr/bin/env bash
# Makes the README's animations. docs/steered.gif: what an eye sees of a hologram while it is refined for it, through two pupils.
# docs/live.gif: the window of `eyebox show --view`, on Xvfb, while fruit moves and a recorded eye looks about.
# docs/walk.gif: the same window, while the camera moves in front of the built-in splats. All that is seen comes from the command;
# python3 with Pillow puts the pictures together. EYEBOX is the command: EYEBOX=target/release/eyebox tools/animation.sh [steered|live|walk]
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=$(realpath "${EYEBOX:?the command to run, such as target/release/eyebox}")
work=$(mktemp -d)
desktop=
trap '[[ -z $desktop ]] || kill "$desktop"; rm -rf "$work"' EXIT
cd "$work"

steered() {
"$eyebox" solve builtin:still-life --size 512x512 --duration 60 -o still-life.zarr
for pupil in -6,3,4,2 6,-3,4,-2.5; do
    from=still-life.zarr
    "$eyebox" render $from --pupil=$pupil -o "$pupil.0.png"
    done=0
    for steps in 1 1 2 4 8; do
        done=$((done + steps))
        "$eyebox" refine $from builtin:still-life --pupil=$pupil --steps $steps -o "$pupil.$done.zarr"
        from=$pupil.$done.zarr
        "$eyebox" render "$from" --pupil=$pupil -o "$pupil.$done.png"
    done
done

python3 - "$root/docs/steered.gif" <<'PYTHON'
import sys
from PIL import Image, ImageDraw, ImageFont

pictures, times = [], []
for pupil, about in [("-6,3,4,2", "6 mm left, near"), ("6,-3,4,-2.5", "6 mm right, far")]:
    for steps in [0, 1, 2, 4, 16]:
        picture = Image.open(f"{pupil}.{steps}.png").convert("RGB").resize((352, 352), Image.LANCZOS)
        says = "not steered" if steps == 0 else f"{steps} step{'s' if steps > 1 else ''}"
        draw = ImageDraw.Draw(picture)
        draw.rectangle((0, 330, 352, 352), fill=(16, 18, 20))
        draw.text((8, 333), f"{about}: {says}", fill=(235, 235, 230), font=ImageFont.load_default(14))
        pictures.append(picture)
        times.append(1600 if steps in (0, 16) else 500)
# One palette for all, so that no colour changes from frame to frame.
both = Image.new("RGB", (704, 352))
both.paste(pictures[4], (0, 0))
both.paste(pictures[9], (352, 0))
palette = both.quantize(80)
frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
frames[0].save(sys.argv[1], save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)
PYTHON
}

live() {
# Fruit that goes from the left to the right and back, sixteen holograms; and three fixations of two seconds, near and far in turn.
there=()
for i in {0..8}; do there+=("builtin:still-life?shift=$(python3 -c "print(round(-0.3 + 0.075 * $i, 3))")"); done
back=("${there[7]}" "${there[6]}" "${there[5]}" "${there[4]}" "${there[3]}" "${there[2]}" "${there[1]}")
"$eyebox" solve "${there[@]}" "${back[@]}" --size 256x256 --steps 40 --rate 8 -o moving.zarr
python3 - >eye.jsonl <<'PYTHON'
import json
for i in range(12 * 120):
    x, y, focus_d = [(-4, 2, 0.012), (4, -3, -0.012), (0, 0, 0)][i // 240 % 3]
    print(json.dumps({"t": i / 120, "x": x, "y": y, "diameter": 4, "focus_d": focus_d}))
PYTHON
film "$root/docs/live.gif" 0 show moving.zarr --loop --display planes24 --tracker eye.jsonl --view --duration 14
}

# One round of eight seconds, after the first one, for an eye that looks about.
walk() {
python3 - >eye.jsonl <<'PYTHON'
import json
for i in range(40 * 120):
    x, y, focus_d = [(-3, 1, 0.01), (3, -1, -0.01)][i // 480 % 2]
    print(json.dumps({"t": i / 120, "x": x, "y": y, "diameter": 5, "focus_d": focus_d}))
PYTHON
film "$root/docs/walk.gif" 8 show builtin:still-life-splats --walk around --walk-time 8 --size 256x256 --display planes24 \
    --tracker eye.jsonl --view --duration 24
}

# Films the window of a command for eight pictures a second: film GIF SECONDS COMMAND, where SECONDS pass first
film() {
local gif=$1 before=$2
shift 2
mkdir screen
Xvfb -displayfd 3 -screen 0 512x512x24 -nocursor -fbdir screen 3>number 2>/dev/null &
desktop=$!
while [[ ! -s number ]]; do sleep 0.1; done
WAYLAND_DISPLAY='' DISPLAY=:$(cat number) "$eyebox" "$@" &
local shows=$!
python3 - "$gif" "$before" <<'PYTHON'
import struct, sys, time
from PIL import Image

def screen():
    """What is on the screen: a dump of the X server's, as `xwd` has it."""
    dump = open("screen/Xvfb_screen0", "rb").read()
    head = struct.unpack(">25I", dump[:100])
    (size, width, height, stride), colors = (head[0], head[4], head[5], head[12]), head[19]
    return Image.frombytes("RGB", (width, height), dump[size + 12 * colors :], "raw", "BGRX", stride)

until = time.monotonic() + 120
while screen().getbbox() is None:  # The window comes when the scene is there.
    assert time.monotonic() < until, "no window"
    time.sleep(0.05)
time.sleep(float(sys.argv[2]))
every, seen = 0.125, []
begun = time.monotonic()
while len(seen) < 48 + 2 * int(sys.argv[2]):
    seen.append(screen().resize((320, 320), Image.LANCZOS))
    time.sleep(max(0, begun + len(seen) * every - time.monotonic()))
# One palette for all, so that no colour changes from frame to frame.
sheet = Image.new("RGB", (3 * 320, 320))
for i in range(3):
    sheet.paste(seen[16 * i + 12], (320 * i, 0))
palette = sheet.quantize(112, kmeans=2)
frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in seen]
frames[0].save(sys.argv[1], save_all=True, append_images=frames[1:], duration=int(1000 * every), loop=0, optimize=True)
PYTHON
wait "$shows"
kill "$desktop"
desktop=
rm -r screen number
}

case ${1:-all} in
    all) steered; live; walk ;;
    steered | live | walk) "$1" ;;
    *) echo "tools/animation.sh [steered|live|walk]" >&2; exit 1 ;;
esac
