//! The header for C matches the crate for C.

use std::path::Path;

/// `EYEBOX_HEADER=write` writes the header again.
#[test]
fn the_header_is_what_the_crate_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join("tools/c");
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).expect("the configuration");
    // The order is the order in which the crate reads them.
    let modules = [
        "interface",
        "failure",
        "display",
        "engine",
        "vulkan",
        "scene",
        "solve",
        "hologram",
        "pupil",
        "refiner",
        "encoder",
        "session",
    ];
    let builder = cbindgen::Builder::new().with_config(config);
    let builder = modules.iter().fold(builder, |b, module| b.with_src(folder.join(module).with_extension("rs")));
    let mut made = Vec::new();
    builder.generate().expect("a header").write(&mut made);
    let file = folder.join("eyebox.h");
    if std::env::var_os("EYEBOX_HEADER").is_some_and(|asked| asked == "write") {
        std::fs::write(&file, &made).expect("the header");
    }
    let kept = std::fs::read(&file).unwrap_or_default();
    assert!(kept == made, "tools/c/eyebox.h differs from tools/c. Run this test with EYEBOX_HEADER=write to update it");
}
