//! `--settings` and `--set` read the settings that belong to an experiment, and not to one call.

use crate::Failure;
use crate::table;
pub use crate::table::{Table, TableOf};
use clap::Args;
use eyebox::low_level::error::Reason;
use eyebox::low_level::produce::GivenSettings;
use eyebox::low_level::reason;
use eyebox::low_level::session::Policy;
use eyebox::low_level::solve::{RefineSettings, Settings};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Settings of an experiment, in every command that solves or refines.
#[derive(Args, Clone, Default)]
pub struct ExperimentArgs {
    /// Settings file in TOML (docs/settings.md). With -, print the settings of this call and compute nothing
    #[arg(help_heading = "Settings", long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// One setting, such as optimizer=adam or refine.pupils=4
    #[arg(help_heading = "Settings", long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// The settings after they were read.
    #[arg(skip)]
    read: OnceLock<GivenSettings>,
}

/// The jump after which a refinement begins again.
#[derive(Deserialize)]
#[serde(untagged)]
enum Restart {
    Diameters(f64),
    Word(String),
}

impl ExperimentArgs {
    /// Returns the settings of the file with the single settings over it. The file is read once.
    pub fn given(&self) -> Result<&GivenSettings, Failure> {
        if let Some(read) = self.read.get() {
            return Ok(read);
        }
        let file = self.settings.as_deref().filter(|file| *file != Path::new("-"));
        let mut given = file.map_or_else(|| Ok(GivenSettings::default()), GivenSettings::load)?;
        self.set.iter().try_for_each(|one| given.set(one))?;
        Ok(self.read.get_or_init(|| given))
    }

    /// Returns whether the settings are printed and nothing is computed.
    pub fn is_printed(&self) -> bool {
        self.settings.as_deref() == Some(Path::new("-"))
    }

    /// Reads a table of the settings.
    pub fn table<T: Args>(&self, name: &'static str) -> Result<T, Failure> {
        table::read(self.given()?, name)
    }

    /// Prints the settings of refinements and these tables for `--settings -`. Returns whether it did.
    pub fn printed(&self, tables: &[TableOf]) -> Result<bool, Failure> {
        if self.is_printed() {
            print(None, self.given()?, tables)?;
        }
        Ok(self.is_printed())
    }

    /// Prints these tables alone for `--settings -`. Returns whether it did.
    pub fn printed_tables(&self, tables: &[TableOf]) -> Result<bool, Failure> {
        if self.is_printed() {
            print_tables(self.given()?, tables)?;
        }
        Ok(self.is_printed())
    }

    /// Returns the settings of refinements.
    pub fn refinement(&self) -> Result<RefineSettings, Failure> {
        Ok(self.given()?.refinement()?)
    }

    /// Returns how a live session refines and begins again.
    pub fn policy(&self) -> Result<Policy, Failure> {
        let given = self.given()?;
        let restart = match given.of_sessions("restart")? {
            None => Policy::default().restart,
            Some(Restart::Diameters(diameters)) if diameters >= 0.0 => diameters,
            Some(Restart::Word(word)) if word == "never" => f64::INFINITY,
            Some(_) => return Err(Failure::Arguments(no_restart())),
        };
        Ok(Policy { restart, steering: given.refinement()? })
    }
}

fn no_restart() -> Reason {
    reason!("restart", "refine.restart: expected a number of pupil diameters, 0 or more, or \"never\"")
}

/// Prints settings and tables as a file that `--settings` reads.
pub fn print(solve: Option<&Settings>, given: &GivenSettings, tables: &[TableOf]) -> Result<(), Failure> {
    println!("{}", given.effective(solve)?.trim_end());
    if !tables.is_empty() {
        println!();
    }
    print_tables(given, tables)
}

fn print_tables(given: &GivenSettings, tables: &[TableOf]) -> Result<(), Failure> {
    let mut all = Map::new();
    for table in tables {
        all.insert(table.0.to_owned(), Value::Object(table::effective(given, *table)?));
    }
    let text = GivenSettings::to_toml(&all)?;
    if !text.trim().is_empty() {
        println!("{}", text.trim_end());
    }
    Ok(())
}
