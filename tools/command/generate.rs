//! `eyebox completions` prints completions for shells, and `eyebox man` writes the pages of the manual.

use crate::Failure;
use clap::{Args, Command};
use eyebox::low_level::files;
use eyebox::low_level::reason;
use eyebox_lab::writable;
use std::path::PathBuf;

/// The arguments of `eyebox completions`.
#[derive(Args)]
pub struct Completions {
    /// Shell that completes the commands
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// The arguments of `eyebox man`.
#[derive(Args)]
pub struct Man {
    /// Output folder of the pages (eyebox.1, and eyebox-COMMAND.1 for each command)
    #[arg(help_heading = "Output", short, long, value_name = "OUT_DIR")]
    pub out: PathBuf,
}

/// Prints the completions of this command line for the shell.
pub fn completions(args: &Completions, mut command: Command) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "eyebox", &mut text);
    println!("{}", String::from_utf8_lossy(&text).trim_end());
    Ok(())
}

/// Writes the pages of the manual.
pub fn man(args: &Man, mut command: Command) -> Result<(), Failure> {
    command.build();
    let _made = writable(&args.out)?;
    let mut pages = vec![&command];
    let mut next = 0;
    while let Some(page) = pages.get(next) {
        pages.extend(page.get_subcommands().filter(|sub| sub.get_name() != "help"));
        next += 1;
    }
    for page in pages {
        let name = page.get_display_name().unwrap_or("eyebox").to_owned();
        let mut text = Vec::new();
        let man = clap_mangen::Man::new(page.clone()).source(concat!("eyebox ", env!("CARGO_PKG_VERSION")));
        man.render(&mut text).map_err(|e| Failure::Arguments(reason!("not-written", "{name}.1: {e}")))?;
        files::write_file(&args.out.join(format!("{name}.1")), |out| out.write_all(&text))?;
    }
    Ok(())
}
