//! The items that programs may rely on. The facade names each of them, and their number is limited.

use crate::architecture::{root, rust_files, tokens, use_tree};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Maximum number of items that programs may rely on. All other items are in `low_level`.
const MAX_FACADE_ITEMS: usize = 200;

/// The facade names each of its items. Vulkan's own crate `ash`, which is not stable, appears in `low_level` only.
#[test]
fn the_facade_names_what_it_promises() {
    let text = std::fs::read_to_string(root().join("runtime/eyebox/lib.rs")).expect("the facade");
    let all = tokens(&text);
    let mut items = Vec::new();
    for at in (0..all.len()).filter(|i| all[*i] == "use" && all[i - 1] == "pub") {
        use_tree(&all, at + 1, &[], &mut items);
    }
    let names: BTreeSet<String> = items.iter().map(|(_, path)| path.join("::")).collect();
    assert!(names.len() > 100 && names.len() <= MAX_FACADE_ITEMS, "{} items", names.len());
    assert!(items.iter().all(|(name, path)| name != "*" && path.len() > 1), "{items:?}");
    assert!(names.iter().all(|name| !name.contains("ash")), "{names:?}");
    // C and Python need more items. Each of them uses `low_level` in one file.
    let mut paths = Vec::new();
    ["tools/c", "tools/python"].iter().for_each(|folder| rust_files(&root().join(folder), &mut paths));
    let uses = |path: &PathBuf| tokens(&std::fs::read_to_string(path).expect("a file")).contains(&"low_level");
    let mut users: Vec<_> =
        paths.iter().filter(|path| !path.display().to_string().contains("tests") && uses(path)).collect();
    users.sort();
    let places = ["tools/c/vulkan.rs", "tools/python/internals.rs"];
    let is_place = |(user, place): (&&PathBuf, &str)| user.ends_with(place);
    assert!(users.len() == places.len() && users.iter().zip(places).all(is_place), "{users:?}");
}
