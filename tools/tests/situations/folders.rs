//! Folders of views: their names, numbers, formats and what lies beside them.

use crate::frame::{Chapter, Remedy, case, change};
use crate::judge::Judge;
use crate::made::{GRID, VIEWS, save};
use std::fs;

/// 8 bits leave no error: all formats hold the same numbers.
const EXACT: Judge = Judge::Like(&VIEWS, 2e-6);

pub fn chapter() -> Chapter {
    Chapter {
        title: "Folders of views",
        about: "The pictures show one scene from a grid of 3 rows and 5 columns of cameras.",
        situations: vec![
            case("Views are named by row and column.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("view_{r}_{c}.png"));
            })
            .right(EXACT),
            case("Rows and columns are counted from one.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("LF-{}-{}.png", r + 1, c + 1));
            })
            .right(EXACT),
            case("Names have the column before the row, with letters.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("x{c}_y{r}.png"));
            })
            .right(EXACT),
            case("Indices are centered on the middle camera and signed.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("cam_{:+}_{:+}.png", r as i32 - 1, c as i32 - 2));
            })
            .right(EXACT),
            case("Names have indices and the positions of cameras in millimeters.", "photograph views", |at| {
                save(&at.join("views"), |r, c| {
                    format!("out_{r:02}_{c:02}_{:.3}_{:.3}_.png", 4.1 * r as f64 - 4.1, 4.1 * c as f64 - 8.2)
                });
            })
            .right(EXACT),
            case("Hidden files of macOS and Windows lie beside the views.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("view_{r}_{c}.png"));
                save(&at.join("views"), |r, c| format!("more_{r}_{c}.png"));
                for (r, c) in (0..GRID[0]).flat_map(|r| (0..GRID[1]).map(move |c| (r, c))) {
                    let file = at.join(format!("views/more_{r}_{c}.png"));
                    fs::remove_file(file).expect("removed");
                    fs::write(at.join(format!("views/._view_{r}_{c}.png")), b"\0\x05\x16\x07").expect("a file");
                }
                fs::write(at.join("views/Thumbs.db"), [1; 40]).expect("a file");
                fs::write(at.join("views/.DS_Store"), [1; 40]).expect("a file");
            })
            .right(EXACT),
            case("One view of the grid is missing.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("view_{r}_{c}.png"));
                fs::rename(at.join("views/view_1_3.png"), at.join("elsewhere.png")).expect("moved");
            })
            .refused(
                "view_1_3.png: this view is missing",
                change("add it", |at| {
                    fs::rename(at.join("elsewhere.png"), at.join("views/view_1_3.png")).expect("moved");
                }),
                EXACT,
            ),
            case("A running number counts 15 views, which are no square.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("{:04}.png", r * GRID[1] + c));
            })
            .right(EXACT),
            case("Rows are counted upwards.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("view_{}_{c}.png", GRID[0] - 1 - r));
            })
            .refused("the first row is the lowest", Remedy::Add("--order flip-rows"), EXACT),
            case("Rows of views lie in folders of their own.", "photograph views", |at| {
                save(&at.join("views"), |r, c| format!("row{r}/view{c}.png"));
            })
            .refused(
                "3 folders of 5 views each",
                Remedy::State("views/lightfield.toml", "files = \"*/*\""),
                EXACT,
            ),
        ],
    }
}
