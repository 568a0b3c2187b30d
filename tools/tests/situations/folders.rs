//! Situations with folders of views, with their names and numbers, and with other files in these folders.

use crate::frame::{Case, Chapter, Remedy, case, change, mended};
use crate::judge::Judge;
use crate::made::{EXACT, GRID, all, save, view_of};
use crate::write::file;
use std::fs;
use std::path::Path;

/// A situation with the usual views in a folder `views`. `name` makes a file name from a row and a column, and `more`
/// changes the folder.
fn named(
    have: &str,
    name: impl Fn(usize, usize) -> String + Send + Sync + 'static,
    more: impl Fn(&Path) + Send + Sync + 'static,
) -> Case {
    case(have, "render views", move |at| {
        save(&at.join("views"), &name);
        more(&at.join("views"));
    })
}

fn nothing(_: &Path) {}

fn usual(r: usize, c: usize) -> String {
    format!("view_{r}_{c}.png")
}

fn number(r: usize, c: usize) -> usize {
    r * GRID[1] + c
}

fn by_hidden_files(views: &Path) {
    for i in 0..GRID[0] * GRID[1] {
        file(&views.join(format!("._view_{}_{}.png", i / GRID[1], i % GRID[1])), b"\0\x05\x16\x07");
    }
    file(&views.join("Thumbs.db"), [1; 40]);
    file(&views.join(".DS_Store"), [1; 40]);
}

pub fn chapter() -> Chapter {
    let mut situations = vec![
        named("Views are named by row and column.", usual, nothing).right(EXACT),
        named("Rows and columns are counted from one.", |r, c| format!("LF-{}-{}.png", r + 1, c + 1), nothing)
            .right(EXACT),
        named("Names have the column before the row, with letters.", |r, c| format!("x{c}_y{r}.png"), nothing)
            .right(EXACT),
        named("Names have u and v instead of x and y.", |r, c| format!("u{c:02}v{r:02}.png"), nothing).right(EXACT),
        named(
            "Indices are signed and count from the middle camera.",
            |r, c| format!("cam_{:+}_{:+}.png", r as i32 - 1, c as i32 - 2),
            nothing,
        )
        .right(EXACT),
        named(
            "Names have indices and positions of cameras in millimeters.",
            |r, c| format!("out_{r:02}_{c:02}_{:.3}_{:.3}_.png", 4.1 * r as f64 - 4.1, 4.1 * c as f64 - 8.2),
            nothing,
        )
        .right(EXACT),
        named("Names begin with the date of the recording.", |r, c| format!("2024-05-17_r{r}_c{c}.png"), nothing)
            .right(EXACT),
        named(
            "Names end in the time of each exposure.",
            |r, c| format!("r{r}_c{c}_{}.png", 1_715_930_000 + 37 * number(r, c) + 5 * r),
            nothing,
        )
        .right(EXACT),
        named("Names have spaces and letters outside ASCII.", |r, c| format!("Ansicht für Ü {r} {c}.png"), nothing)
            .right(EXACT),
        named("The ending of the names is in capitals.", |r, c| format!("VIEW_{r}_{c}.PNG"), nothing).right(EXACT),
        named(
            "A running number counts 15 views, which form no square.",
            |r, c| format!("{:04}.png", number(r, c)),
            nothing,
        )
        .right(EXACT),
        named(
            "A running number has no leading zeros and begins with 1.",
            |r, c| format!("{}.png", 1 + number(r, c)),
            nothing,
        )
        .right(EXACT),
        named("A running number counts by tens.", |r, c| format!("IMG_{:04}.png", 10 * number(r, c)), nothing)
            .right(EXACT),
        named("Hidden files of macOS and Windows are next to the views.", usual, by_hidden_files).right(EXACT),
        named("The folder has the same views as PNG and as small JPEG files.", usual, |views| {
            for (i, view) in all().iter().enumerate() {
                let name = format!("view_{}_{}.jpg", i / GRID[1], i % GRID[1]);
                image::imageops::thumbnail(view, 16, 12).save(views.join(name)).expect("a picture");
            }
        })
        .right(EXACT),
        named("Depth maps and thumbnails are next to the views.", usual, |views| {
            for (i, view) in all().iter().enumerate() {
                for kind in ["depth", "thumb"] {
                    let name = format!("{kind}_{}_{}.png", i / GRID[1], i % GRID[1]);
                    image::imageops::grayscale(view).save(views.join(name)).expect("a picture");
                }
            }
        })
        .right(EXACT),
        named("A copy of one view is next to the views.", usual, |views| {
            fs::copy(views.join("view_1_2.png"), views.join("view_1_2 (1).png")).expect("a copy");
        })
        .right(EXACT),
        named("A text file, a script and a folder of results are next to the views.", usual, |views| {
            file(&views.join("README.txt"), "recorded in May");
            file(&views.join("render_1_2.py"), "import bpy");
            file(&views.join("results/view_0_0.png"), "");
        })
        .right(EXACT),
    ];
    situations.push(
        case("You want to see how eyebox reads a folder.", "info views --size 48x64 --json", |at| {
            save(&at.join("views"), usual);
        })
        .right(Judge::By(|outcome| {
            let found: serde_json::Value = serde_json::from_str(&outcome.stdout).map_err(|e| e.to_string())?;
            let is_right = found["grid"] == serde_json::json!(GRID);
            is_right.then_some(()).ok_or_else(|| format!("another grid: {found}"))
        })),
    );
    situations.extend(stated());
    situations.extend(refused());
    situations.extend(orders());
    Chapter {
        title: "Folders of views",
        about: "The pictures show one scene from a grid of 3 rows and 5 columns of cameras.",
        situations,
    }
}

/// Returns situations with descriptions of the views, such as `lightfield.toml`.
fn stated() -> Vec<crate::frame::Situation> {
    vec![
        named(
            "lightfield.toml is saved as UTF-16 by an editor of Windows.",
            |r, c| format!("{:04}.png", number(r, c)),
            |views| {
                let text = "\u{feff}grid = [3, 5]\r\n";
                file(
                    &views.join("lightfield.toml"),
                    text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<_>>(),
                );
            },
        )
        .right(EXACT),
        named(
            "parameters.cfg of the 4D Light Field Benchmark is next to the views.",
            |r, c| format!("input_Cam{:03}.png", number(r, c)),
            |views| {
                file(
                    &views.join("parameters.cfg"),
                    "[extrinsics]\nnum_cams_x = 5\nnum_cams_y = 3\n[meta]\ndisp_min = -0.8\ndisp_max = 1.0\n",
                );
            },
        )
        .right(EXACT),
        named(
            "Two scenes are in one folder, and lightfield.toml names one.",
            |r, c| format!("a_{r}_{c}.png"),
            |views| {
                save(views, |r, c| format!("b_{c}_{r}.png"));
                file(&views.join("lightfield.toml"), "files = \"a_*\"\n");
            },
        )
        .right(EXACT),
        named("lightfield.toml has a key that eyebox does not read.", usual, |views| {
            file(&views.join("lightfield.toml"), "grid = [3, 5]\ncolour = \"sRGB\"\n");
        })
        .refused(
            "scene/settings/toml `colour`",
            mended("line 2", |at| file(&at.join("views/lightfield.toml"), "grid = [3, 5]\n")),
            EXACT,
        ),
        named("lightfield.toml has rows and columns exchanged.", usual, |views| {
            file(&views.join("lightfield.toml"), "grid = [5, 3]\n");
        })
        .refused(
            "scene/not-a-grid/grid-count",
            mended("the names make 3 x 5", |at| file(&at.join("views/lightfield.toml"), "grid = [3, 5]\n")),
            EXACT,
        ),
        named("The pitch of the views is in meters instead of millimeters.", usual, |views| {
            file(&views.join("lightfield.toml"), "view_pitch_mm = 0.0044\n");
        })
        .refused(
            "scene/settings/view-pitch view_pitch_mm",
            mended("mm", |at| file(&at.join("views/lightfield.toml"), "view_pitch_mm = 4.4\n")),
            EXACT,
        ),
    ]
}

fn refused() -> Vec<crate::frame::Situation> {
    let to_upright = |at: &Path| fs::rename(at.join("elsewhere.png"), at.join("views/view_1_3.png")).expect("moved");
    vec![
        named("One view of the grid is missing.", usual, |views| {
            fs::rename(views.join("view_1_3.png"), views.join("../elsewhere.png")).expect("moved");
        })
        .refused("scene/missing-view view_1_3.png", mended("add it", to_upright), EXACT),
        named(
            "The last of the running numbers is missing.",
            |r, c| format!("{:02}.png", number(r, c)),
            |views| {
                fs::rename(views.join("14.png"), views.join("../elsewhere.png")).expect("moved");
            },
        )
        .refused(
            "scene/not-a-grid/grid-doubtful 14",
            mended("grid", |at| fs::rename(at.join("elsewhere.png"), at.join("views/14.png")).expect("moved")),
            EXACT,
        ),
        named("One view is cut off, as after a full disk.", usual, |views| {
            let name = views.join("view_1_3.png");
            let bytes = fs::read(&name).expect("a view");
            fs::rename(&name, views.join("../elsewhere.png")).expect("moved");
            file(&name, &bytes[..bytes.len() / 2]);
        })
        .refused("scene/corrupt/damaged view_1_3.png", mended("copy it again", to_upright), EXACT),
        named("One view is an empty file.", usual, |views| {
            fs::rename(views.join("view_1_3.png"), views.join("../elsewhere.png")).expect("moved");
            file(&views.join("view_1_3.png"), "");
        })
        .refused("scene/kind view_1_3.png", mended("empty", to_upright), EXACT),
        named("One view differs in size from the others.", usual, |views| {
            let name = views.join("view_1_3.png");
            fs::rename(&name, views.join("../elsewhere.png")).expect("moved");
            image::imageops::thumbnail(&view_of(GRID, 1, 3), 32, 24).save(name).expect("a picture");
        })
        .refused("scene/size view_1_3.png 24 32", mended("give both one size", to_upright), EXACT),
    ]
}

/// Returns situations with orders of views that the names do not show, or show in another way.
fn orders() -> Vec<crate::frame::Situation> {
    vec![
        named("Rows are counted upwards.", |r, c| usual(GRID[0] - 1 - r, c), nothing).refused(
            "scene/order/moves-otherwise",
            Remedy::Add("--order flip-rows"),
            EXACT,
        ),
        named("Columns are counted from right to left.", |r, c| usual(r, GRID[1] - 1 - c), nothing).refused(
            "scene/order/moves-otherwise",
            Remedy::State("views/lightfield.toml", "flip_columns = true"),
            EXACT,
        ),
        named("The first number is the column, and no letter shows it.", |r, c| usual(c, r), nothing).refused(
            "scene/order/moves-otherwise",
            Remedy::Add("--order transpose"),
            EXACT,
        ),
        named(
            "A gantry takes every second row backwards, with a running number.",
            |r, c| format!("{:03}.png", r * GRID[1] + if r % 2 == 0 { c } else { GRID[1] - 1 - c }),
            |views| file(&views.join("lightfield.toml"), "grid = [3, 5]\n"),
        )
        .refused(
            "scene/not-a-grid/every-second-row-backwards",
            Remedy::State("views/lightfield.toml", "serpentine = true"),
            EXACT,
        ),
        named("Rows of views are in folders of their own.", |r, c| format!("row{r}/view{c}.png"), nothing).refused(
            "scene/rows",
            Remedy::State("views/lightfield.toml", "files = \"*/*\""),
            EXACT,
        ),
        named("Rows are letters and columns are numbers.", |r, c| format!("{}{c}.png", ["a", "b", "c"][r]), nothing)
            .refused(
                "scene/not-a-grid/several-names",
                change("view_0_0.png", |at| {
                    for (r, row) in ["a", "b", "c"].iter().enumerate() {
                        for c in 0..GRID[1] {
                            fs::rename(at.join(format!("views/{row}{c}.png")), at.join("views").join(usual(r, c)))
                                .expect("renamed");
                        }
                    }
                }),
                EXACT,
            ),
        named(
            "Two recordings of the same cameras are in one folder.",
            |r, c| format!("a_{r}_{c}.png"),
            |views| {
                save(views, |r, c| format!("b_{r}_{c}.png"));
            },
        )
        .refused(
            "scene/not-a-grid/several-names",
            Remedy::State("views/lightfield.toml", "files = \"a_*\""),
            EXACT,
        ),
        named(
            "Two moments of the same cameras have a number each.",
            |r, c| format!("t0_{r}_{c}.png"),
            |views| {
                save(views, |r, c| format!("t1_{r}_{c}.png"));
            },
        )
        .refused(
            "scene/not-a-grid/several-sets 15",
            Remedy::State("views/lightfield.toml", "files = \"t0_*\""),
            EXACT,
        ),
        named("The views are one folder deeper.", |r, c| format!("images/{}", usual(r, c)), nothing).refused(
            "scene/deeper",
            Remedy::Replace("views", "views/images"),
            EXACT,
        ),
        named(
            "Views have names without a number.",
            |_, _| "left.png".into(),
            |views| {
                fs::rename(views.join("left.png"), views.join("../elsewhere.png")).expect("moved");
                file(&views.join("right.png"), fs::read(views.join("../elsewhere.png")).expect("a view"));
            },
        )
        .refused(
            "scene/empty",
            mended("numbered", |at| {
                fs::remove_file(at.join("views/right.png")).expect("removed");
                save(&at.join("views"), usual);
            }),
            EXACT,
        ),
        case("The folder is empty.", "render views", |at| fs::create_dir(at.join("views")).expect("a folder")).refused(
            "scene/empty",
            change("view_3_7.png", |at| save(&at.join("views"), usual)),
            EXACT,
        ),
    ]
}
