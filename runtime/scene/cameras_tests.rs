//! Tests views of cameras at any positions. They are rendered exactly, written in the usual ways, and read correctly or
//! refused with a remedy that works.

use crate::*;
use eyebox_base::files::write_png;
use eyebox_optics::{Color, Display};
use std::f32::consts::TAU;
use std::fs;
use std::path::Path;

const GREEN: [Color; 1] = [Color::Green];

/// Two textured surfaces, which are a wall, and a disc with a bar in front of it.
pub(super) struct World {
    waves: [Vec<[f32; 4]>; 2],
    /// Pixels by which wall and disc move from camera to camera.
    disparity: [f32; 2],
    size: [usize; 2],
}

impl World {
    pub(super) fn new(seed: u64, size: [usize; 2], disparity: [f32; 2]) -> Self {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut wave = || {
            let (turn, length) = (TAU * random.f32(), 5.0 + 11.0 * random.f32());
            [TAU / length * turn.cos(), TAU / length * turn.sin(), TAU * random.f32(), 0.0]
        };
        let mut waves = || (0..16).map(|_| wave()).collect();
        Self { waves: [waves(), waves()], disparity, size }
    }

    /// Returns the linear light of a camera that is these steps to the right and down.
    pub(super) fn view(&self, [right, down]: [f32; 2]) -> Vec<f32> {
        let [height, width] = self.size;
        let (h, w) = (height as f32, width as f32);
        let texture = |layer: usize, x: f32, y: f32| {
            let sum: f32 = self.waves[layer].iter().map(|[a, b, c, _]| (a * x + b * y + c).sin()).sum();
            let root = (0.5 + 0.09 * sum).clamp(0.1, 0.95);
            root * root
        };
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let at = |layer: usize| (x + self.disparity[layer] * right, y + self.disparity[layer] * down);
            let ((u, v), (far_x, far_y)) = (at(1), at(0));
            let disc = 0.26 * h - (u - 0.36 * w).hypot(v - 0.45 * h);
            let bar = (0.13 * w - (u - 0.74 * w).abs()).min(0.15 * h - (v - 0.68 * h).abs());
            let share = (disc.max(bar) + 0.5).clamp(0.0, 1.0);
            share * texture(1, u, v) + (1.0 - share) * texture(0, far_x, far_y)
        };
        (0..height * width).map(pixel).collect()
    }
}

fn display([height, width]: [usize; 2]) -> Display {
    Display { height, width, ..Display::preset("small").unwrap() }
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let error = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64;
    -10.0 * error.max(1e-12).log10()
}

fn write(folder: &Path, name: &str, size: [usize; 2], view: &[f32]) {
    write_png(&folder.join(name), size[0], size[1], &[view]).unwrap();
}

fn state(folder: &Path, toml: &str) {
    fs::write(folder.join("lightfield.toml"), toml).unwrap();
}

fn refusal(source: &Path, display: &Display) -> SceneError {
    let source = source.to_str().unwrap();
    let request = Request::new(display, &GREEN);
    let error = load(source, &request).map(|field| field.grid).expect_err(source);
    let (found, _) = inspect(source, &request).unwrap();
    assert_eq!(found.doubt, Some(error.to_string()), "inspect and load decide alike");
    // Stated depths do not correct a wrong arrangement.
    let asked = Request { depth: Some([-1e-3, 1e-3]), ..request };
    assert!(matches!(load(source, &asked), Err(SceneError::Cameras { .. })), "{source}");
    error
}

/// Makes one row of cameras in tiles, with remaining lines as quilts have them.
fn quilt(world: &World, tiles: Tiles, left: [usize; 2]) -> ([usize; 2], Vec<f32>, Vec<Vec<f32>>) {
    let ([rows, columns], [h, w]) = (tiles.grid, world.size);
    let count = rows * columns;
    let views: Vec<Vec<f32>> = (0..count).map(|k| world.view([k as f32 - (count as f32 - 1.0) / 2.0, 0.0])).collect();
    let [high, wide] = [rows * h + left[0], columns * w + left[1]];
    let mut whole = vec![0.0; high * wide];
    for (view, tile) in views.iter().zip(tiles.order()) {
        let (top, side) = (left[0] + tile / columns * h, tile % columns * w);
        for (y, line) in view.chunks_exact(w).enumerate() {
            whole[(top + y) * wide + side..][..w].copy_from_slice(line);
        }
    }
    ([high, wide], whole, views)
}

/// Columns and rows of tiles, rows and columns of pixels of a view, the aspect in the name, remaining lines, and
/// disparities.
type Quilted = ([usize; 2], [usize; 2], &'static str, [usize; 2], [f32; 2]);

const QUILTS: [Quilted; 12] = [
    ([8, 6], [54, 40], "a0.75", [0, 0], [-0.12, 0.15]),
    ([8, 6], [80, 60], "a0.75", [0, 0], [-0.2, 0.25]),
    ([5, 9], [54, 96], "a1.777", [1, 2], [-0.2, 0.2]),
    ([4, 8], [60, 80], "a1.333", [0, 0], [-0.3, 0.1]),
    ([11, 6], [64, 36], "a0.5625", [4, 2], [-0.1, 0.1]),
    ([7, 7], [48, 64], "a1.3333", [0, 0], [0.05, 0.3]),
    ([6, 3], [64, 64], "a1", [0, 0], [-0.5, 0.6]),
    ([3, 2], [64, 80], "a1.25", [1, 1], [-1.2, 0.9]),
    ([12, 1], [64, 64], "a1.0", [0, 0], [-0.5, 0.5]),
    ([1, 9], [64, 64], "a1", [0, 0], [-0.8, 0.4]),
    ([8, 6], [48, 64], "a1.333_v2", [0, 3], [-0.15, 0.1]),
    ([4, 4], [72, 54], "a.75", [0, 0], [-0.4, 0.5]),
];

#[test]
fn quilts_are_one_row_of_cameras_by_their_names() {
    for (i, (grid, size, aspect, left, disparity)) in QUILTS.into_iter().enumerate() {
        let [columns, rows] = grid;
        let tiles = Tiles { grid: [rows, columns], first: FirstTile::BottomLeft, serpentine: false };
        let world = World::new(i as u64, size, disparity);
        let ([high, wide], whole, views) = quilt(&world, tiles, left);
        let temp = tempfile::tempdir().unwrap();
        let name = format!("scene_qs{columns}x{rows}{aspect}.png");
        write(temp.path(), &name, [high, wide], &whole);
        let (display, path) = (display(size), temp.path().join(&name));
        let request = Request::new(&display, &GREEN);
        for source in [path.display().to_string(), format!("{}?mosaic", path.display())] {
            let field = load(&source, &request).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(field.grid, [1, rows * columns], "{name}");
            for k in [0, views.len() / 2, views.len() - 1] {
                let like = psnr(&field.planes[0][k], &views[k]);
                assert!(like > 40.0, "{name}: view {k} is like its camera's to {like:.1} dB");
            }
        }
        let (found, _) = inspect(path.to_str().unwrap(), &request).unwrap();
        let ([low, high], off) = (found.disparity_px, 0.15f64);
        let right = (low - f64::from(disparity[0])).abs() < off && (high - f64::from(disparity[1])).abs() < off;
        assert!(right || found.doubt.is_some(), "{name}: {low} to {high}, {disparity:?}");
    }
}

/// The same pictures have names without any statement.
#[test]
fn tiles_of_one_row_are_no_grid_of_cameras_and_the_remedy_works() {
    use FirstTile::{BottomLeft, BottomRight, TopLeft, TopRight};
    let cases = [
        ([6, 8], BottomLeft, false, [-0.12, 0.15]),
        ([6, 8], TopLeft, false, [-0.1, 0.1]),
        ([6, 8], TopRight, false, [-0.12, 0.12]),
        ([6, 8], BottomRight, false, [-0.15, 0.12]),
        ([3, 6], BottomLeft, false, [-0.4, 0.5]),
        ([4, 4], TopLeft, false, [-0.6, 0.4]),
        ([4, 6], BottomLeft, true, [-0.3, 0.3]),
        ([5, 4], TopLeft, true, [-0.3, 0.4]),
        ([4, 6], TopLeft, true, [-0.2, 0.3]),
        ([6, 8], BottomRight, true, [-0.1, 0.15]),
        ([5, 5], TopRight, true, [-0.3, 0.2]),
        ([3, 6], BottomRight, true, [-0.4, 0.3]),
        ([6, 5], TopRight, true, [0.1, 0.3]),
        ([7, 7], BottomLeft, false, [0.05, 0.2]),
        ([3, 5], TopLeft, false, [-0.5, 0.5]),
    ];
    for (i, (grid, first, serpentine, disparity)) in cases.into_iter().enumerate() {
        let (size, tiles) = ([64, 80], Tiles { grid, first, serpentine });
        let world = World::new(100 + i as u64, size, disparity);
        let ([high, wide], whole, views) = quilt(&world, tiles, [0, 0]);
        let temp = tempfile::tempdir().unwrap();
        write(temp.path(), "scene.png", [high, wide], &whole);
        let display = display(size);
        let source = temp.path().join(format!("scene.png?grid={}x{}", grid[0], grid[1]));
        let error = refusal(&source, &display);
        let SceneError::Cameras { found: CamerasFound::RowInTiles(found), .. } = error else {
            panic!("{tiles}: {error}")
        };
        // A row from right to left is the same row with near and far exchanged.
        let reversed = found.order() != tiles.order();
        assert!(!reversed || found.order().into_iter().rev().eq(tiles.order()), "{tiles}: {found}");
        let lines: String = found.keys().replace("`, `", "\n").replace('`', "");
        state(temp.path(), &lines);
        let source = temp.path().join("scene.png?mosaic");
        let read = load(source.to_str().unwrap(), &Request::new(&display, &GREEN));
        let field = match (read, reversed) {
            (Ok(field), false) => field,
            // Too little moves for that, so the row is read from left to right.
            (Ok(field), true) => {
                assert!(psnr(&field.planes[0][0], &views[views.len() - 1]) > 40.0, "{tiles}");
                continue;
            }
            // Occlusion shows the order, and that remedy works too.
            (Err(SceneError::Order { keys, .. }), true) => {
                let keys = keys.unwrap().split("` and `").map(|k| k.trim_matches('`')).collect::<Vec<_>>().join("\n");
                state(temp.path(), &format!("{lines}\n{keys}\n"));
                load(source.to_str().unwrap(), &Request::new(&display, &GREEN)).unwrap()
            }
            (read, _) => panic!("{tiles}: {:?}", read.map(|f| f.grid)),
        };
        assert_eq!(field.grid, [1, grid[0] * grid[1]]);
        assert!(psnr(&field.planes[0][0], &views[0]) > 40.0, "{tiles}");
    }
}

/// Positions (mm) of cameras, written to a folder with names without any statement, and the true view from any
/// position.
struct Anywhere {
    world: World,
    /// Millimeters per step of the disparities.
    step: f64,
    positions: Vec<[f64; 2]>,
}

impl Anywhere {
    fn true_view(&self, [x, y]: [f64; 2]) -> Vec<f32> {
        self.world.view([x / self.step, y / self.step].map(|v| v as f32))
    }

    fn write(&self, folder: &Path, name: impl Fn(usize) -> String) {
        for (i, at) in self.positions.iter().enumerate() {
            write(folder, &name(i), self.world.size, &self.true_view(*at));
        }
    }

    /// Reads the folder. Depths must be within a tenth, and views must be like the true ones.
    fn is_read(&self, folder: &Path, display: &Display, least: f64) {
        let request = Request::new(display, &GREEN);
        let field = load(folder.to_str().unwrap(), &request).unwrap_or_else(|e| panic!("{e}"));
        let per_step = display.focal_length * display.picture_pixel() / (self.step * 1e-3);
        let truth = self.world.disparity.map(|d| f64::from(d) * per_step);
        let ([far, near], most) = (field.depth.unwrap(), 0.15 * (truth[1] - truth[0]));
        assert!((far - truth[0]).abs() < most && (near - truth[1]).abs() < most, "{far} {near}, not {truth:?}");
        let middle = [0, 1].map(|k| {
            let all = self.positions.iter().map(|p| p[k]);
            0.5 * (all.clone().fold(f64::INFINITY, f64::min) + all.fold(f64::NEG_INFINITY, f64::max))
        });
        let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell: field.cell(display) };
        let mut worst = f64::INFINITY;
        for (i, view) in field.planes[0].iter().enumerate() {
            let (x, y) = grid.position(i);
            worst = worst.min(psnr(view, &self.true_view([x * 1e3 + middle[0], y * 1e3 + middle[1]])));
        }
        println!(
            "{:?}: {:?} views, the worst {worst:.1} dB, depths {far:.2e} {near:.2e}",
            self.world.disparity, field.grid
        );
        assert!(worst > least, "{worst:.1} dB");
    }
}

#[test]
fn handheld_photographs_are_no_grid_until_their_positions_are_stated() {
    let size = [80, 96];
    let display = display(size);
    let eyebox = display.eyebox_min() * 1e3;
    let mut taken = Vec::new();
    for (seed, count) in [(1, 16), (2, 25), (3, 25), (4, 36), (5, 16), (6, 20), (7, 25), (8, 12), (9, 30), (10, 25)] {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut place = || [random.f64() - 0.5, random.f64() - 0.5].map(|v| 0.9 * eyebox * v);
        let positions: Vec<[f64; 2]> = (0..count).map(|_| place()).collect();
        let scene = Anywhere { world: World::new(seed, size, [-0.7, 0.9]), step: eyebox / 6.0, positions };
        let temp = tempfile::tempdir().unwrap();
        scene.write(temp.path(), |i| format!("IMG_{}.png", 4026 + i));
        let square = crate::read::names::square(count).is_some();
        if !square {
            let columns = if count % 5 == 0 { 5 } else { 4 };
            state(temp.path(), &format!("grid = [{}, {columns}]", count / columns));
        }
        let error = refusal(temp.path(), &display);
        let SceneError::Cameras { found, .. } = &error else { panic!("{count}: {error}") };
        assert!(matches!(found, CamerasFound::Elsewhere(_) | CamerasFound::Uneven { .. }), "{count}: {error}");
        state(temp.path(), &format!("positions_mm = {:?}", scene.positions));
        // Views between cameras take seconds, so four of ten cases compute them.
        if seed <= 4 {
            scene.is_read(temp.path(), &display, 20.0);
        }
        // Mirrored positions are contradicted if the cameras next to the middle one are far enough apart.
        let wrong: Vec<[f64; 2]> = scene.positions.iter().map(|[x, y]| [*x, -y]).collect();
        state(temp.path(), &format!("positions_mm = {wrong:?}"));
        match load(temp.path().to_str().unwrap(), &Request::new(&display, &GREEN)) {
            Ok(_) => taken.push(count),
            Err(SceneError::Cameras { found: CamerasFound::Misplaced(_), .. }) => {}
            Err(SceneError::Depth { .. } | SceneError::Order { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert!(taken.is_empty(), "mirrored positions are taken: {taken:?}");
}

#[test]
fn uneven_cameras_are_read_at_their_positions() {
    let size = [80, 96];
    let display = display(size);
    let eyebox = display.eyebox_min() * 1e3;
    let cases: [(&[f64], &[f64]); 10] = [
        (&[0.0, 10.0, 40.0, 45.0, 60.0], &[0.0, 15.0, 30.0]),
        (&[0.0, 10.0, 40.0, 45.0, 60.0], &[0.0]),
        (&[0.0, 5.0, 30.0, 35.0, 60.0], &[0.0, 5.0, 40.0]),
        (&[0.0, 7.0, 31.0], &[0.0, 11.0, 47.0]),
        (&[0.0, 20.0, 23.0, 60.0], &[0.0, 30.0, 60.0]),
        (&[1.0, 11.0, 41.0, 46.0, 61.0], &[5.0, 20.0, 35.0]),
        (&[0.0, 3.0, 10.0, 30.0, 47.0], &[0.0, 20.0]),
        (&[100.0, 110.0, 140.0, 145.0, 160.0], &[100.0, 115.0, 130.0]),
        (&[0.0, 1.0, 30.0, 41.0, 60.0, 61.0], &[0.0, 15.0, 30.0, 45.0]),
        (&[0.0, 31.0, 35.0, 60.0], &[0.0, 22.0, 25.0, 60.0]),
    ];
    let mut refused = Vec::new();
    for (i, (x, y)) in cases.into_iter().enumerate() {
        let unit = 0.9 * eyebox / 60.0;
        let positions: Vec<[f64; 2]> = y.iter().flat_map(|y| x.iter().map(move |x| [x * unit, y * unit])).collect();
        let middle = [0.5 * unit * (x[0] + x[x.len() - 1]), 0.5 * unit * (y[0] + y[y.len() - 1])];
        let positions: Vec<[f64; 2]> = positions.iter().map(|p| [p[0] - middle[0], p[1] - middle[1]]).collect();
        let scene =
            Anywhere { world: World::new(50 + i as u64, size, [-0.7, 0.9]), step: 15.0 * unit / 1.5, positions };
        let temp = tempfile::tempdir().unwrap();
        let name = |i: usize| format!("cam_y{}_x{}.png", y[i / x.len()], x[i % x.len()]);
        scene.write(temp.path(), name);
        let source = temp.path().to_str().unwrap();
        let error = load(source, &Request::new(&display, &GREEN)).unwrap_err();
        if y.len() > 1 {
            assert!(matches!(&error, SceneError::Uneven { x: at, .. } if at == x), "{x:?}: {error}");
        }
        // A stated even grid counts, unless the pictures contradict it.
        state(temp.path(), &format!("grid = [{}, {}]", y.len(), x.len()));
        match load(source, &Request::new(&display, &GREEN)) {
            Ok(field) => assert_eq!(field.grid, [y.len(), x.len()]),
            Err(SceneError::Cameras { found: CamerasFound::Uneven { .. }, .. }) => refused.push(i),
            Err(error) => panic!("{x:?}, stated: {error}"),
        }
        let scaled = |all: &[f64]| all.iter().map(|v| v * unit).collect::<Vec<_>>();
        state(temp.path(), &format!("positions_mm = {{ x = {:?}, y = {:?} }}", scaled(x), scaled(y)));
        if i % 2 == 0 {
            scene.is_read(temp.path(), &display, 20.0);
        }
    }
    println!("refused as even grids: {refused:?}");
    assert!(refused.len() >= 3, "the pictures contradict an even grid, but only {refused:?} are refused");
}

/// The cost of an inspection depends on the views and not on the display.
#[test]
fn small_views_are_inspected_at_their_own_size() {
    let world = World::new(9, [48, 64], [-0.7, 0.9]);
    let temp = tempfile::tempdir().unwrap();
    for i in 0..9 {
        write(
            temp.path(),
            &format!("v_{}_{}.png", i / 3, i % 3),
            world.size,
            &world.view([(i % 3) as f32 - 1.0, (i / 3) as f32 - 1.0]),
        );
    }
    let source = temp.path().to_str().unwrap();
    let [(own, field), (large, seen)] =
        [[48, 64], [480, 640]].map(|size| inspect(source, &Request::new(&display(size), &GREEN)).unwrap());
    assert_eq!(([field.height, field.width], [seen.height, seen.width]), ([48, 64], [48, 64]));
    assert_eq!((own.size, large.size), ([48, 64], [480, 640]));
    // The units are pixels of the display.
    for (a, b) in own.disparity_px.into_iter().zip(large.disparity_px) {
        assert!((10.0 * a - b).abs() < 1e-6, "{a} {b}");
    }
}

#[test]
fn a_constant_stride_is_a_stride() {
    let size = [48, 64];
    let small = display(size);
    for (stride, first, count, grid) in [
        (5, 0, 17, [1, 17]),
        (2, 0, 9, [3, 3]),
        (10, 10, 16, [4, 4]),
        (3, 1, 25, [5, 5]),
        (25, 0, 7, [1, 7]),
        (100, 100, 9, [3, 3]),
        (5, 3, 11, [1, 11]),
        (4, 0, 9, [1, 9]),
        (7, 7, 16, [4, 4]),
        (50, 0, 25, [5, 5]),
    ] {
        let world = World::new(stride, size, [-0.6, 0.8]);
        let temp = tempfile::tempdir().unwrap();
        let [rows, columns] = grid;
        let camera = |i: usize| {
            let at = [i % columns, i / columns].map(|v| v as f32);
            [at[0] - (columns as f32 - 1.0) / 2.0, at[1] - (rows as f32 - 1.0) / 2.0]
        };
        for i in 0..count {
            let name = format!("frame_{:05}.png", first + i as u64 * stride);
            write(temp.path(), &name, size, &world.view(camera(i)));
        }
        let source = temp.path().to_str().unwrap();
        let read = load(source, &Request::new(&small, &GREEN));
        // Nine views in one row may be a square. The pictures show the row, and it is stated.
        let field = match read {
            Err(SceneError::NotAGrid { .. }) if crate::read::names::square(count).is_some() && rows == 1 => {
                state(temp.path(), &format!("grid = [1, {count}]"));
                load(source, &Request::new(&small, &GREEN)).unwrap()
            }
            read => read.unwrap_or_else(|e| panic!("{stride}: {e}")),
        };
        assert_eq!(field.grid, grid, "{stride}");
        // A missing view is named, and the grid of the existing views can be stated.
        fs::remove_file(temp.path().join(format!("frame_{:05}.png", first + 2 * stride))).unwrap();
        let _ = fs::remove_file(temp.path().join("lightfield.toml"));
        let error = load(source, &Request::new(&small, &GREEN)).unwrap_err();
        let name = format!("frame_{:05}.png", first + 2 * stride);
        assert!(matches!(&error, SceneError::MissingView { file, .. } if file.ends_with(&name)), "{stride}: {error}");
    }
}
