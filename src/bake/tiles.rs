//! Gathers tiles of a solution, on any machine that has the scene: solution, numbers of tiles → a file with their probes.
//!
//! A probe depends on its texel and on the solution alone, and cells are derived from probes in one order, so that tiles
//! that were gathered apart merge to the bits of a single bake.

use super::keeper::Pace;
use super::light::{Lighting, solved};
use super::observer::{Found, Observer};
use super::prepare::{LaidOut, Loaded};
use super::{BakeError, Solved};
use crate::accel::Accel;
use crate::config::Settings;
use crate::gather::{Probe, Tiles};
use crate::output::report::StageClock;
use crate::output::solved::{self, SolutionHead, TilesHead};
use crate::output::{OutputError, OutputSet, PartError, TileSet};
use crate::progress::{Cancelled, Progress, Stage};
use crate::warning::Warning;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Least time between two times that unfinished tiles are kept.
const BETWEEN_STATES: Duration = Duration::from_secs(60);

/// Texels with their probes.
pub(super) type Probes = Vec<(u32, Probe)>;

/// Which tiles to gather.
#[derive(Clone, Debug, Default)]
pub struct GatherSettings {
    /// Folder of the solution.
    pub folder: PathBuf,
    /// The tiles; all if none are named.
    pub tiles: Option<TileSet>,
    /// The file to write; one in the folder of the solution if none is given.
    pub out: Option<PathBuf>,
    /// The scene file, if it is not where it was solved.
    pub scene: Option<PathBuf>,
    /// Least time between two times that unfinished tiles are kept, if not a minute.
    pub keep_every: Option<Duration>,
}

/// What a gather came to.
pub struct GatheredTiles {
    /// What the solution is about.
    pub solution: SolutionHead,
    /// Tiles that were gathered now.
    pub gathered: TileSet,
    /// Where they are; none if all that were asked for were there already.
    pub file: Option<PathBuf>,
}

/// How far the tiles of a solution are.
pub struct TilesDone {
    /// What the solution is about.
    pub solution: SolutionHead,
    /// Tiles that lie in its folder.
    pub done: TileSet,
    /// What is wrong with files there.
    pub faults: Vec<PartError>,
}

/// Looks which tiles of its solution a folder holds, whichever version of the baker they are of.
pub fn tiles_done(folder: &Path) -> Result<TilesDone, BakeError> {
    let solution = solved::read_head(folder)?;
    let (mut done, mut faults) = (TileSet::default(), Vec::new());
    for file in solved::tile_files(folder)? {
        match solved::read_tiles_head(&file) {
            Ok(Some(head)) => match head.check(&solution, &file) {
                Ok(()) => done = done.with(&head.tiles),
                Err(fault) => faults.push(fault),
            },
            Ok(None) => {}
            Err(fault) => faults.push(fault),
        }
    }
    Ok(TilesDone { solution, done, faults })
}

/// Gathers those of the tiles that are not there yet.
pub fn gather_tiles(settings: &GatherSettings, progress: &dyn Progress) -> Result<GatheredTiles, BakeError> {
    let clock = StageClock::start();
    let (solution, mut found): (SolutionHead, Found) = solved::read_solution(&settings.folder)?;
    let asked = asked(settings, &solution)?;
    let file = match &settings.out {
        Some(file) => file.clone(),
        None => solved::tiles_path(&settings.folder, &asked)?,
    };
    let (done, kept) = already(&file, &solution, progress)?;
    // A file of one's own is meant to hold what was asked for, whatever others hold.
    let elsewhere = if settings.out.is_some() { TileSet::default() } else { tiles_done(&settings.folder)?.done };
    let gathered = asked.without(&elsewhere).without(&done);
    if gathered.is_empty() {
        let file = settings.out.is_some().then_some(file);
        return Ok(GatheredTiles { solution, gathered, file });
    }
    // What would stop the tiles from being written, stops them now.
    let folder = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let _folder = OutputSet::open(folder, &[], true)?;

    let (_, loaded, laid_out) = scene_of(&solution, &settings.folder, settings.scene.as_deref(), &clock, progress)?;
    let LaidOut { atlas, texels, .. } = &laid_out;
    let whole = done.with(&gathered);
    let is_whole: Vec<bool> = (0..solution.tiles).map(|tile| whole.contains(tile)).collect();
    let wanted = Tiles::new(atlas, texels).of_texel.iter().map(|&tile| is_whole[tile as usize]).collect();
    let accel = clock.measure(Stage::Accel, || Accel::build(&loaded.scene));
    found.probes.clone_from(&kept);

    let gather = |solved: Solved, _: &mut dyn Observer| {
        let mut keeper = Kept::new(&file, &solution, &kept, &done, settings.keep_every, progress);
        let probes = solved.probes(wanted, |so_far| keeper.look(so_far))?;
        if progress.is_cancelled() {
            return Err(BakeError::from(Cancelled));
        }
        clock.measure(Stage::Output, || write(&file, &solution, &whole, &probes, &[]))?;
        Ok(())
    };
    let (groups, error) = (&loaded.groups, settings_of(&solution, &settings.folder)?.error);
    let mut given = Given(Some(found));
    let lighting = Lighting { accel: &accel, atlas, texels, groups, error, first: None, clock: &clock, progress };
    solved(&lighting, &mut given, gather)?;
    progress.report(Stage::Output, 1.0);
    Ok(GatheredTiles { solution, gathered, file: Some(file) })
}

/// The tiles that are asked for, which the solution must have.
fn asked(settings: &GatherSettings, solution: &SolutionHead) -> Result<TileSet, PartError> {
    let all = TileSet::all(solution.tiles);
    let asked = settings.tiles.clone().unwrap_or_else(|| all.clone());
    let beyond = asked.without(&all);
    let count = solution.tiles;
    if beyond.is_empty() { Ok(asked) } else { Err(PartError::NoSuchTiles { asked: beyond, count }) }
}

/// What the file holds already: whole tiles, and all probes. A damaged one is replaced.
fn already(file: &Path, solution: &SolutionHead, progress: &dyn Progress) -> Result<(TileSet, Probes), PartError> {
    match solved::read_tiles(file, solution) {
        Ok(held) => Ok(held.map(|(head, probes)| (head.tiles, probes)).unwrap_or_default()),
        Err(PartError::Damaged { .. }) => {
            let message = "it is damaged, and its tiles are gathered again";
            progress.warn(&Warning::new("damaged_tiles", file.display().to_string(), message));
            Ok(Default::default())
        }
        Err(other) => Err(other),
    }
}

/// Settings that a solution was made with.
pub(super) fn settings_of(solution: &SolutionHead, folder: &Path) -> Result<Settings, PartError> {
    let damaged = |_| PartError::Damaged { path: solved::solution_path(folder), remedy: "solve again with --force" };
    serde_json::from_value(solution.settings.clone()).map_err(damaged)
}

/// Reads the scene of a solution and lays it out as it was. With where the scene is.
pub(super) fn scene_of(
    solution: &SolutionHead,
    folder: &Path,
    said: Option<&Path>,
    clock: &StageClock,
    progress: &dyn Progress,
) -> Result<(PathBuf, Loaded, LaidOut), BakeError> {
    let settings = settings_of(solution, folder)?;
    let path = solved::scene_of(solution, said)?;
    let mut loaded = Loaded::read(&path, &settings, clock, progress)?;
    if loaded.hash != solution.key.scene() {
        return Err(PartError::OtherScene(path).into());
    }
    let laid_out = loaded.lay_out(&settings, clock, progress)?;
    if laid_out.fingerprint != solution.layout {
        return Err(PartError::Layout(path).into());
    }
    Ok((path, loaded, laid_out))
}

/// Gives what was found before, and does not look.
struct Given(Option<Found>);

impl Observer for Given {
    fn found_before(&mut self) -> Found {
        self.0.take().unwrap_or_default()
    }
}

/// Writes whole tiles with `probes`, and those of `before` that are not among them, by texel.
fn write(
    file: &Path,
    solution: &SolutionHead,
    whole: &TileSet,
    probes: &[(u32, Probe)],
    before: &[(u32, Probe)],
) -> Result<(), OutputError> {
    let mut by_texel: BTreeMap<u32, &Probe> = BTreeMap::new();
    for (texel, probe) in before.iter().chain(probes) {
        let held = by_texel.entry(*texel).or_insert(probe);
        *held = held.further(probe).unwrap_or(probe);
    }
    let content: Vec<(u32, &Probe)> = by_texel.into_iter().collect();
    solved::write_tiles(file, &TilesHead::new(solution, whole.clone()), &content)
}

/// Keeps the probes of tiles that are not whole yet.
struct Kept<'a> {
    file: &'a Path,
    solution: &'a SolutionHead,
    before: &'a [(u32, Probe)],
    done: &'a TileSet,
    /// When to keep them next; none if they cannot be kept.
    pace: Option<Pace>,
    progress: &'a dyn Progress,
}

impl<'a> Kept<'a> {
    fn new(
        file: &'a Path,
        solution: &'a SolutionHead,
        before: &'a [(u32, Probe)],
        done: &'a TileSet,
        every: Option<Duration>,
        progress: &'a dyn Progress,
    ) -> Self {
        let pace = Some(Pace::every(every.unwrap_or(BETWEEN_STATES)));
        Self { file, solution, before, done, pace, progress }
    }

    fn look(&mut self, so_far: &[(u32, Probe)]) {
        let Some(pace) = self.pace.as_mut().filter(|pace| pace.is_due()) else { return };
        let start = Instant::now();
        match write(self.file, self.solution, self.done, so_far, self.before) {
            Ok(()) => {
                pace.done(start);
                self.progress.kept(self.file);
            }
            Err(error) => {
                self.pace = None;
                let message = format!("{error}; the gather goes on and tries to write its result");
                self.progress.warn(&Warning::new("checkpoint", self.file.display().to_string(), message));
            }
        }
    }
}
