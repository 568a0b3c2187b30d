//! Published numbers, from a CSV file.

use crate::Failure;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A box of a published box plot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Published {
    /// Method, as its paper writes it.
    pub method: String,
    /// Group of pupils.
    pub category: String,
    /// Number of scores.
    pub n: u64,
    /// Mean, dB.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Lower quartile.
    pub q25: f64,
    /// Upper quartile.
    pub q75: f64,
    /// Worst.
    pub min: f64,
    /// Best.
    pub max: f64,
    /// Standard deviation.
    pub std: f64,
}

impl Published {
    /// All rows of a file.
    pub fn read(file: &Path) -> Result<Vec<Self>, Failure> {
        let wrong = |reason: String| Failure::Asked(format!("{}: {}", file.display(), reason.replace('\n', " ")));
        let text = std::fs::read(file).map_err(|e| wrong(e.to_string()))?;
        let rows: Result<Vec<Self>, _> =
            csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&text[..]).deserialize().collect();
        let rows =
            rows.map_err(|e| wrong(format!("{e}; the columns are method,category,n,mean,median,q25,q75,min,max,std")))?;
        let numbers = |r: &Self| [r.mean, r.median, r.q25, r.q75, r.min, r.max, r.std];
        match rows.iter().position(|r| numbers(r).iter().any(|v| !v.is_finite())) {
            Some(row) => Err(wrong(format!("row {} has a number that is not finite", row + 1))),
            None if rows.is_empty() => Err(wrong("it has no rows".into())),
            None => Ok(rows),
        }
    }

    /// Whether it is about this method and group.
    pub fn is_of(&self, method: &str, group: &str) -> bool {
        self.method.eq_ignore_ascii_case(method) && self.category.eq_ignore_ascii_case(group)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_and_mistakes_are_one_line() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("p.csv");
        let head = "method,category,n,mean,median,q25,q75,min,max,std\n";
        std::fs::write(&file, format!("{head}SLFH,Random pupils,70,28.6,29.4,24.8,30.9,22.9,37.7,3.8\n")).unwrap();
        let rows = Published::read(&file).unwrap();
        assert!(rows[0].is_of("slfh", "Random pupils") && !rows[0].is_of("stft", "Random pupils"));
        for wrong in [
            head.to_string(),
            format!("{head}SLFH,x,70,a,1,1,1,1,1,1\n"),
            "a,b\n1,2\n".into(),
            "\u{0}".into(),
            format!("{head}SLFH,x,70,NaN,1,1,1,1,1,1\n"),
        ] {
            std::fs::write(&file, wrong).unwrap();
            let said = Published::read(&file).unwrap_err().to_string();
            assert!(said.contains("p.csv") && said.lines().count() == 1, "{said}");
        }
        assert!(Published::read(&here.path().join("none.csv")).is_err());
    }
}
