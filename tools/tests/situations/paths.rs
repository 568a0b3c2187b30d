//! Situations with names and paths of scenes.

use crate::frame::{Case, Chapter, Remedy, case, convert, mended, word_of};
use crate::made::{EXACT, save};
use std::fs;
use std::path::Path;

fn usual(r: usize, c: usize) -> String {
    format!("view_{r}_{c}.png")
}

/// A situation with the usual views in a folder of this name. The command has these words for it.
fn at_path(have: &str, words: &str, folder: &'static str) -> Case {
    case(have, format!("render {words}"), move |at| save(&at.join(folder), usual))
}

#[cfg(unix)]
fn link(to: &Path, from: &Path) {
    std::os::unix::fs::symlink(to, from).expect("a link");
}

/// Copies the folder, because not every system has links.
#[cfg(not(unix))]
fn link(to: &Path, from: &Path) {
    fs::create_dir_all(from).expect("a folder");
    fs::read_dir(to).expect("a folder").flatten().for_each(|e| drop(fs::copy(e.path(), from.join(e.file_name()))));
}

pub fn chapter() -> Chapter {
    let bytes = || std::path::PathBuf::from(word_of(b"caf\xe9".to_vec()));
    let mut situations = vec![
        at_path("The folder has a space in its name.", "'my views'", "my views").right(EXACT),
        at_path("The folder has letters of other scripts in its name.", "场景-Ü", "场景-Ü").right(EXACT),
        at_path("The path ends in a slash.", "views/", "views").right(EXACT),
        at_path("The path goes up and down again.", "a/../views/.", "views/../a/../views").right(EXACT),
        at_path("The folder is deep in a tree.", "data/2024/05/scene/views", "data/2024/05/scene/views").right(EXACT),
        at_path("The name of the folder has 120 letters.", &"v".repeat(120), "vvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvv").right(EXACT),
        at_path("The name of the folder has brackets and a percent sign.", "'views [50%]'", "views [50%]").right(EXACT),
        at_path("The name of the folder has a dot and looks like a file name.", "views.v2", "views.v2").right(EXACT),
        at_path("The name of the folder has a question mark.", "'which?'", "which?").right(EXACT),
    ];
    situations.push(
        case("The folder is a link to another.", "render link", |at| {
            save(&at.join("far/views"), usual);
            link(&at.join("far/views"), &at.join("link"));
        })
        .right(EXACT),
    );
    #[cfg(unix)]
    situations.push(
        case("Views are links to files of other names.", "render views", |at| {
            save(&at.join("store"), |r, c| format!("{}.png", 100 + 17 * r + c));
            fs::create_dir(at.join("views")).expect("a folder");
            for (r, c) in (0..3).flat_map(|r| (0..5).map(move |c| (r, c))) {
                link(&at.join(format!("store/{}.png", 100 + 17 * r + c)), &at.join("views").join(usual(r, c)));
            }
        })
        .right(EXACT),
    );
    #[cfg(unix)]
    situations.push(
        case("A view is a link to a file that is gone.", "render views", |at| {
            save(&at.join("views"), usual);
            fs::rename(at.join("views/view_2_2.png"), at.join("gone.png")).expect("moved");
            link(&at.join("nothing.png"), &at.join("views/view_2_2.png"));
        })
        .refused(
            "scene/missing-view view_2_2.png",
            mended("add it", |at| {
                fs::remove_file(at.join("views/view_2_2.png")).expect("removed");
                fs::rename(at.join("gone.png"), at.join("views/view_2_2.png")).expect("moved");
            }),
            EXACT,
        ),
    );
    situations.push(at_path("The name of the folder begins with a minus sign.", "-views", "-views").refused(
        "usage/unknown-argument",
        Remedy::Replace("-views", "./-views"),
        EXACT,
    ));
    #[cfg(target_os = "linux")]
    situations.push(
        case("The name of the folder is not UTF-8.", "render caf\\xE9", move |at| save(&at.join(bytes()), usual))
            .refused(
                "usage/invalid-utf8 UTF-8",
                convert("Rename", "caf\\xE9", "cafe", move |at| {
                    fs::rename(at.join(bytes()), at.join("cafe")).expect("renamed")
                }),
                EXACT,
            ),
    );
    #[cfg(target_os = "linux")]
    situations.push(
        case("The name of one view is not UTF-8.", "render views", |at| {
            save(&at.join("views"), usual);
            let wrong = std::path::PathBuf::from(word_of(b"view_2_2\xff.png".to_vec()));
            fs::rename(at.join("views/view_2_2.png"), at.join("views").join(wrong)).expect("renamed");
        })
        .refused(
            "scene/unreadable/name-not-utf8 UTF-8",
            mended("rename it", |at| {
                let wrong = std::path::PathBuf::from(word_of(b"view_2_2\xff.png".to_vec()));
                fs::rename(at.join("views").join(wrong), at.join("views/view_2_2.png")).expect("renamed");
            }),
            EXACT,
        ),
    );
    Chapter { title: "Names and paths", about: "The usual views, in folders with other names.", situations }
}
