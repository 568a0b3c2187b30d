//! Chooses the terms of a display's model for a solve, which are all, some, or the ones worth their time.

use crate::Failure;
use crate::request::SolveRequest;
use crate::values::TermsOfModel;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::quality::{ColorJob, ModelWorth};
use eyebox::low_level::solve::{Levels, Settings};
use std::time::Duration;

/// Time limit for a measurement of the gains of a color's terms.
const LIMIT: Duration = Duration::from_secs(12);

impl SolveRequest<'_> {
    /// Measures the worth of each term of the display's model on the scene, color by color. An ideal display has none.
    pub fn worth(&self, engine: &mut dyn Engine) -> Result<Vec<ModelWorth>, Failure> {
        if self.colors.iter().all(|color| self.display.model(*color).is_ideal()) {
            return Ok(Vec::new());
        }
        let small = ModelWorth::display(&self.display);
        let (field, depth) = self.load(&small, engine)?;
        let base = Settings { depth, ..self.base(&small)? };
        let mut all = Vec::new();
        for color in self.colors.iter().filter(|color| field.colors.contains(color)) {
            let job = ColorJob {
                field: &field,
                color: *color,
                display: &small,
                base: base.clone(),
                levels: Levels::of(&small),
            };
            all.extend(ModelWorth::measure(&job, LIMIT, engine)?);
        }
        Ok(all)
    }

    /// Keeps the requested terms and prints the measured ones.
    pub fn choose_terms(&mut self, engine: &mut dyn Engine) -> Result<(), Failure> {
        let auto = self.options.model_terms == TermsOfModel::Auto;
        let worth = if auto { self.worth(engine)? } else { Vec::new() };
        if !self.report.json {
            worth.iter().for_each(|worth| eprintln!("display model, {}", in_words(worth)));
        }
        self.keep_terms(&worth);
        Ok(())
    }

    /// Keeps the requested terms, given their measured worth.
    pub fn keep_terms(&mut self, worth: &[ModelWorth]) {
        match &self.options.model_terms {
            TermsOfModel::All => {}
            TermsOfModel::Auto => {
                for worth in worth {
                    self.display = self.display.with_model_of(worth.color, |model| worth.apply(model));
                }
            }
            TermsOfModel::These(names) => {
                let is_kept = |name: &str| names.iter().any(|n| n == name);
                for color in &self.colors {
                    self.display = self.display.with_model_of(*color, |model| model.keep(&is_kept));
                }
            }
        }
    }
}

/// Returns the gains of the terms in one line.
pub fn in_words(worth: &ModelWorth) -> String {
    let decibels = |(term, lost): &(&str, f64)| match lost.is_nan() {
        true => format!("{term} not measured"),
        false => format!("{term} {lost:.2}"),
    };
    let terms: Vec<String> = worth.lost_db.iter().map(decibels).collect();
    let kept = worth.kept();
    let out: Vec<&str> = worth.lost_db.iter().map(|(term, _)| *term).filter(|term| !kept.contains(term)).collect();
    let out = if out.is_empty() {
        "all of them matter".into()
    } else {
        format!("--model-terms auto leaves out {}", out.join(", "))
    };
    let all = if worth.db.is_nan() { "not measured".into() } else { format!("{:.2} dB", worth.db) };
    let [height, width] = worth.size;
    let subpixels = worth
        .subpixels_db
        .zip(worth.subpixels())
        .map_or(String::new(), |(gain, count)| format!(", 2 x 2 sub-pixels {gain:+.2} dB, {count} suffice"));
    format!(
        "{}: loss without each term in dB: {}{subpixels} (solved for {height} x {width} pixels in {} steps each, seen \
         through all terms, {all} with all); {out}",
        worth.color,
        terms.join(", "),
        worth.steps
    )
}
