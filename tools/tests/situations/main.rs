//! Situations of people who bring files to eyebox. The command answers each with the right result, or with one line that names the
//! cause and a remedy. The tests follow every remedy. `docs/situations.md` is made of the same data.
//!
//! To add a situation, add a [`frame::case`] to the list of a chapter: what people have, the words of the command, a function that
//! makes the files in a folder of its own, and the answer. `right` states how the result is judged. `refused` states words of the
//! cause, the remedy, and how the result is judged after the remedy was followed. To add a chapter, write a file with a function
//! `chapter`, declare it below, and name it in `chapters!`. Then write the page anew.
//!
//! `EYEBOX_SITUATIONS=write cargo test --workspace --test situations page` writes the page.
//! `EYEBOX_SITUATION=text` runs those situations alone whose sentence or command contains the text.

#[path = "../command/common/mod.rs"]
mod common;

mod arrays;
mod cameras;
mod depths;
mod displays;
mod folders;
mod formats;
mod frame;
mod ground;
mod holograms;
mod judge;
mod made;
mod outputs;
mod page;
mod paths;
mod phases;
mod recordings;
mod tables;
mod tiled;
mod videos;
mod write;

use videos::others;

/// Makes one test of each chapter, and the list of all chapters in the order of the page.
macro_rules! chapters {
    ($($name:ident)*) => {
        fn chapters() -> Vec<frame::Chapter> {
            vec![$($name::chapter()),*]
        }

        mod chapter {
            $(#[test]
            fn $name() {
                crate::$name::chapter().follow();
            })*
        }
    };
}

chapters! {
    folders
    formats
    arrays
    tiled
    depths
    videos
    others
    cameras
    paths
    holograms
    phases
    displays
    tables
    recordings
    outputs
}
