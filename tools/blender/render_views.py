"""Renders the views of a Blender scene for a display, as a folder that eyebox reads.

    blender -b scene.blend -P tools/blender/render_views.py -- --display bench.toml --size 512x512 -o views
    python tools/blender/render_views.py scene.blend --display bench.toml --size 512x512 -o views
    eyebox solve views --display bench.toml --size 512x512 -o scene.zarr

The second command needs Blender's Python package (pip install bpy). The script writes view_ROW_COLUMN.png and
lightfield.toml with the pitch of the views, their disparities and their depths. The scene's own camera is in the middle
of the views and keeps its angle.

Between neighboring views, content at the distance L moves by k b (1/L - 1/L0) pixels. Here k is the camera's focal
length in pixels, b is the distance of the views in the scene, and L0 is the distance of content that does not move. The
script chooses b and L0 for the requested depths of the nearest and the farthest content (--depth-mm, z = d f p / c, see
OPTICS 3).
"""

import argparse
import math
import os
import sys
import tomllib

import bpy
from mathutils import Vector

# The number of rays along each axis of the picture that measure the distances of the scene.
RAYS = 64
# Content that at most this share of the rays hits is neither the nearest nor the farthest.
RARE = 0.01


def arguments():
    """Reads the command line, after Blender's own arguments if there are any."""
    words = sys.argv[1:]
    if "--" in words:
        words = words[words.index("--") + 1 :]
    elif bpy.app.binary_path:
        words = []
    parser = argparse.ArgumentParser(prog="render_views.py", description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", help="a .blend file [default: the open scene]")
    parser.add_argument("-o", "--out", required=True, help="output folder, created if it does not exist")
    parser.add_argument("--display", required=True, metavar="FILE.toml", help="display file of eyebox display new")
    parser.add_argument("--size", metavar="HxW", help="pixels [default: the display's resolution]")
    parser.add_argument("--views", type=int, default=9, metavar="N", help="views per axis [default: 9]")
    parser.add_argument("--depth-mm", type=float, nargs=2, metavar=("FAR", "NEAR"), help="depths of the farthest and the "
                        "nearest content, mm [default: content that moves by -1 and 1 pixels from view to view]")
    parser.add_argument("--distance", type=float, nargs=2, metavar=("FAR", "NEAR"),
                        help="distances from the camera in the scene's units [default: measured by rays]")
    parser.add_argument("--samples", type=int, default=64, help="samples per pixel by Cycles [default: 64]")
    return parser.parse_args(words)


def fail(reason):
    """Ends the program with one line."""
    sys.exit(f"render_views.py: {reason}")


def wanted(args):
    """Returns rows and columns, and in meters the display's pitch, focal length and pitch of the views."""
    try:
        with open(args.display, "rb") as file:
            display = tomllib.load(file)
        rows, columns = display["resolution"]
        pitch, focal = display["pitch_um"] * 1e-6, display["focal_length_mm"] * 1e-3
        shortest = min(display["wavelengths_nm"].values()) * 1e-9
    except (OSError, tomllib.TOMLDecodeError) as error:
        fail(f"{args.display}: {error}")
    except (KeyError, TypeError, ValueError) as error:
        fail(f"{args.display}: {error} is missing or wrong. Use eyebox display new paper -o {args.display}.")
    if args.size:
        try:
            rows, columns = (int(n) for n in args.size.lower().split("x"))
        except ValueError:
            fail(f"--size {args.size}: expected rows x columns, such as 512x512")
    if not 2 <= args.views <= 64:
        fail(f"--views {args.views}: expected 2 to 64")
    if display.get("geometry", "relay") == "far-field":
        # The picture is a square, and the eyebox is the smaller side of the SLM.
        side = max(rows, columns)
        eyebox = min(rows, columns) * pitch
        return side, side, shortest * focal / (pitch * side), focal, eyebox / args.views
    return rows, columns, pitch, focal, shortest * focal / pitch / args.views


def distances(scene, camera):
    """Measures the farthest and the nearest distance along the camera's axis, with rays through the picture."""
    graph = bpy.context.evaluated_depsgraph_get()
    frame = [camera.matrix_world @ corner for corner in camera.data.view_frame(scene=scene)]
    top_right, bottom_right, bottom_left, top_left = frame
    eye = camera.matrix_world.translation
    ahead = camera.matrix_world.to_quaternion() @ Vector((0.0, 0.0, -1.0))
    found = []
    for i in range(RAYS):
        for j in range(RAYS):
            across, down = (j + 0.5) / RAYS, (i + 0.5) / RAYS
            above = top_left.lerp(top_right, across)
            below = bottom_left.lerp(bottom_right, across)
            toward = (above.lerp(below, down) - eye).normalized()
            hit, place, *_ = scene.ray_cast(graph, eye, toward)
            if hit:
                found.append((place - eye).dot(ahead))
    if len(found) < 2:
        fail("rays from the camera hit no content. Give --distance FAR NEAR.")
    found.sort()
    rare = int(RARE * len(found))
    return found[-1 - rare], found[rare]


def baseline(k, disparity, distance):
    """Returns the distance of neighboring views in the scene, and 1 / L0 of content that does not move."""
    (far, near), (d_far, d_near) = distance, disparity
    if not (0.0 < near and math.isfinite(far) and d_near > d_far):
        fail(f"distances {far} to {near}, motion {d_far} to {d_near} pixels, but near must be nearer and move more")
    if far - near < 1e-6 * far:
        # Content at a single distance does not move.
        return (d_near - d_far) / k * far * 0.1, 1.0 / far
    b = (d_near - d_far) / (k * (1.0 / near - 1.0 / far))
    return b, 1.0 / far - d_far / (k * b)


def main():
    """Renders all views and writes lightfield.toml."""
    args = arguments()
    rows, columns, pitch, focal, cell = wanted(args)
    if args.scene:
        if not os.path.isfile(args.scene):
            fail(f"{args.scene}: no such file")
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(args.scene))
    scene = bpy.context.scene
    camera = scene.camera
    if camera is None or camera.data.type != "PERSP":
        fail("the scene needs a camera with perspective")
    render = scene.render
    render.engine, scene.cycles.samples = "CYCLES", args.samples
    render.resolution_x, render.resolution_y, render.resolution_percentage = columns, rows, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    # A view is a pinhole image, because the hologram makes the blur of the pupil.
    camera.data.dof.use_dof = False
    scene.view_settings.view_transform = "Standard"
    image = render.image_settings
    image.file_format, image.color_mode, image.color_depth = "PNG", "RGB", "16"

    # The angle belongs to the picture's longer side, or to the side that the camera's fit names.
    fit = camera.data.sensor_fit
    vertical = fit == "VERTICAL" or (fit == "AUTO" and rows > columns)
    side = rows if vertical else columns
    angle = camera.data.angle_y if fit == "VERTICAL" else camera.data.angle_x if fit == "HORIZONTAL" else camera.data.angle
    k = 0.5 * side / math.tan(0.5 * angle)
    per_pixel = focal * pitch / cell
    depth = [mm * 1e-3 for mm in args.depth_mm] if args.depth_mm else [-per_pixel, per_pixel]
    disparity = [z / per_pixel for z in depth]
    far, near = args.distance or distances(scene, camera)
    b, convergence = baseline(k, disparity, (far, near))

    os.makedirs(args.out, exist_ok=True)
    place, turn = camera.matrix_world.translation.copy(), camera.matrix_world.to_quaternion()
    right, down = turn @ Vector((1.0, 0.0, 0.0)), turn @ Vector((0.0, -1.0, 0.0))
    own_shift = camera.data.shift_x, camera.data.shift_y
    world = camera.matrix_world.copy()
    # Constraints and animation of the scene would move the camera back.
    camera.constraints.clear()
    camera.animation_data_clear()
    for row in range(args.views):
        for column in range(args.views):
            x, y = (b * (i - 0.5 * (args.views - 1)) for i in (column, row))
            moved = world.copy()
            moved.translation = place + x * right + y * down
            camera.matrix_world = moved
            # Shifts are shares of the side of the angle. Content at L0 does not move.
            camera.data.shift_x = own_shift[0] - x * convergence * k / side
            camera.data.shift_y = own_shift[1] + y * convergence * k / side
            render.filepath = os.path.abspath(os.path.join(args.out, f"view_{row:02}_{column:02}.png"))
            bpy.ops.render.render(write_still=True)
            print(f"view {row * args.views + column + 1} of {args.views**2}", flush=True)
    with open(os.path.join(args.out, "lightfield.toml"), "w", encoding="utf-8") as file:
        file.write(f"# {os.path.basename(args.scene or 'scene')}, by Blender {bpy.app.version_string}\n")
        file.write(f"grid = [{args.views}, {args.views}]\nfiles = \"view_*\"\nview_pitch_mm = {cell * 1e3:.9g}\n")
        file.write(f"disparity = [{disparity[0]:.6g}, {disparity[1]:.6g}]\n")
        file.write(f"depth_mm = [{depth[0] * 1e3:.6g}, {depth[1] * 1e3:.6g}]\ntransfer = \"srgb\"\n")
    print(f"wrote {args.out}: {args.views} x {args.views} views of {rows} x {columns} pixels, {b:.4g} apart in the scene, "
          f"from {far:.4g} to {near:.4g} away")


main()
