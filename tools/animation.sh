#!/usr/bin/env bash
# Makes docs/steered.gif: what an eye sees of a hologram while it is refined for it, through two pupils. All that is seen comes from
# the command; python3 with Pillow puts the pictures together. EYEBOX is the command: EYEBOX=target/release/eyebox tools/animation.sh
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=$(realpath "${EYEBOX:?the command to run, such as target/release/eyebox}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

"$eyebox" solve builtin:still-life --size 512x512 --seconds 60 -o still-life.zarr
for pupil in -6,3,4,2 6,-3,4,-2.5; do
    from=still-life.zarr
    "$eyebox" view $from --pupil=$pupil -o "$pupil.0.png"
    done=0
    for steps in 1 1 2 4 8; do
        done=$((done + steps))
        "$eyebox" refine $from builtin:still-life --pupil=$pupil --steps $steps -o "$pupil.$done.zarr"
        from=$pupil.$done.zarr
        "$eyebox" view "$from" --pupil=$pupil -o "$pupil.$done.png"
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
