use super::*;
use eyebox_base::error::ErrorData;
use proptest::prelude::*;
use std::collections::BTreeSet;

fn found(names: &[String]) -> Result<Arrangement, SceneError> {
    let mut names: Vec<Named> = names.iter().map(|n| (n.clone(), 10)).collect();
    names.reverse();
    arrange(Path::new("folder"), &names, None, None)
}

fn placed(names: &[String]) -> ([usize; 2], Vec<String>) {
    let found = found(names).unwrap_or_else(|e| panic!("{e}"));
    (found.grid, found.files)
}

fn grid_of(rows: usize, columns: usize, name: impl Fn(usize, usize) -> String) -> Vec<String> {
    (0..rows * columns).map(|i| name(i / columns, i % columns)).collect()
}

#[test]
fn rows_and_columns_are_found_in_every_style() {
    let styles: [&dyn Fn(usize, usize) -> String; 4] = [
        &|r, c| format!("2067_{r:02}_{c:02}.png"),
        &|r, c| format!("LF_{r}_{c}.png"),
        &|r, c| format!("view-{}-{}.jpg", r + 1, c + 1),
        &|r, c| format!("cam7_2023-11-05_{r}_{c}.EXR"),
    ];
    for style in styles {
        let names = grid_of(5, 12, style);
        assert_eq!(placed(&names), ([5, 12], names));
    }
    assert_eq!(found(&grid_of(1, 9, |r, c| format!("view-{r}-{c}.png"))).unwrap().grid, [1, 9]);
}

#[test]
fn running_numbers_make_a_square_whatever_stands_in_front() {
    for prefix in ["input_Cam", "scene1_", "2023_", ""] {
        let mut names = grid_of(9, 9, |r, c| format!("{prefix}{:03}.png", r * 9 + c));
        let right = ([9, 9], names.clone());
        names.extend((0..81).map(|i| format!("gt_disp_{i:03}.png")));
        names.extend(["thumbnail1.png", "objectids.png", "notes.txt", "gt_disp_lowres.pfm"].map(String::from));
        assert_eq!(placed(&names), right, "{prefix}");
    }
    // Without leading zeros, 10 still comes after 9.
    let names = grid_of(4, 4, |r, c| format!("v{}.png", r * 4 + c));
    assert_eq!(found(&names).unwrap().files, names);
}

#[test]
fn what_is_missing_is_named() {
    let mut names = grid_of(9, 9, |r, c| format!("input_Cam{:03}.png", r * 9 + c));
    names.remove(34);
    let folder = Path::new("folder");
    let missing = |name: &str| folder.join(name).display().to_string();
    let view_missing = SceneError::MissingView { file: missing("input_Cam034.png"), rows: 9, columns: 9 };
    assert_eq!(found(&names).unwrap_err(), view_missing);
    let mut names = grid_of(9, 9, |r, c| format!("input_Cam{:03}.png", r * 9 + c));
    names.pop();
    let text = found(&names).unwrap().doubt;
    assert!(text.contains("80") && text.contains("input_Cam080.png"), "{text}");
    let mut names = grid_of(4, 5, |r, c| format!("LF_{r}_{c}.png"));
    names.remove(7);
    assert_eq!(
        found(&names).unwrap_err(),
        SceneError::MissingView { file: missing("LF_1_2.png"), rows: 4, columns: 5 }
    );
    let names: Vec<_> =
        grid_of(4, 5, |r, c| format!("LF_{r}_{c}.png")).drain(..).filter(|n| !n.contains("_2_")).collect();
    assert!(matches!(found(&names), Err(SceneError::MissingView { file, .. }) if file == missing("LF_2_0.png")));
    assert!(matches!(found(&[]).unwrap_err(), SceneError::Empty { .. }));
    assert!(matches!(found(&["a.png".into()]).unwrap_err(), SceneError::Empty { .. }));
    let twice = ["v0.png", "v1.png", "v01.png", "v2.png"].map(String::from);
    assert_eq!(ErrorData::of(&found(&twice).unwrap_err()).code, "not-a-grid/same-number");
}

/// A minus between a letter and a number is a sign if other names have none there. Otherwise it separates.
#[test]
fn signs_behind_letters_are_read() {
    let at = [-20, -10, 0, 10, 20];
    for names in [
        grid_of(5, 5, |r, c| format!("cam_y{}_x{}.png", at[r], at[c])),
        grid_of(1, 5, |_, c| format!("cam_y0_x{}.png", at[c])),
        grid_of(5, 5, |r, c| format!("r{}c{:+}.png", at[r] / 10, at[c] / 10)),
        grid_of(1, 5, |_, c| format!("x{:.2}.png", f64::from(at[c]) / 8.0)),
    ] {
        let rows = names.len() / 5;
        assert_eq!(placed(&names), ([rows, 5], names));
    }
    assert_eq!(placed(&grid_of(1, 4, |_, c| format!("view-{c}.png"))).1[0], "view-0.png");
    // Cameras are in the order of their numbers, like positions.
    let names = ["x-8.png", "x-6.png", "x1.png", "x3.png", "x10.png"].map(String::from);
    let named: Vec<Named> = names.iter().rev().map(|name| (name.clone(), 1)).collect();
    assert_eq!(in_order(Path::new("f"), &named, 5, None).unwrap().files, names);
}

#[test]
fn a_stated_grid_decides() {
    let names: Vec<Named> = (0..6).map(|i| (format!("v{i}.png"), 1)).collect();
    assert_eq!(arrange(Path::new("f"), &names, Some([2, 3]), None).unwrap().grid, [2, 3]);
    assert!(arrange(Path::new("f"), &names, Some([2, 4]), None).is_err());
    assert!(arrange(Path::new("f"), &names, Some([usize::MAX, 4]), None).is_err());
}

proptest! {
    #[test]
    fn any_names_are_arranged_or_refused(names in prop::collection::vec("[a-z0-9_.éß-]{0,12}\\.(png|JPG|exr)", 0..20)) {
        let unique: BTreeSet<String> = names.into_iter().collect();
        let count = unique.len();
        if let Ok(found) = found(&unique.into_iter().collect::<Vec<_>>()) {
            prop_assert_eq!(found.files.len(), found.grid[0] * found.grid[1]);
            prop_assert!(found.files.len() <= count);
        }
    }

    #[test]
    fn long_numbers_do_no_harm(numbers in prop::collection::vec("[0-9]{1,30}", 1..9)) {
        let names: BTreeSet<String> = numbers.iter().map(|n| format!("v{n}.png")).collect();
        let _ = found(&names.into_iter().collect::<Vec<_>>());
    }

    #[test]
    fn grids_come_back_in_order(rows in 2usize..7, columns in 2usize..7, first in 0usize..3, prefix in "[a-z]{0,3}[0-9]{0,4}_") {
        let names = grid_of(rows, columns, |r, c| format!("{prefix}{}_{}.png", r + first, c + first));
        prop_assert_eq!(placed(&names), ([rows, columns], names));
    }
}
