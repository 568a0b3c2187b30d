//! Situations with cameras that form no even grid, and with focal stacks.

use crate::common::done;
use crate::frame::{Case, Chapter, Remedy, Situation, case, change, mended};
use crate::judge::{Canon, Judge};
use crate::made::{GRID, array, light, view};
use crate::tiled::{OF_ROW, row};
use crate::write::{file, png};
use image::RgbImage;
use std::path::Path;

/// Words of the command for a small pupil 4 mm left of the middle.
const ASIDE: &str = "--pupil=-4,0,2,0 --size 48x64 --engine cpu -o out.npy";
/// Distance in the pupil plane [mm] for one step of the scene.
const STEP: f32 = 4.0;
/// Columns of cameras with uneven distances [mm].
const UNEVEN: [f32; 5] = [-8.0, -6.0, 1.0, 3.0, 8.0];

fn from([x, y]: [f32; 2]) -> RgbImage {
    view([y / STEP, x / STEP])
}

/// Makes a row of one camera per millimeter. `x` maps the position of a camera to the position of its view.
fn dense(at: &Path, x: impl Fn(f32) -> f32) -> String {
    let views: Vec<_> = (-8..=8).map(|mm| from([x(mm as f32), 0.0])).collect();
    format!("{} --view-pitch 1", array(at, [1, 17], &views, light))
}

static ROW: Canon = Canon::through(
    ASIDE,
    |at| dense(at, |x| x),
    &[
        ("mirrored", |at| dense(at, |x| -x)),
        ("from the middle", |at| dense(at, |_| 0.0)),
        // The second of five cameras is at -6 mm.
        ("as if it were evenly spaced", |at| dense(at, |_| -6.0)),
    ],
);

/// Allows the error of layers that come from few views.
const OF_LAYERS: Judge = Judge::Like(&ROW, 0.06);

fn uneven(have: &str, toml: &'static str, name: impl Fn(usize) -> String + Send + Sync + 'static) -> Case {
    case(have, format!("render views {ASIDE}"), move |at| {
        for (i, x) in UNEVEN.into_iter().enumerate() {
            file(&at.join("views").join(name(i)), png(from([x, 0.0])));
        }
        if !toml.is_empty() {
            file(&at.join("views/lightfield.toml"), toml);
        }
    })
}

const STILL_LIFE: &str = "builtin:still-life?span=1";

/// Renders pictures through a wide pupil, each with its focus at another depth.
fn stack(at: &Path) {
    for (i, z) in DEPTHS.into_iter().enumerate() {
        let (pupil, out) = (format!("--pupil=0,0,12,{z}"), format!("stack/focus_{i}.png"));
        std::fs::create_dir_all(at.join("stack")).expect("a folder");
        done(at, &["render", STILL_LIFE, &pupil, "--size", "48x64", "--engine", "cpu", "-o", &out]);
    }
}

const DEPTHS: [f32; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
const WITHIN: &str = "--pupil=3,1,4,0.5 --size 48x64 --engine cpu -o out.npy";

static FOCUSED: Canon = Canon::through(WITHIN, |_| STILL_LIFE.into(), &[("another scene", |_| "builtin:plane".into())]);
const OF_STACK: Judge = Judge::Like(&FOCUSED, 0.05);

static FLAT: Canon = Canon::new(
    |at| array(at, GRID, &vec![view([0.0, 0.0]); 15], light),
    &[("upside down", |at| array(at, GRID, &vec![image::imageops::flip_vertical(&view([0.0, 0.0])); 15], light))],
);

/// Returns situations with rows of cameras whose names or positions are not evenly spaced.
fn uneven_rows() -> Vec<Situation> {
    vec![
        uneven(
            "lightfield.toml states the position of each camera of a row.",
            "positions_mm = [-8, -6, 1, 3, 8]\n",
            |i| format!("IMG_{}.png", 4026 + i),
        )
        .right(OF_LAYERS),
        uneven(
            "lightfield.toml states x and y of each camera.",
            "positions_mm = [[-8, 0], [-6, 0], [1, 0], [3, 0], [8, 0]]\n",
            |i| format!("{i}.png"),
        )
        .right(OF_LAYERS),
        uneven("Names have the positions of cameras, which are uneven.", "", |i| {
            format!("y0_x{:02}.png", UNEVEN[i] as i32 + 8)
        })
        .refused(
            "scene/not-a-grid/uneven",
            Remedy::State("views/lightfield.toml", "positions_mm = [0.0, 2.0, 9.0, 11.0, 16.0]"),
            OF_LAYERS,
        ),
        uneven("Names have the positions of cameras, some of them below zero.", "", |i| {
            format!("cam_y0_x{}.png", UNEVEN[i] as i32)
        })
        .refused(
            "scene/uneven",
            Remedy::State("views/lightfield.toml", "positions_mm = { x = [-8.0, -6.0, 1.0, 3.0, 8.0], y = [0.0] }"),
            OF_LAYERS,
        ),
        uneven("Names have the positions of cameras with decimals, and two cameras are far apart.", "", |i| {
            format!("cam_x{:.1}.png", UNEVEN[i] + 8.0)
        })
        .refused(
            "scene/not-a-grid/uneven",
            Remedy::State("views/lightfield.toml", "positions_mm = [0.0, 2.0, 9.0, 11.0, 16.0]"),
            OF_LAYERS,
        ),
        case("The names of one row of 15 cameras have the times of their exposures.", "render views", |at| {
            for (i, view) in row().into_iter().enumerate() {
                file(&at.join(format!("views/IMG_20240501_1000{:02}.png", 1 + i * 5 / 3)), png(view));
            }
        })
        .refused(
            "scene/missing-view",
            change("`grid = [rows columns]`", |at| file(&at.join("views/lightfield.toml"), "grid = [1, 15]\n")),
            OF_ROW,
        ),
        uneven("lightfield.toml lacks one position.", "positions_mm = [-8, -6, 1, 3]\n", |i| format!("{i}.png"))
            .refused(
                "scene/not-a-grid/positions-count positions_mm",
                mended("give one for each", |at| {
                    file(&at.join("views/lightfield.toml"), "positions_mm = [-8, -6, 1, 3, 8]\n");
                }),
                OF_LAYERS,
            ),
    ]
}

pub fn chapter() -> Chapter {
    let stated = "focus_mm = [-1, -0.5, 0, 0.5, 1]\naperture_mm = 12\n";
    let mut situations = uneven_rows();
    situations.extend([
        case("One row of 15 cameras has a running number.", "render views", |at| {
            row().into_iter().enumerate().for_each(|(i, view)| file(&at.join(format!("views/{i:02}.png")), png(view)));
        })
        .right(OF_ROW),
        case("One row of 15 cameras is named by row and column.", "render views", |at| {
            row().into_iter().enumerate().for_each(|(i, view)| file(&at.join(format!("views/v_0_{i}.png")), png(view)));
        })
        .right(OF_ROW),
        case("All views are the same picture.", "render views", |at| {
            (0..15).for_each(|i| file(&at.join(format!("views/v_{}_{}.png", i / 5, i % 5)), png(view([0.0, 0.0]))));
        })
        .right(Judge::Like(&FLAT, 2e-6)),
        case("A focal stack states its depths and its aperture.", format!("render stack {WITHIN}"), move |at| {
            stack(at);
            file(&at.join("stack/lightfield.toml"), stated);
        })
        .right(OF_STACK),
        case("A focal stack states nothing.", format!("render stack {WITHIN}"), stack).refused(
            "scene/not-a-grid/grid-doubtful",
            change("`focus_mm` `aperture_mm`", move |at| file(&at.join("stack/lightfield.toml"), stated)),
            OF_STACK,
        ),
        case("A focal stack lacks one of the depths in lightfield.toml.", format!("render stack {WITHIN}"), |at| {
            stack(at);
            file(&at.join("stack/lightfield.toml"), "focus_mm = [-1, -0.5, 0, 0.5]\naperture_mm = 12\n");
        })
        .refused(
            "scene/settings/focus-count focus_mm",
            mended("one for each", move |at| file(&at.join("stack/lightfield.toml"), stated)),
            OF_STACK,
        ),
        case("A focal stack does not state its aperture.", format!("render stack {WITHIN}"), |at| {
            stack(at);
            file(&at.join("stack/lightfield.toml"), "focus_mm = [-1, -0.5, 0, 0.5, 1]\n");
        })
        .refused(
            "scene/settings/focus-without-aperture focus_mm aperture_mm",
            Remedy::State("stack/lightfield.toml", "aperture_mm = 12"),
            OF_STACK,
        ),
    ]);
    Chapter {
        title: "Cameras and focal stacks",
        about: "Rows of cameras that are uneven, and pictures of one camera.",
        situations,
    }
}
