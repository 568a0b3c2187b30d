//! The page of all situations.

use crate::chapters;
use crate::frame::{Answer, Chapter, Remedy, Situation};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

const HEAD: &str = "# Situations

Find your files here if you do not know how eyebox reads them, or why it refuses them.

    eyebox render views --pupil=9,-4,2,0.5 --size 48x64 --photographs cells -o out.npy

Each row is a test. The command either gives the right result, or stops with exit code 2 and one line that names the cause and a remedy.
The test follows the remedy and judges the result by its values. `render` has a pupil and an output file in every test, as above.
";

/// With `EYEBOX_SITUATIONS=write`, the test writes the page.
#[test]
fn the_page_is_made_of_the_situations() {
    let mut page = HEAD.to_owned();
    let mut sentences = BTreeSet::new();
    for chapter in chapters() {
        write_chapter(&mut page, &chapter);
        for situation in &chapter.situations {
            assert!(sentences.insert(situation.have.clone()), "two situations are the same: {}", situation.have);
        }
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join("docs/situations.md");
    if std::env::var_os("EYEBOX_SITUATIONS").is_some_and(|asked| asked == "write") {
        std::fs::write(&file, &page).expect("the page");
    }
    let kept = std::fs::read_to_string(&file).unwrap_or_default().replace("\r\n", "\n");
    assert!(
        kept == page,
        "docs/situations.md differs from the tests. Run this test with EYEBOX_SITUATIONS=write to write it"
    );
}

fn write_chapter(page: &mut String, chapter: &Chapter) {
    let _ =
        write!(page, "\n## {}\n\n{}\n\n| you have | command | answer |\n|---|---|---|\n", chapter.title, chapter.about);
    for situation in &chapter.situations {
        let cells = [situation.have.clone(), code(&situation.words), answer(situation)];
        for cell in &cells {
            assert!(cell.chars().count() <= 160, "a cell has {} characters: {cell}", cell.chars().count());
        }
        let _ = writeln!(page, "| {} |", cells.join(" | "));
    }
}

fn answer(situation: &Situation) -> String {
    let Answer::Refused { cause, remedy, .. } = &situation.answer else { return "right".into() };
    let remedy = match remedy {
        Remedy::Add(words) => format!("add {}", code(words)),
        Remedy::Replace(_, word) | Remedy::As(_, _, word) | Remedy::By(_, _, word) => format!("write {}", code(word)),
        Remedy::Instead(words) => format!("run {}", code(words)),
        Remedy::State(file, lines) => {
            let name = file.rsplit('/').next().unwrap_or(file);
            format!("{name}: {}", code(&lines.replace('\n', "; ")))
        }
        Remedy::Convert(words, ..) => format!("run {}", code(words)),
        Remedy::Change(words, _) | Remedy::Mend(words, _) => format!("\"{}\"", plain(words)),
    };
    let (error, _) = cause.split_once(' ').unwrap_or((cause, ""));
    format!("refused as {}. Remedy: {remedy}", code(error))
}

/// Escapes bars, because a bar ends a cell of a table.
fn plain(text: &str) -> String {
    text.replace('|', "\\|")
}

fn code(text: &str) -> String {
    format!("`{}`", plain(text))
}
