//! Gives the shared library its name for the loader. Programs that were linked with one version find a later one that
//! has the same interface.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let [major, minor] =
        ["MAJOR", "MINOR"].map(|part| std::env::var(format!("CARGO_PKG_VERSION_{part}")).expect("set by Cargo"));
    // Before 1.0, each minor version may change the interface.
    let interface = if major == "0" { format!("{major}.{minor}") } else { major };
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libeyebox.so.{interface}");
    }
}
