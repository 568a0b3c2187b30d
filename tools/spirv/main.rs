//! Builds the SPIR-V modules, and checks that they match their sources.

use clap::{Parser, Subcommand};
use eyebox_spirv::manifest::{
    Entry, FLAGS, Manifest, faults, list, module_hash, modules, source_hash, source_of, stems,
};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Builds and checks the SPIR-V modules. Requires glslangValidator and spirv-val.
#[derive(Parser)]
#[command(after_help = "Example: cargo run -p eyebox-spirv-tool -- build")]
struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand, Clone, Copy, PartialEq)]
enum What {
    /// Compile all shaders, and write the modules and the manifest.
    ///
    /// Writes kernels/constants.glsl, compiles each kernels/*.comp in all its variants, and validates the modules. Then
    /// it writes spirv/*.spv, the list of modules and the manifest, and removes orphans.
    Build,
    /// Compile again and compare bytes, without writing. Lists modules that are missing, stale or orphaned.
    Check,
}

/// The constants that shaders share with Rust.
const CONSTANTS: &str = "kernels/constants.glsl";

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    match run(&root, Arguments::parse().what) {
        Ok(report) => {
            println!("{report}");
            ExitCode::SUCCESS
        }
        Err(faults) => {
            eprintln!("{faults}");
            ExitCode::from(2)
        }
    }
}

/// Compiles everything into a separate folder first, so that an error leaves the modules unchanged.
fn run(root: &Path, what: What) -> Result<String, String> {
    if what == What::Build {
        place(&root.join(CONSTANTS), eyebox_kernels::shared::glsl().as_bytes())?;
    }
    let folder = tempfile::tempdir().map_err(|e| format!("temporary folder: {e}"))?;
    let compiler = version()?;
    let mut built = Vec::new();
    for name in modules(root)? {
        let module = compile(root, folder.path(), &name)?;
        let bytes = std::fs::read(&module).map_err(|e| format!("{}: {e}", module.display()))?;
        let entry = Entry { source_sha256: source_hash(root, &name)?, module_sha256: module_hash(&bytes), name };
        built.push((entry, bytes));
    }
    match what {
        What::Build => build(root, compiler, built),
        What::Check => check(root, &compiler, &built),
    }
}

fn build(root: &Path, compiler: String, built: Vec<(Entry, Vec<u8>)>) -> Result<String, String> {
    let spirv = root.join("spirv");
    for orphan in stems(&spirv, "spv")?.into_iter().filter(|stem| !built.iter().any(|(b, _)| b.name == *stem)) {
        let path = spirv.join(format!("{orphan}.spv"));
        println!("removing {}", path.display());
        std::fs::remove_file(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    for (entry, bytes) in &built {
        place(&spirv.join(format!("{}.spv", entry.name)), bytes)?;
    }
    let names = built.iter().map(|(entry, _)| entry.name.clone()).collect();
    place(&spirv.join("modules.rs"), list(&names).as_bytes())?;
    let count = built.len();
    let module = built.into_iter().map(|b| b.0).collect();
    let manifest = Manifest { compiler, flags: FLAGS.map(String::from).to_vec(), module };
    let text = toml::to_string(&manifest).map_err(|e| e.to_string())?;
    place(&Manifest::path(root), text.as_bytes())?;
    Ok(format!("{count} modules built"))
}

fn check(root: &Path, compiler: &str, built: &[(Entry, Vec<u8>)]) -> Result<String, String> {
    let constants = std::fs::read_to_string(root.join(CONSTANTS)).map_err(|e| format!("{CONSTANTS}: {e}"))?;
    let mut wrong = faults(root)?;
    if constants != eyebox_kernels::shared::glsl() {
        wrong.push(format!("{CONSTANTS} differs from the output of kernels/shared.rs"));
    }
    let manifest = Manifest::read(root)?;
    if manifest.compiler != compiler {
        // Another compiler may give other bytes. The hashes have been checked, but the bytes cannot be.
        wrong.push(format!(
            "spirv/manifest.toml: built by {:?}, but the installed compiler is {compiler:?}",
            manifest.compiler
        ));
    } else {
        for (entry, bytes) in built {
            let path = root.join("spirv").join(format!("{}.spv", entry.name));
            if std::fs::read(&path).is_ok_and(|b| b != *bytes) {
                wrong.push(format!("spirv/{}.spv differs from what its source gives", entry.name));
            }
        }
    }
    if wrong.is_empty() { Ok(format!("{} modules match their sources", built.len())) } else { Err(wrong.join("\n")) }
}

/// Writes a second file next to the file and then renames it. A file with the same contents is left alone.
fn place(path: &Path, bytes: &[u8]) -> Result<(), String> {
    if std::fs::read(path).is_ok_and(|b| b == bytes) {
        return Ok(());
    }
    let beside = path.with_extension("new");
    let done = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    done.map_err(|e| format!("{}: {e}", path.display()))
}

fn compile(root: &Path, folder: &Path, name: &str) -> Result<PathBuf, String> {
    let module = folder.join(format!("{name}.spv"));
    let kernels = root.join("kernels");
    let (source, define) = source_of(name);
    let source = kernels.join(format!("{source}.comp"));
    let define = define.map(|d| format!("-D{d}"));
    let mut include = std::ffi::OsString::from("-I");
    include.push(&kernels);
    call(Command::new("glslangValidator").args(FLAGS).args(define).arg(include).arg("-o").arg(&module).arg(source))?;
    call(Command::new("spirv-val").args(["--target-env", "vulkan1.2"]).arg(&module))?;
    Ok(module)
}

fn version() -> Result<String, String> {
    let text = call(Command::new("glslangValidator").arg("--version"))?;
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

fn call(command: &mut Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|e| {
        format!("{name}: cannot be run ({e}). On Debian or Ubuntu, run apt install glslang-tools spirv-tools")
    })?;
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() { Ok(text) } else { Err(format!("{name}: {}", text.trim())) }
}
