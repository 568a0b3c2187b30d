//! Situations of users who bring files to eyebox. The command answers each with the right result, or with one line that
//! names the cause and a remedy. The tests follow every remedy. `docs/situations.md` shows the same data.
//!
//! To add a situation, add a [`frame::case`] to the list of a chapter. It has a sentence about the files, the words of
//! the command, and a function that makes the files in a folder of its own. Then add the answer. `right` has the judge
//! of the result. `refused` has words of the cause, the remedy, and the judge of the result after the remedy. To add a
//! chapter, write a file with a function `chapter`, declare it below, and name it in `chapters!`. Then write the page
//! again.
//!
//! `EYEBOX_SITUATIONS=write cargo test --workspace --test situations page` writes the page.
//! `EYEBOX_SITUATION=text` runs only situations whose sentence or command contains the text.

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
