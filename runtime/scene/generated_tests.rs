//! Tests light fields of a generator, which are written to folders and read again. Their depth is within a tenth of the
//! truth, or they are refused with the line that decides. None is read inside out without a message.

use crate::*;
use eyebox_base::files::write_png;
use eyebox_optics::{Color, Display};
use std::fmt;

const GREEN: [Color; 1] = [Color::Green];

/// One light field, and the way in which it is written.
#[derive(Debug)]
struct Case {
    scene: &'static str,
    size: [usize; 2],
    views: usize,
    /// Pixels by which the nearest content moves between neighboring views.
    disparity: f64,
    order: &'static str,
    naming: usize,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { scene, size: [h, w], views, disparity, order, .. } = self;
        write!(f, "{scene} {h}x{w}, {views} x {views} views, {disparity:.2} pixels, {order}")
    }
}

const SCENES: [&str; 7] =
    ["still-life", "still-life-dark", "still-life-bright", "dense-grass", "chart", "points", "plane"];
const ORDERS: [&str; 7] =
    ["as-named", "as-named", "flip-rows", "flip-columns", "flip-rows,flip-columns", "transpose", "transpose,flip-rows"];

/// Returns the case of a number.
fn case(number: usize) -> Case {
    let mut random = fastrand::Rng::with_seed(number as u64);
    let size = [[64, 64], [96, 96], [96, 112], [128, 96]][random.usize(..4)];
    let views = random.usize(3..=11);
    // The built-in scenes end where the outer views would see beneath them.
    let most = (0.19 * size[0].min(size[1]) as f64 / ((views - 1) as f64 / 2.0)).min(8.0);
    let disparity = 0.4 * (most / 0.4).powf(random.f64());
    let order = ORDERS[random.usize(..ORDERS.len())];
    Case { scene: SCENES[number % SCENES.len()], size, views, disparity, order, naming: random.usize(..4) }
}

/// The outcome of one case.
#[derive(Debug)]
enum Outcome {
    /// The depth is within a tenth, and another order is refused with the flag that corrects it.
    Read,
    /// The depth is within a tenth, but nothing distinguishes another order from the named one, and a note says so.
    Noted,
    /// The depths must be stated, and the line says so.
    Refused(String),
    /// The depth is off by more than a tenth, or the right order is refused.
    Wrong(String),
    /// Another order is taken for the order of the names.
    Inverted(String),
}

fn outcome(case: &Case) -> Outcome {
    let [height, width] = case.size;
    let display = Display { height, width, ..Display::preset("small").unwrap() };
    let request = Request { views: case.views, ..Request::new(&display, &GREEN) };
    let cell = display.eyebox_min() / case.views as f64;
    let per_pixel = display.focal_length * display.picture_pixel() / cell;
    let key = if case.scene == "plane" { "depth" } else { "span" };
    let source = format!("builtin:{}?{key}={}", case.scene, case.disparity * per_pixel * 1e3);
    let truth = load(&source, &request).unwrap();
    let [far, near] = truth.depth.unwrap();

    let temp = tempfile::tempdir().unwrap();
    let (grid, places) = case.order.parse::<Order>().unwrap().places(truth.grid);
    for (view, named) in truth.planes[0].iter().zip(places) {
        let (r, c) = (named / grid[1], named % grid[1]);
        let name = match case.naming {
            0 => format!("view_{r}_{c}.png"),
            1 => format!("r{:02}c{:02}.png", r + 1, c + 1),
            2 => format!("out_{r:02}_{c:02}_{:.3}_{:.3}_.png", r as f64 * 9.5 - 30.0, c as f64 * 9.5),
            _ => format!("input_Cam{:03}.png", r * grid[1] + c),
        };
        write_png(&temp.path().join(name), height, width, &[view]).unwrap();
    }
    let source = temp.path().to_str().unwrap();
    let refused = |doubt: &Option<String>| doubt.clone().unwrap_or_default();
    let (mut found, _) = inspect(source, &request).unwrap();
    let mut noted = false;
    if case.order != "as-named" {
        let line = refused(&found.doubt);
        let flag = format!("`order` {}", case.order);
        match found.order_confirmed {
            // One of two named flags is right, and the line says that the pictures show no more.
            Some(false) if line.contains(&format!("{flag} ")) => {}
            None => noted = true,
            _ => return Outcome::Inverted(line),
        }
        (found, _) = inspect(source, &Request { order: Some(case.order.parse().unwrap()), ..request }).unwrap();
    } else if found.order_confirmed == Some(false) {
        return Outcome::Wrong(refused(&found.doubt));
    }
    if let Some(line) = found.doubt {
        return Outcome::Refused(line);
    }
    // Few views resolve a quarter of a pixel.
    let [low, high] = [far, near].map(|z| z / per_pixel);
    let most = (0.1 * (high - low)).max(0.25);
    let [a, b] = found.disparity_px;
    if (a - low).abs() > most || (b - high).abs() > most {
        return Outcome::Wrong(format!("{a:.2} to {b:.2} instead of {low:.2} to {high:.2} pixels"));
    }
    if noted { Outcome::Noted } else { Outcome::Read }
}

/// Tests content that hides no surface or repeats. It is single points far apart on black, and bars of many periods.
#[test]
fn points_and_bars_are_read_right_or_refused() {
    let wide = |scene, views, disparity| Case { scene, size: [96, 96], views, disparity, order: "as-named", naming: 0 };
    let cases = [
        wide("points", 3, 3.0),
        wide("points", 5, 2.5),
        wide("points", 5, 4.0),
        wide("chart", 3, 2.0),
        wide("chart", 3, 0.5),
        wide("chart", 5, 1.5),
        wide("chart", 9, 1.0),
    ];
    let mut read = 0;
    for case in cases {
        match outcome(&case) {
            Outcome::Read => read += 1,
            Outcome::Refused(line) if line.contains("`depth`") => {}
            other => panic!("{case}: {other:?}"),
        }
    }
    assert!(read > 3, "{read} are read");
}

/// Reads the cases of these numbers, and returns the number of each outcome.
fn read(numbers: std::ops::Range<usize>) -> [usize; 5] {
    let mut counts = [0; 5];
    for number in numbers {
        let case = case(number);
        let (kind, what) = match outcome(&case) {
            Outcome::Read => (0, String::new()),
            Outcome::Noted => (1, String::new()),
            Outcome::Refused(line) => (2, line),
            Outcome::Wrong(what) => (3, what),
            Outcome::Inverted(what) => (4, what),
        };
        counts[kind] += 1;
        println!("{number:3} {} {case}: {what}", ["read", "noted", "refused", "WRONG", "INVERTED"][kind]);
    }
    println!("read, noted, refused, wrong, inverted: {counts:?}");
    counts
}

/// Tests one case of each scene. The full set runs by `cargo test --lib every_generated -- --ignored --nocapture`.
#[test]
fn generated_light_fields_are_read_right_or_refused() {
    let [read, .., wrong, inverted] = read(0..7);
    assert!(read > 3 && [wrong, inverted] == [0, 0], "see above");
}

#[test]
#[ignore = "minutes"]
fn every_generated_light_field_is_read_right_or_refused() {
    let [read, .., wrong, inverted] = read(0..280);
    assert!(read > 140 && [wrong, inverted] == [0, 0], "see above");
}
