#!/usr/bin/env bash
# Makes docs/calibrated.png: what an eye sees on the bench of docs/bench.toml of a hologram that knows nothing of the bench, of one that
# knows its model, and what it would see on a perfect display, with their PSNRs. All that is seen comes from the command; python3
# with Pillow puts the pictures together. EYEBOX is the command: EYEBOX=target/release/eyebox tools/calibrated.sh
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
eyebox=$(realpath "${EYEBOX:?the command to run, such as target/release/eyebox}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cp "$root/docs/bench.toml" bench.toml
sed '/^\[model/,$d' bench.toml >ideal.toml
scene=builtin:still-life
pupil=--pupil=5,3,6,0

"$eyebox" solve $scene --display ideal.toml -o ideal.zarr
"$eyebox" solve $scene --display bench.toml -o calibrated.zarr
# The hologram for the ideal display, on the bench.
"$eyebox" convert ideal.zarr ideal.npy
"$eyebox" convert ideal.npy unaware.zarr --display bench.toml --scene $scene
for name in unaware calibrated ideal; do
    "$eyebox" render $name.zarr $pupil -o $name.png
    "$eyebox" eval score $name.zarr $scene --test-pupils random:24 --json >$name.json
done

python3 - "$root/docs/calibrated.png" <<'PYTHON'
import json, sys
from PIL import Image, ImageDraw, ImageFont

side, line, gap = 288, 22, 4
sheet = Image.new("RGB", (3 * side + 2 * gap, side + line), (16, 18, 20))
draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
for i, (name, about) in enumerate([("unaware", "not calibrated"), ("calibrated", "calibrated"), ("ideal", "a perfect display")]):
    psnr = json.load(open(f"{name}.json"))["psnr_db"]
    sheet.paste(Image.open(f"{name}.png").convert("RGB").resize((side, side), Image.LANCZOS), (i * (side + gap), 0))
    says = f"{about}: {psnr['mean']:.1f} dB, worst {psnr['worst']:.1f}"
    draw.text((i * (side + gap) + 6, side + 3), says, fill=(235, 235, 230), font=font)
    print(says)
sheet.quantize(256, kmeans=2, dither=Image.Dither.NONE).save(sys.argv[1], optimize=True)
PYTHON
