//! Tests light fields with the usual names, orders and gaps. Each is read correctly or refused with a line that helps.

use super::coded;
use crate::*;
use eyebox_base::error::Reason;
use eyebox_base::files::write_png;
use eyebox_optics::{Color, Display};
use image::{ImageBuffer, Luma};
use std::{fs, path::PathBuf};

const GREEN: [Color; 1] = [Color::Green];

fn display(size: usize) -> Display {
    Display { height: size, width: size, ..Display::preset("small").unwrap() }
}

/// Returns a number that distinguishes views, and whose steps are no running number.
fn mark(r: usize, c: usize) -> u8 {
    ((r * 37 + c) * 7919 % 251) as u8
}

/// Writes a small view for each name, and `at` is its place.
fn write(folder: &Path, names: &[(String, [usize; 2])]) {
    for (name, [r, c]) in names {
        let file = folder.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        ImageBuffer::from_pixel(8, 8, Luma([mark(*r, *c)])).save(file).unwrap();
    }
}

fn grid(rows: usize, columns: usize, name: impl Fn(usize, usize) -> String) -> Vec<(String, [usize; 2])> {
    (0..rows * columns).map(|i| (name(i / columns, i % columns), [i / columns, i % columns])).collect()
}

fn without(mut names: Vec<(String, [usize; 2])>, i: usize) -> Vec<(String, [usize; 2])> {
    names.remove(i);
    names
}

fn and(mut names: Vec<(String, [usize; 2])>, more: &[&str]) -> Vec<(String, [usize; 2])> {
    names.extend(more.iter().map(|m| ((*m).to_owned(), [0, 0])));
    names
}

type Row = (&'static str, Vec<(String, [usize; 2])>, &'static str, Result<[usize; 2], &'static [&'static str]>);

/// Returns the kind of folder, its files, its lightfield.toml, and the way in which it is read or the text of the line.
fn ways() -> Vec<Row> {
    let lytro = |r: usize, c: usize| format!("IMG_2067_eslf_{r:02}_{c:02}.png");
    let hci = |r: usize, c: usize| format!("input_Cam{:03}.png", r * 9 + c);
    let stanford = |r: usize, c: usize| {
        let (y, x) = (-776.880371 + 48.3 * r as f64 + 0.7 * c as f64, 1533.135620 - 48.6 * c as f64 + 0.3 * r as f64);
        format!("out_{r:02}_{c:02}_{y:.6}_{x:.6}_.png")
    };
    let coordinates = |r: usize, c: usize| {
        let (x, y) = (2.5 * c as f64 - 5.0 + 0.01 * r as f64, 2.5 * r as f64 - 5.0 + 0.013 * c as f64);
        format!("cam_x{x:.3}_y{y:.3}.png")
    };
    let by_row = |r: usize, c: usize| format!("row_{r}/view_{c}.png");
    let serpentine = |r: usize, c: usize| format!("{:03}.png", r * 4 + if r.is_multiple_of(2) { c } else { 3 - c });
    vec![
        ("Stanford archive, decimal and negative coordinates", grid(17, 17, stanford), "", Ok([17, 17])),
        (
            "4D Light Field Benchmark",
            and(grid(9, 9, hci), &["objectids_highres.png", "gt_depth_lowres.png"]),
            "",
            Ok([9, 9]),
        ),
        ("old HCI, exported", grid(9, 9, |r, c| format!("lf_{r}_{c}.png")), "", Ok([9, 9])),
        (
            "Technicolor, sixteen cameras of a frame",
            grid(4, 4, |r, c| format!("Birthday_undist_00042_{:02}.png", r * 4 + c)),
            "",
            Ok([4, 4]),
        ),
        ("Lytro export", grid(14, 14, lytro), "", Ok([14, 14])),
        ("EPFL, one-based", grid(13, 13, |r, c| format!("{:03}_{:03}.png", r + 1, c + 1)), "", Ok([13, 13])),
        ("MPI, one row", grid(1, 101, |_, c| format!("{c:04}.png")), "grid = [1, 101]", Ok([1, 101])),
        ("Blender frames, one-based", grid(5, 5, |r, c| format!("{:04}.png", r * 5 + c + 1)), "", Ok([5, 5])),
        ("view-3-7", grid(4, 7, |r, c| format!("view-{r}-{c}.png")), "", Ok([4, 7])),
        ("x before y", grid(3, 5, |r, c| format!("x{c}_y{r}.png")), "", Ok([3, 5])),
        ("signs", grid(5, 5, |r, c| format!("v_{:+}_{:+}.png", r as i32 - 2, c as i32 - 2)), "", Ok([5, 5])),
        (
            "coordinates with signs",
            grid(3, 4, |r, c| format!("y{:+.1}x{:+.1}.png", r as f64 - 1.0, c as f64 - 1.5)),
            "",
            Ok([3, 4]),
        ),
        ("a folder for each row", grid(4, 5, by_row), "", Err(&["4 folders of 5 views", "*/*", "row_0"])),
        ("as many as views in each", grid(4, 4, by_row), "", Err(&["4 folders of 4 views", "*/*", "row_0"])),
        ("a folder for each row, stated", grid(4, 5, by_row), "files = \"row_*/*\"", Ok([4, 5])),
        ("every second row backwards, stated", grid(5, 4, serpentine), "serpentine = true\ngrid = [5, 4]", Ok([5, 4])),
        (
            "letters and numbers",
            grid(3, 5, |r, c| format!("{}{c}.png", ["a", "b", "c"][r])),
            "",
            Err(&["not-a-grid/several-names"]),
        ),
        ("r3c7, one-based", grid(5, 4, |r, c| format!("r{}c{}.png", r + 1, c + 1)), "", Ok([5, 4])),
        ("columns first by name", grid(3, 4, |r, c| format!("col{c:02}row{r:02}.png")), "", Ok([3, 4])),
        ("signed indices", grid(5, 5, |r, c| format!("v_{}_{}.png", r as i32 - 2, c as i32 - 2)), "", Ok([5, 5])),
        ("coordinates alone", grid(5, 5, coordinates), "", Ok([5, 5])),
        ("running number and indices", grid(3, 3, |r, c| format!("{:02}_r{r}_c{c}.png", 3 * r + c)), "", Ok([3, 3])),
        ("indices with a point between", grid(3, 3, |r, c| format!("lf{r}.{c}.png")), "", Ok([3, 3])),
        (
            "one missing",
            without(grid(4, 5, |r, c| format!("LF_{r}_{c}.png")), 7),
            "",
            Err(&["missing-view: ", "LF_1_2.png"]),
        ),
        (
            "one of the archive's missing",
            without(grid(5, 5, stanford), 8),
            "",
            Err(&["missing-view: ", "out_01_03_*_*_.png"]),
        ),
        (
            "one of a running number missing",
            without(grid(9, 9, hci), 40),
            "",
            Err(&["missing-view: ", "input_Cam040.png"]),
        ),
        (
            "the last missing",
            without(grid(9, 9, hci), 80),
            "",
            Err(&["not-a-grid/grid-doubtful", "80", "input_Cam080.png", "`grid"]),
        ),
        (
            "two light fields",
            and(
                grid(3, 3, |r, c| format!("a_{r}_{c}.png")),
                &["b_0_0.png", "b_0_1.png", "b_1_0.png", "b_1_1.png", "b_2_2.png"],
            ),
            "",
            Err(&["not-a-grid/several-names", "`files"]),
        ),
        (
            "one of two, stated",
            and(
                grid(3, 3, |r, c| format!("a_{r}_{c}.png")),
                &["b_0_0.png", "b_0_1.png", "b_1_0.png", "b_1_1.png", "b_2_2.png"],
            ),
            "files = \"a_*\"",
            Ok([3, 3]),
        ),
        (
            "frames of a light field",
            grid(6, 3, |r, c| format!("t{}_{}_{c}.png", r / 3, r % 3)),
            "",
            Err(&["not-a-grid/several-sets", "`files"]),
        ),
        (
            "two times nine by nine",
            grid(2, 81, |r, c| format!("s{r}_{c:03}.png")),
            "",
            Err(&["not-a-grid/grid-or-sequence", "9 x 9", "`grid", "`files"]),
        ),
        (
            "another grid than is stated",
            grid(3, 4, |r, c| format!("v_{r}_{c}.png")),
            "grid = [4, 3]",
            Err(&["not-a-grid/grid-count", "3 x 4", "4 x 3"]),
        ),
        (
            "names without a pattern",
            vec![("a1b.png".into(), [0, 0]), ("c2d.png".into(), [0, 1]), ("e3f.png".into(), [0, 2])],
            "",
            Err(&["not-a-grid/several-names"]),
        ),
    ]
}

#[test]
fn every_way_of_naming_is_read_right_or_refused() {
    let small = display(8);
    for (what, names, toml, right) in ways() {
        let temp = tempfile::tempdir().unwrap();
        write(temp.path(), &names);
        if !toml.is_empty() {
            fs::write(temp.path().join("lightfield.toml"), toml).unwrap();
        }
        let read = load(temp.path().to_str().unwrap(), &Request::new(&small, &GREEN));
        match (read, right) {
            (Ok(field), Ok(grid)) => {
                assert_eq!(field.grid, grid, "{what}");
                for (i, view) in field.planes[0].iter().enumerate() {
                    let light = srgb_to_linear(f64::from(mark(i / grid[1], i % grid[1])) / 255.0) as f32;
                    assert!((view[0] - light).abs() < 1e-5, "{what}: view {i}");
                }
            }
            (Err(error), Err(words)) => {
                let line = coded(&error);
                assert!(words.iter().all(|w| line.contains(w)) && !line.contains('\n'), "{what}: {line}");
            }
            (Ok(field), Err(_)) => panic!("{what}: read as {:?}", field.grid),
            (Err(error), Ok(_)) => panic!("{what}: {error}"),
        }
    }
}

/// Returns the name of a view from its named row and column.
type Naming = dyn Fn(usize, usize) -> String;

/// Writes a light field under names, in an order that the names do not show.
fn save(field: &LightField, order: &str, name: &Naming) -> tempfile::TempDir {
    let temp = tempfile::tempdir().unwrap();
    let (_, places) = order.parse::<Order>().unwrap().places(field.grid);
    let columns = field.grid[1];
    for (view, named) in field.planes[0].iter().zip(places) {
        let file: PathBuf = temp.path().join(name(named / columns, named % columns));
        write_png(&file, field.height, field.width, &[view]).unwrap();
    }
    temp
}

/// Tests every order, naming and number of views. The depths are right, or the line has the correction, and none is
/// inside out.
#[test]
fn ten_light_fields_are_none_of_them_inside_out() {
    let display = display(96);
    let render = |views: usize, span: f64| {
        load(&format!("builtin:still-life?span={span}"), &Request { views, ..Request::new(&display, &GREEN) }).unwrap()
    };
    let fields = [render(5, 1.1), render(9, 1.1), render(3, 0.55)];
    let coordinates =
        |r: usize, c: usize| format!("out_{:.4}_{:.4}.png", 48.3 * r as f64 - 96.0, 48.3 * c as f64 + 0.01 * r as f64);
    let cases: [(usize, &str, &Naming); 10] = [
        (1, "as-named", &|r, c| format!("input_Cam{:03}.png", r * 9 + c)),
        (0, "as-named", &|r, c| format!("out_{r:02}_{c:02}_{:.3}_{:.3}_.png", r as f64 * 9.5, c as f64 * 9.5)),
        (0, "flip-rows", &|r, c| format!("view-{r}-{c}.png")),
        (0, "flip-columns", &|r, c| format!("r{r}c{c}.png")),
        (0, "flip-rows,flip-columns", &|r, c| format!("LF_{r:02}_{c:02}.png")),
        (0, "transpose", &|r, c| format!("{:03}_{:03}.png", r + 1, c + 1)),
        (1, "flip-rows,flip-columns", &|r, c| format!("{:04}.png", r * 9 + c + 1)),
        (2, "as-named", &|r, c| format!("cam_x{c}_y{r}.png")),
        (0, "flip-rows", &coordinates),
        (2, "transpose,flip-rows", &|r, c| format!("Frame{}_{}.png", r + 1, c + 1)),
    ];
    let mut wrong = Vec::new();
    for (which, order, name) in cases {
        let truth = &fields[which];
        let temp = save(truth, order, name);
        let source = temp.path().to_str().unwrap();
        let request = Request::new(&display, &GREEN);
        let field = match load(source, &request) {
            Ok(field) => field,
            Err(SceneError::Order { flags, .. }) => {
                assert!(order != "as-named", "{}: {flags}", name(0, 0));
                let right = flags.split(" or ").any(|flag| flag == format!("`order` {order}"));
                if !right {
                    wrong.push(format!("{order} {}: {flags}", name(0, 0)));
                }
                load(source, &Request { order: Some(order.parse().unwrap()), ..request }).unwrap()
            }
            Err(other) => panic!("{}: {other}", name(0, 0)),
        };
        // The views are the same in the same places, to the 8 bits of a file.
        let off = field.planes[0].iter().zip(&truth.planes[0]).flat_map(|(a, b)| a.iter().zip(b));
        let off = off.map(|(a, b)| (a - b.min(1.0)).abs()).fold(0.0, f32::max);
        if off >= 0.01 {
            wrong.push(format!("{order} {}: {:?}", name(0, 0), Parallax::of(&field)));
            continue;
        }
        let [far, near] = truth.depth.unwrap();
        let ([low, high], _) = LightField { view_pitch: truth.view_pitch, ..field }.reach(&display);
        // The range is neither too narrow nor too wide.
        let most = 0.1 * (near - far);
        if (low - far).abs() > most || (high - near).abs() > most {
            wrong.push(format!("{order} {}: {low} to {high} of {far} to {near}", name(0, 0)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_shows_nothing_is_not_doubted() {
    let display = display(64);
    for scene in ["builtin:plane", "builtin:points", "builtin:dense-grass", "builtin:chart"] {
        let field = load(scene, &Request { views: 5, ..Request::new(&display, &GREEN) }).unwrap();
        let temp = save(&field, "as-named", &|r, c| format!("v_{r}_{c}.png"));
        let read = load(temp.path().to_str().unwrap(), &Request::new(&display, &GREEN));
        assert!(read.is_ok(), "{scene}: {}", read.unwrap_err());
    }
}

/// A single surface covers nothing. Stated depths then distinguish near from far, if they have room for only one of the
/// orders.
#[test]
fn stated_depths_tell_near_from_far_where_nothing_is_covered() {
    let display = display(96);
    let request = Request::new(&display, &GREEN);
    let field = load("builtin:plane?depth=1", &Request { views: 5, ..request }).unwrap();
    for (order, toml, wanted) in [
        ("as-named", "", None),
        ("flip-rows,flip-columns", "", None),
        ("as-named", "depth_mm = [0.8, 1.2]", Some(true)),
        ("flip-rows,flip-columns", "depth_mm = [0.8, 1.2]", Some(false)),
        ("flip-rows,flip-columns", "depth_mm = [-2, 2]", None),
    ] {
        let temp = save(&field, order, &|r, c| format!("v_{r}_{c}.png"));
        fs::write(temp.path().join("lightfield.toml"), toml).unwrap();
        let source = temp.path().to_str().unwrap();
        let (found, _) = inspect(source, &request).unwrap();
        assert_eq!(found.order_confirmed, wanted, "{order}, {toml}: {found:?}");
        if wanted == Some(false) {
            let line = coded(&load(source, &request).unwrap_err());
            assert!(line.starts_with("order/") && line.contains("`order` flip-rows,flip-columns"), "{line}");
        }
    }
}

#[test]
fn rows_that_run_backwards_are_seen() {
    let display = display(64);
    let field = load("builtin:still-life?span=1", &Request { views: 5, ..Request::new(&display, &GREEN) }).unwrap();
    let fields = [(5, 5, field.planes[0].clone()), (3, 5, field.planes[0][..15].to_vec())];
    for (rows, columns, views) in fields {
        let planes = vec![views];
        let field = LightField { grid: [rows, columns], planes, ..LightField { planes: Vec::new(), ..field.clone() } };
        let temp = save(&field, "as-named", &move |r, c| {
            format!("{:04}.png", r * columns + if r.is_multiple_of(2) { c } else { columns - 1 - c })
        });
        let read = |toml: &str| {
            fs::write(temp.path().join("lightfield.toml"), toml).unwrap();
            load(temp.path().to_str().unwrap(), &Request::new(&display, &GREEN)).map_err(|error| coded(&error))
        };
        let grid = format!("grid = [{rows}, {columns}]\n");
        let line = read(&grid).unwrap_err();
        assert!(line.starts_with("not-a-grid/every-second-row-backwards: "), "{line}");
        // Without the grid, 15 views are neither a square nor one row.
        let line = read("").unwrap_err();
        assert!(
            line.starts_with(if rows == columns { "not-a-grid/every-second" } else { "not-a-grid/grid-doubtful" }),
            "{line}"
        );
        let found = read(&format!("{grid}serpentine = true")).unwrap();
        let apart =
            |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0f32, |most, (a, b)| most.max((a - b.min(1.0)).abs()));
        assert!(found.planes[0].iter().zip(&field.planes[0]).all(|(a, b)| apart(a, b) < 0.01));
        // The middle one of three rows runs backwards, which contradicts the names unless the order is stated.
        assert!(read(&format!("{grid}serpentine = false\nflip_rows = false")).is_ok());
    }
}

#[test]
fn one_row_is_told_from_a_square() {
    let display = display(64);
    let field = load("builtin:still-life?span=1", &Request { views: 9, ..Request::new(&display, &GREEN) }).unwrap();
    let row = LightField { grid: [1, 9], planes: vec![field.planes[0][36..45].to_vec()], ..field };
    let temp = save(&row, "as-named", &|_, c| format!("{c:04}.png"));
    let source = temp.path().to_str().unwrap();
    let line = load(source, &Request::new(&display, &GREEN)).unwrap_err().to_string();
    assert!(line.contains("3 x 3") && line.contains("1 x 9") && line.contains("grid"), "{line}");
    fs::write(temp.path().join("lightfield.toml"), "grid = [1, 9]").unwrap();
    assert_eq!(load(source, &Request::new(&display, &GREEN)).unwrap().grid, [1, 9]);
}

/// The names in docs/scenes.md are in the table above, and its texts of refusals are in the error messages.
#[test]
fn the_page_says_what_is_read_and_what_is_refused() {
    let page = include_str!("../../docs/scenes.md");
    // A run of digits is any number, and every extension is a picture's.
    let like = |name: &str| {
        let mut digits = name.rsplit_once('.').unwrap().0.replace(|c: char| c.is_ascii_digit(), "#");
        while digits.contains("##") {
            digits = digits.replace("##", "#");
        }
        digits
    };
    let known: Vec<String> = ways().iter().flat_map(|(_, names, ..)| names.iter().map(|n| like(&n.0))).collect();
    let names = page.split_once("So `").unwrap().1.split_once(" are read.").unwrap().0;
    let named: Vec<&str> = names.split('`').filter(|n| n.contains('.')).collect();
    assert!(named.len() > 5, "{named:?}");
    named.iter().for_each(|name| assert!(known.contains(&like(name)), "{name}"));

    let temp = tempfile::tempdir().unwrap();
    let (at, display) = (temp.path(), display(8));
    let map = at.join("map.npy");
    eyebox_base::files::write_npy(&map, &[8, 8], &(0..64).map(|i| i as f32).collect::<Vec<_>>()).unwrap();
    let request = Request::new(&display, &GREEN);
    let folder = |name: &str, files: &[&str]| {
        write(&at.join(name), &files.iter().map(|f| ((*f).to_owned(), [0, 0])).collect::<Vec<_>>());
        at.join(name)
    };
    let sizes = folder("sizes", &["v_0_0.png", "v_0_1.png", "v_1_0.png", "v_1_1.png"]);
    ImageBuffer::from_pixel(9, 8, Luma([7u8])).save(sizes.join("v_1_1.png")).unwrap();
    let picture = folder("one", &["v.png"]).join("v.png");
    let said = |path: &Path, request: &Request| load(path.to_str().unwrap(), request).unwrap_err().to_string();
    let other = OrderFound::Other { orders: vec![Order::default()], reason: Reason::new("?", "?") };
    let list = at.join("list.npy");
    eyebox_base::files::write_npy(&list, &[4, 8, 8], &[0.5; 4 * 8 * 8]).unwrap();
    let plain = at.join("plain.png");
    ImageBuffer::from_pixel(64, 64, Luma([90u8])).save(&plain).unwrap();
    // Such views are found in whole light fields (`kept_tests`), and this test checks only the text.
    let (scene, views, cause) = ("folder".into(), "the view of row 2, column 3 is".into(), "?".into());
    let tiles = Tiles { grid: [6, 8], first: FirstTile::BottomLeft, serpentine: false };
    let odd = SceneError::OddViews { scene, views, found: 20.0, others: 40.0, cause };
    let passwd = at.join("passwd");
    fs::write(&passwd, "root:x:0:0:root:/root:/bin/bash\n").unwrap();
    let cameras = |found| SceneError::Cameras { scene: "folder".into(), found }.to_string();
    // One splat behind the stated camera.
    let splats = at.join("behind.splat");
    let one: Vec<u8> = [0.0f32, 0.0, 0.0, 0.1, 0.1, 0.1].iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::write(&splats, [&one[..], &[255; 4], &[255, 128, 128, 128]].concat()).unwrap();
    let unseen = PathBuf::from(format!("{}?eye=0,0,5&at=0,0,9", splats.display()));
    let lines = [
        said(&passwd, &request),
        said(&picture, &request),
        said(&picture, &Request { depth_map: Some(&map), ..request }),
        said(Path::new("builtin:none"), &request),
        said(&sizes, &request),
        said(&folder("hole", &["v_0_0.png", "v_0_1.png", "v_1_0.png"]), &request),
        said(&folder("names", &["a1b.png", "c2d.png", "e3f.png"]), &request),
        said(&folder("rows", &["r0/v0.png", "r0/v1.png", "r1/v0.png", "r1/v1.png"]), &request),
        depth_maps(&["a.png".into(), "b.png".into()], std::slice::from_ref(&map)).unwrap_err().to_string(),
        SceneError::doubtful_depth([0.0, 1.0], 30, display.focal_length).to_string(),
        read::order_found::check("folder", &other, true).unwrap_err().to_string(),
        said(&list, &request),
        said(&PathBuf::from(format!("{}?mosaic", plain.display())), &request),
        said(&PathBuf::from(format!("{}?grid=3x3", plain.display())), &request),
        odd.to_string(),
        said(&at.join("lsit.npy"), &request),
        SceneError::Deeper { folder: "folder".into(), inner: "folder/a".into() }.to_string(),
        SceneError::FullScale { file: "a".into(), found: "?".into(), white: 1023.0, how: FullScale::Folder }
            .to_string(),
        SceneError::Matrix { file: "a.y4m".into() }.to_string(),
        SceneError::Turned { file: "a".into(), height: 1, width: 2, other: "b".into(), orientation: 6 }.to_string(),
        SceneError::Uneven { folder: "folder".into(), x: vec![0.0, 1.0, 5.0], y: vec![0.0] }.to_string(),
        cameras(CamerasFound::RowInTiles(tiles)),
        cameras(CamerasFound::Elsewhere(10)),
        cameras(CamerasFound::Uneven { columns: true, positions: vec![-1.0, 0.0, 2.0] }),
        cameras(CamerasFound::Misplaced(10)),
        cameras(CamerasFound::OnePlace),
        cameras(CamerasFound::Unlike(10)),
        cameras(CamerasFound::Carried { count: 25, grid: None }),
        said(&unseen, &request),
    ];
    let table = page.split_once("| the line says | what to do |").unwrap().1;
    let rows: Vec<&str> = table.lines().filter_map(|row| row.strip_prefix("| `")?.split('`').next()).collect();
    assert_eq!(rows.len(), lines.len());
    for row in rows {
        let parts: Vec<&str> = row.split("...").map(str::trim).collect();
        assert!(lines.iter().any(|line| parts.iter().all(|part| line.contains(part))), "{row}: {lines:#?}");
    }
}
