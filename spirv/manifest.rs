//! Records the sources of the compiled modules, and checks that the modules still match them.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Flags of `glslangValidator`. The folder of the includes (`-Ikernels`) and the files follow them.
pub const FLAGS: [&str; 4] = ["--quiet", "--target-env", "vulkan1.2", "-V"];

/// The contents of `spirv/manifest.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// First line of `glslangValidator --version`.
    pub compiler: String,
    /// Flags of the compiler.
    pub flags: Vec<String>,
    /// The modules, ordered by name.
    #[serde(default)]
    pub module: Vec<Entry>,
}

/// The record of one module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// `NAME` of `spirv/NAME.spv` and, without `_half`, of `kernels/NAME.comp`.
    pub name: String,
    /// SHA-256 of the source, with its includes.
    pub source_sha256: String,
    /// SHA-256 of the module's bytes.
    pub module_sha256: String,
}

/// Returns a function that turns an error of the file system into a sentence that begins with the path.
fn at(path: &Path) -> impl FnOnce(std::io::Error) -> String + '_ {
    move |error| format!("{}: {error}", path.display())
}

impl Manifest {
    /// Returns the path of the manifest in the workspace `root`.
    pub fn path(root: &Path) -> PathBuf {
        root.join("spirv").join("manifest.toml")
    }

    /// Reads the manifest of `root`.
    ///
    /// # Errors
    /// Returns a sentence if the file is missing or is not a manifest.
    pub fn read(root: &Path) -> Result<Self, String> {
        let path = Self::path(root);
        let text = std::fs::read_to_string(&path).map_err(at(&path))?;
        toml::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
    }
}

/// A shader with this line is built twice, as `NAME`, and as `NAME_half` with `HALF` defined.
const HALVES: &str = "#include \"half.glsl\"";
/// Suffix of the name of the second module.
const HALF: &str = "_half";

/// Returns the names of the modules of the shaders `kernels/NAME.comp`.
///
/// # Errors
/// Returns a sentence if a folder or a file cannot be read.
pub fn modules(root: &Path) -> Result<BTreeSet<String>, String> {
    let mut names = BTreeSet::new();
    for name in stems(&root.join("kernels"), "comp")? {
        let path = root.join("kernels").join(format!("{name}.comp"));
        let text = std::fs::read_to_string(&path).map_err(at(&path))?;
        if text.lines().any(|l| l.trim() == HALVES) {
            names.insert(format!("{name}{HALF}"));
        }
        names.insert(name);
    }
    Ok(names)
}

/// Returns the text of `spirv/modules.rs`, which lists these modules for `lib.rs`.
pub fn list(modules: &BTreeSet<String>) -> String {
    let mut text =
        "// Written by `cargo run -p eyebox-spirv-tool -- build`: change nothing here.\nmodules! {\n".to_owned();
    for name in modules.iter().filter(|name| !name.ends_with(HALF)) {
        let upper = name.to_uppercase();
        let half = format!("{name}{HALF}");
        let variant = if modules.contains(&half) { format!(", {upper}_HALF = \"{half}\"") } else { String::new() };
        text += &format!("    {upper} = \"{name}\"{variant};\n");
    }
    text + "}\n"
}

/// Returns the name of a module's shader, and the macro that is defined for it.
pub fn source_of(module: &str) -> (&str, Option<&'static str>) {
    match module.strip_suffix(HALF) {
        Some(source) => (source, Some("HALF")),
        None => (module, None),
    }
}

/// Returns the names of the files in a folder with this extension, without the extension.
///
/// # Errors
/// Returns a sentence if the folder cannot be read.
pub fn stems(folder: &Path, extension: &str) -> Result<BTreeSet<String>, String> {
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(at(folder))? {
        let path = entry.map_err(at(folder))?.path();
        if path.extension().is_some_and(|e| e == extension) {
            names.extend(path.file_stem().map(|s| s.to_string_lossy().into_owned()));
        }
    }
    Ok(names)
}

/// Returns the SHA-256 of the text of a module's shader and of the files that it includes, each once.
///
/// # Errors
/// Returns a sentence if a file cannot be read.
pub fn source_hash(root: &Path, name: &str) -> Result<String, String> {
    let folder = root.join("kernels");
    let (mut hash, mut seen) = (Sha256::new(), BTreeSet::new());
    let mut open = vec![format!("{}.comp", source_of(name).0)];
    while let Some(file) = open.pop() {
        if !seen.insert(file.clone()) {
            continue;
        }
        let path = folder.join(&file);
        let text = std::fs::read_to_string(&path).map_err(at(&path))?;
        hash.update(&text);
        let includes = text.lines().filter_map(|l| l.trim().strip_prefix("#include")?.trim().strip_prefix('"'));
        open.extend(includes.map(|rest| rest.trim_end_matches('"').to_owned()));
    }
    Ok(hex(&hash.finalize()))
}

/// Returns the SHA-256 of a module's bytes.
pub fn module_hash(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Returns all differences between sources, manifest and modules. No compiler is needed.
///
/// # Errors
/// Returns a sentence if a file cannot be read.
pub fn faults(root: &Path) -> Result<Vec<String>, String> {
    let manifest = Manifest::read(root)?;
    let (sources, built) = (modules(root)?, stems(&root.join("spirv"), "spv")?);
    let known: BTreeSet<String> = manifest.module.iter().map(|m| m.name.clone()).collect();
    let mut faults = Vec::new();
    if manifest.flags != FLAGS {
        faults.push("spirv/manifest.toml was written with other compiler flags".to_owned());
    }
    if std::fs::read_to_string(root.join("spirv").join("modules.rs")).is_ok_and(|text| text != list(&sources)) {
        faults.push("spirv/modules.rs lists other modules".to_owned());
    }
    let file = |module: &str| format!("kernels/{}.comp", source_of(module).0);
    faults.extend(sources.difference(&known).map(|n| format!("{} was never built to spirv/{n}.spv", file(n))));
    faults.extend(known.difference(&sources).map(|n| format!("spirv/{n}.spv has no source any more")));
    faults.extend(built.difference(&known).map(|n| format!("spirv/{n}.spv is not in the manifest")));
    for entry in manifest.module.iter().filter(|m| sources.contains(&m.name)) {
        let name = &entry.name;
        if source_hash(root, name)? != entry.source_sha256 {
            faults.push(format!("{} changed since spirv/{name}.spv was built", file(name)));
        }
        let path = root.join("spirv").join(format!("{name}.spv"));
        match std::fs::read(&path) {
            Err(_) => faults.push(format!("spirv/{name}.spv is missing")),
            Ok(bytes) if module_hash(&bytes) != entry.module_sha256 => {
                faults.push(format!("spirv/{name}.spv is not the module that was built"));
            }
            Ok(_) => {}
        }
    }
    Ok(faults)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes a workspace with three kernels. One of them includes a file, and one is built in two variants.
    fn workspace() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for folder in ["kernels", "spirv"] {
            std::fs::create_dir(root.path().join(folder)).unwrap();
        }
        let write = |name: &str, text: &str| std::fs::write(root.path().join(name), text).unwrap();
        write("kernels/a.comp", "#include \"c.glsl\"\nvoid main() {}");
        write("kernels/b.comp", "void main() {}");
        write("kernels/c.glsl", "// shared");
        write("kernels/d.comp", "#include \"half.glsl\"\nvoid main() {}");
        write("kernels/half.glsl", "// halves");
        let mut manifest =
            Manifest { compiler: "x".into(), flags: FLAGS.map(String::from).to_vec(), module: Vec::new() };
        for name in ["a", "b", "d", "d_half"] {
            write(&format!("spirv/{name}.spv"), name);
            manifest.module.push(Entry {
                name: name.into(),
                source_sha256: source_hash(root.path(), name).unwrap(),
                module_sha256: module_hash(name.as_bytes()),
            });
        }
        write("spirv/modules.rs", &list(&["a", "b", "d", "d_half"].map(String::from).into()));
        write("spirv/manifest.toml", &toml::to_string(&manifest).unwrap());
        root
    }

    #[test]
    fn every_kind_of_disagreement_is_found() {
        let change = |file: &str, text: Option<&str>| {
            let root = workspace();
            assert!(faults(root.path()).unwrap().is_empty());
            let path = root.path().join(file);
            match text {
                Some(text) => std::fs::write(path, text).unwrap(),
                None => std::fs::remove_file(path).unwrap(),
            }
            faults(root.path()).unwrap().join("\n")
        };
        assert!(change("kernels/new.comp", Some("")).contains("new.comp was never built"));
        assert!(change("kernels/b.comp", None).contains("b.spv has no source"));
        assert!(change("kernels/b.comp", Some("void main() { }")).contains("b.comp changed"));
        assert!(change("kernels/c.glsl", Some("// other")).contains("a.comp changed"));
        assert!(change("kernels/half.glsl", Some("// other")).contains("d.comp changed since spirv/d_half.spv"));
        assert!(change("kernels/d.comp", Some("void main() {}")).contains("d_half.spv has no source"));
        assert!(change("kernels/b.comp", Some("#include \"half.glsl\"")).contains("never built to spirv/b_half.spv"));
        assert!(change("spirv/modules.rs", Some("")).contains("modules.rs lists other modules"));
        assert!(change("spirv/orphan.spv", Some("")).contains("orphan.spv is not in the manifest"));
        assert!(change("spirv/a.spv", Some("A")).contains("a.spv is not the module"));
        assert!(change("spirv/a.spv", None).contains("a.spv is missing"));
    }
}
