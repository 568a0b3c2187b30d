//! Solves a far field in tiles on several machines.

use super::ProduceError;
use super::job::{SceneJob, TilesPlan, TilesRequest};
use super::tiles::Prepared;
use crate::engine::Engine;
use crate::hologram::{TileVersion, Tiles};
use crate::optics::Color;
use crate::tiled::{self, Job, Waits};
use eyebox_base::reason;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A far field whose regions several machines solve, each visit on any free machine, in one file.
///
/// One machine would write the same bytes. Visits are numbered in the order in which one machine takes them, color
/// after color. Each visit waits for those [before](Self::after) it with which its region shares pixels.
pub struct TilePieces {
    prepared: Prepared,
    colors: Vec<Color>,
    work: Value,
    out: PathBuf,
    /// The file, once it was begun.
    begun: OnceLock<OpenedTiles>,
}

struct OpenedTiles {
    tiles: Tiles,
    /// The dependencies of each color's visits.
    waits: Vec<Waits>,
}

impl TilePieces {
    /// Prepares a file at `out`, which may exist, and loads the scene.
    ///
    /// # Errors
    /// The errors of [`solve_scene`](super::solve_scene) for a job in tiles.
    pub fn new(job: &SceneJob, request: &TilesRequest, out: &Path, engine: &dyn Engine) -> Result<Self, ProduceError> {
        job.check_usual()?;
        job.check_one_by_one()?;
        if job.scenes.len() != 1 {
            return Err(ProduceError::Job(reason!("far-field-one-scene", "a far field in tiles needs one scene")));
        }
        let prepared = Prepared::new(job, request)?;
        let mut work = prepared.work(job, request, engine);
        // Tiles are written to places where a single machine does not look for them, so it must not continue this file.
        work["pieces"] = true.into();
        Ok(Self { prepared, colors: job.colors.clone(), work, out: out.to_path_buf(), begun: OnceLock::new() })
    }

    /// Begins the file with its exposures, unless it exists. It replaces a finished hologram.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if another job is unfinished there, and the errors of [`solve_scene`](super::solve_scene).
    pub fn begin(&self, job: &SceneJob, request: &TilesRequest, engine: &mut dyn Engine) -> Result<(), ProduceError> {
        if !super::tiles::is_under_way(&self.out, &self.work)? {
            drop(self.prepared.create(job, request, &self.out, self.work.clone(), engine)?);
        }
        self.begun().map(|_| ())
    }

    /// Returns the plan of a solve by one machine.
    pub fn plan(&self) -> &TilesPlan {
        &self.prepared.plan
    }

    /// Returns the number of visits of all colors.
    pub fn visits(&self) -> usize {
        self.colors.len() * self.prepared.plan.visits
    }

    /// Returns the visits for which a visit waits, in ascending order.
    ///
    /// # Errors
    /// The errors of [`visit`](Self::visit).
    pub fn after(&self, visit: usize) -> Result<Vec<usize>, ProduceError> {
        let (color, k) = self.place(visit)?;
        let before = visit - k;
        Ok(self.begun()?.waits[color].after(k).into_iter().map(|i| before + i).collect())
    }

    /// Returns the visits in the longest chain of dependent visits. No number of machines is faster than this chain.
    ///
    /// # Errors
    /// The errors of [`visit`](Self::visit).
    pub fn longest_chain(&self) -> Result<usize, ProduceError> {
        Ok(self.begun()?.waits.iter().map(Waits::longest).max().unwrap_or(0))
    }

    /// Returns true if a visit is done.
    ///
    /// # Errors
    /// The errors of [`visit`](Self::visit).
    pub fn is_done(&self, visit: usize) -> Result<bool, ProduceError> {
        self.place(visit)?;
        Ok(self.begun()?.tiles.has_part(visit as u64 + 1))
    }

    /// Takes a visit, unless it is done, and returns true if it was taken now. All visits for which it waits must be
    /// done.
    ///
    /// # Errors
    /// [`ProduceError::Job`] for a visit that does not exist, before the file is [begun](Self::begin), and for a file
    /// of another job. Also the errors of [`solve_scene`](super::solve_scene).
    pub fn visit(&self, visit: usize, engine: &mut dyn Engine) -> Result<bool, ProduceError> {
        let (color, k) = self.place(visit)?;
        let OpenedTiles { tiles, waits } = self.begun()?;
        let (part, waits) = (visit as u64 + 1, &waits[color]);
        if tiles.has_part(part) {
            return Ok(false);
        }
        let before = (visit - k) as u64;
        let versions: Vec<_> = waits.versions(k, before).collect();
        let place = |[row, column]: [usize; 2]| [color, row, column];
        let found = tiles.as_found(versions.iter().map(|(tile, version)| (place(*tile), *version)).collect());
        let job = self.prepared.job(color, before);
        let made = match tiled::visit(&job, k, &found, engine) {
            Ok(made) => made,
            // Another machine took it in the meantime, and removed its input.
            Err(_) if tiles.has_part(part) => return Ok(false),
            Err(error) => return Err(error.into()),
        };
        let last = |tile: [usize; 2]| waits.is_last(tile, k);
        tiles.leave(part, color, [made.at, made.size], &made.phases, &last)?;
        // If no light enters from around a region, only the next visit to a tile reads the output of the one before.
        if job.model.is_none() {
            for (tile, version) in versions {
                if let TileVersion::Of(part) = version {
                    tiles.forget(part, place(tile))?;
                }
            }
        }
        Ok(true)
    }

    /// Marks the far field at `out` as finished. Its tiles are in their places already.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if some visits are missing, and [`ProduceError::Hologram`] if the file cannot be used.
    pub fn finish(out: &Path) -> Result<(), ProduceError> {
        if !Tiles::open(out)?.is_whole() {
            return Err(ProduceError::Job(reason!(
                "regions-not-solved",
                "{}: some regions are not solved yet",
                out.display()
            )));
        }
        Ok(Tiles::resume(out)?.finish()?)
    }

    fn place(&self, visit: usize) -> Result<(usize, usize), ProduceError> {
        if visit >= self.visits() {
            return Err(ProduceError::Job(reason!(
                "no-such-visit",
                "visit {visit}: out of range, there are {} visits",
                self.visits()
            )));
        }
        Ok((visit / self.prepared.plan.visits, visit % self.prepared.plan.visits))
    }

    fn begun(&self) -> Result<&OpenedTiles, ProduceError> {
        if let Some(begun) = self.begun.get() {
            return Ok(begun);
        }
        if !super::tiles::is_under_way(&self.out, &self.work)? {
            return Err(ProduceError::Job(reason!("not-begun", "{}: the far field was not begun", self.out.display())));
        }
        let tiles = Tiles::open(&self.out)?;
        let about = tiles.about();
        let of = |color: usize| {
            let Job { schedule, size, model, .. } = self.prepared.job(color, 0);
            Waits::new(schedule, size, [about.height, about.width], tiles.side(), model)
        };
        let waits = (0..self.colors.len()).map(of).collect();
        // A faster thread made the same value.
        Ok(self.begun.get_or_init(|| OpenedTiles { tiles, waits }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::{Display, ModelOf, ModelTerms};
    use crate::produce::sequence::tests::contents;
    use crate::produce::solve_scene;
    use crate::solve::{Flow, Settings};

    fn far_field(terms: Option<ModelTerms>) -> Display {
        let far = Display::preset("far-field").unwrap();
        let model = terms.map(|terms| (ModelOf::Green, terms)).into_iter().collect();
        Display { height: 160, width: 192, model, ..far }
    }

    /// Several processes write the bytes of one machine in another order of visits.
    ///
    /// They take the last of the possible visits first, and one of them dies after each of its first. The displays are
    /// ideal, or have crosstalk that reaches into a region from around it.
    #[test]
    fn pieces_are_the_far_field() {
        let crosstalk = ModelTerms { crosstalk: Some([[1.2, 2.03]; 4].map(Into::into)), ..ModelTerms::default() };
        for display in [far_field(None), far_field(Some(crosstalk))] {
            let here = tempfile::tempdir().unwrap();
            let request = TilesRequest { passes: 2, picture: 32, ..TilesRequest::default() };
            let eyebox = display.eyebox_min();
            let job = SceneJob {
                colors: vec![Color::Green],
                diameter: Some([eyebox / 8.0, eyebox / 6.0]),
                settings: Settings { frames: 2, steps: 1, seed: 5, ..Settings::default() },
                force: true,
                tiles: Some(request),
                ..SceneJob::new("builtin:plane?depth=0.5", &display)
            };
            let mut engine = CpuEngine::new();
            let whole = here.path().join("whole.zarr");
            solve_scene(&job, Some(&whole), &mut engine, &mut |_| Flow::Continue).unwrap();

            let out = here.path().join("pieces.zarr");
            let who = [0, 1].map(|_| TilePieces::new(&job, &request, &out, &engine).unwrap());
            let is = |error: ProduceError, code: &str| matches!(error, ProduceError::Job(r) if r.code() == code);
            assert!(who[0].visit(0, &mut engine).is_err_and(|e| is(e, "not-begun")));
            who[0].begin(&job, &request, &mut engine).unwrap();
            who[1].begin(&job, &request, &mut engine).unwrap();
            let visits = who[0].visits();
            assert!(who[0].longest_chain().unwrap() < visits, "regions side by side");
            // One machine neither continues nor changes it.
            let other = solve_scene(&job, Some(&out), &mut engine, &mut |_| Flow::Continue);
            assert!(other.is_err_and(|e| is(e, "another-job")));
            let mut taken = Vec::new();
            while taken.len() < visits {
                let may = |v: &usize| who[0].after(*v).unwrap().iter().all(|before| who[0].is_done(*before).unwrap());
                let next = (0..visits).rev().filter(|v| !who[0].is_done(*v).unwrap()).find(may).unwrap();
                if taken.len() < 2 {
                    // The process that died had written a tile of this visit.
                    std::fs::create_dir_all(out.join("staged")).unwrap();
                    std::fs::write(out.join("staged/.eyebox-00dead00.part"), "half").unwrap();
                }
                assert!(TilePieces::finish(&out).is_err());
                assert!(who[taken.len() % 2].visit(next, &mut engine).unwrap());
                assert!(!who[0].visit(next, &mut engine).unwrap(), "it is done");
                taken.push(next);
            }
            assert!(taken.windows(2).any(|pair| pair[0] > pair[1]), "another order: {taken:?}");
            assert!(who[0].visit(visits, &mut engine).is_err());
            TilePieces::finish(&out).unwrap();
            assert_eq!(contents(&out), contents(&whole));
        }
    }
}
