//! The part of a bake that is done once, before its tiles are gathered on any machines: scene, settings → solution.

use super::keeper::Pace;
use super::light::{Lighting, solved};
use super::observer::{Counts, Draft, Found, FoundSoFar, Observer};
use super::prepare::{LaidOut, Loaded};
use super::{BakeError, Solved};
use crate::accel::Accel;
use crate::config::Settings;
use crate::gather::Tiles;
use crate::output::checkpoint::{self, Key};
use crate::output::report::StageClock;
use crate::output::solved::{self, SolutionHead};
use crate::output::{OutputSet, OutputSettings};
use crate::progress::{Cancelled, Progress, Stage};
use crate::warning::Warning;
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

/// Least time between two checkpoints.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(60);

/// A folder with a solution.
pub struct Solving {
    /// What the solution is about.
    pub solution: SolutionHead,
    /// True if it was there already.
    pub existed: bool,
}

/// Lights the scene in `path` as far as its radiosity solution, which it writes to the folder of the settings. A solution
/// of the same scene with the same settings that is there already stays; one of anything else is replaced by force only.
pub fn solve(path: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Solving, BakeError> {
    let clock = StageClock::start();
    let OutputSettings { folder, force, .. } = &settings.output;
    let earlier = if !force && solved::is_solved(folder) { Some(solved::read_head(folder)?) } else { None };
    // What would stop the solution from being written, stops it now.
    let _folder = earlier.is_none().then(|| OutputSet::open(folder, &[], true)).transpose()?;
    let mut loaded = Loaded::read(path, settings, &clock, progress)?;
    let key = loaded.key(settings);
    if let Some(solution) = earlier {
        solution.check_same(&key, folder)?;
        return Ok(Solving { solution, existed: true });
    }
    let before = found_before(folder, &key, &mut loaded, progress);
    let LaidOut { atlas, texels, fingerprint } = loaded.lay_out(settings, &clock, progress)?;
    let head = SolutionHead {
        key: key.clone(),
        identity: String::new(),
        tiles: Tiles::new(&atlas, &texels).count,
        texels: texels.len() as u64,
        layout: fingerprint,
        scene: path.to_path_buf(),
        settings: json!(settings),
    };
    let accel = clock.measure(Stage::Accel, || Accel::build(&loaded.scene));
    let mut halfway = Halfway {
        folder,
        key,
        layout: fingerprint,
        pace: Some(Pace::every(BETWEEN_CHECKPOINTS)),
        before: before.filter(|(layout, _)| *layout == fingerprint).map(|(_, found)| found),
        progress,
    };
    let (groups, error) = (&loaded.groups, settings.error);
    let write = |solved: Solved, _: &mut dyn Observer| {
        if progress.is_cancelled() {
            return Err(BakeError::from(Cancelled));
        }
        let written = clock.measure(Stage::Output, || solved::write_solution(folder, head, &solved.found()));
        Ok(written?)
    };
    let (accel, atlas, texels, clock) = (&accel, &atlas, &texels, &clock);
    let lighting = Lighting { accel, atlas, texels, groups, error, first: None, clock, progress };
    let solution = solved(&lighting, &mut halfway, write)?;
    checkpoint::remove(folder);
    if *force {
        solved::remove_foreign_tiles(folder, &solution);
    }
    progress.report(Stage::Output, 1.0);
    Ok(Solving { solution, existed: false })
}

/// What an interrupted solve of the same scene had found. Anything else that is there is replaced.
fn found_before(folder: &Path, key: &Key, loaded: &mut Loaded, progress: &dyn Progress) -> Option<(u32, Found)> {
    checkpoint::read(folder, key).unwrap_or_else(|error| {
        loaded.warn(Warning::new("checkpoint_unused", "checkpoint.lk", format!("{error:#}; it is not used")), progress);
        None
    })
}

/// Keeps direct light until the solution is there.
struct Halfway<'a> {
    folder: &'a Path,
    key: Key,
    layout: u32,
    /// When a checkpoint is due; none if they cannot be written.
    pace: Option<Pace>,
    before: Option<Found>,
    progress: &'a dyn Progress,
}

impl Observer for Halfway<'_> {
    fn found_before(&mut self) -> Found {
        self.before.take().unwrap_or_default()
    }

    fn found(&mut self, so_far: &FoundSoFar, _: &Counts, _: &mut dyn FnMut() -> Option<Draft>) {
        let Some(pace) = self.pace.as_mut().filter(|pace| pace.is_due()) else { return };
        let start = Instant::now();
        match checkpoint::write(self.folder, &self.key, &(self.layout, so_far)) {
            Ok(()) => {
                pace.done(start);
                self.progress.kept(&checkpoint::path(self.folder));
            }
            Err(error) => {
                self.pace = None;
                let message = format!("{error}; the solve goes on without");
                self.progress.warn(&Warning::new("checkpoint", "checkpoint.lk", message));
            }
        }
    }
}
