//! From the tiles of a solution to the results of a bake: pages, lit scene, report. The same stages as in a single bake,
//! from a checkpoint that holds all probes.

use super::observer::Found;
use super::results::Results;
use super::tiles::{Probes, scene_of, settings_of};
use super::{BakeError, Report, finish};
use crate::audit::Effort;
use crate::gather::Probe;
use crate::output::report::StageClock;
use crate::output::solved::{self, SolutionHead};
use crate::output::{OutputSettings, PartError, Precision, TileSet};
use crate::progress::Progress;
use crate::units::Quantity;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;

/// What to merge, and how the results should be.
#[derive(Clone, Debug, Default)]
pub struct MergeSettings {
    /// Folders of the solution and its tiles, and files of tiles.
    pub parts: Vec<PathBuf>,
    /// Folder of the results; named after the scene if none is given.
    pub out: Option<PathBuf>,
    /// The scene file, if it is not where it was solved.
    pub scene: Option<PathBuf>,
    /// What a texel of the EXR pages means.
    pub quantity: Quantity,
    /// How it is stored.
    pub precision: Precision,
    /// How much may be spent on finding out whether the error was met.
    pub audit: Effort,
    /// True: results that exist are replaced.
    pub force: bool,
}

/// Merges tiles and writes the results. With the folder that they are in.
pub fn merge(settings: &MergeSettings, progress: &dyn Progress) -> Result<(PathBuf, Report), BakeError> {
    let clock = StageClock::start();
    let (files, folders) = solved::parts_in(&settings.parts)?;
    let (folder, solution, mut found) = the_solution(&folders, &settings.parts)?;
    let scene = solved::scene_of(&solution, settings.scene.as_deref())?;
    let mut baked = settings_of(&solution, &folder)?;
    baked.output = OutputSettings {
        folder: settings.out.clone().unwrap_or_else(|| OutputSettings::default_folder(&scene)),
        force: settings.force,
        groups: baked.output.groups,
        quantity: settings.quantity,
        precision: settings.precision,
    };
    baked.audit = settings.audit;
    let results = Results::open(&scene, &baked)?;
    let groups = found.direct.as_ref().map_or(0, |direct| direct.groups.groups());
    found.probes = all_probes(&files, &solution, groups, folder)?;

    let folder = baked.output.folder.clone();
    let said = settings.scene.as_deref();
    let (scene, loaded, laid_out) = scene_of(&solution, &folder, said, &clock, progress)?;
    let report = finish(&scene, &baked, loaded, &laid_out, Some(found), results, &clock, progress)?;
    Ok((folder, report))
}

/// The one solution that lies in the folders, with the first folder that has it.
fn the_solution(folders: &[PathBuf], parts: &[PathBuf]) -> Result<(PathBuf, SolutionHead, Found), PartError> {
    let Some(first) = folders.first() else {
        return Err(PartError::NoSolution(parts.first().cloned().unwrap_or_default()));
    };
    let (solution, found): (SolutionHead, Found) = solved::read_solution(first)?;
    for other in &folders[1..] {
        if solved::read_head(other)?.identity != solution.identity {
            return Err(PartError::TwoSolutions(solved::solution_path(first), solved::solution_path(other)));
        }
    }
    Ok((first.clone(), solution, found))
}

/// The probes of all tiles. Fails if a tile is missing, or if two files do not agree.
fn all_probes(files: &[PathBuf], solution: &SolutionHead, groups: usize, folder: PathBuf) -> Result<Probes, PartError> {
    let mut held: Vec<TileSet> = Vec::with_capacity(files.len());
    let mut probes: BTreeMap<u32, (usize, Probe)> = BTreeMap::new();
    for (i, file) in files.iter().enumerate() {
        let read = solved::read_tiles::<Probes>(file, solution)?;
        let (head, content) = read.ok_or_else(|| PartError::Nothing(file.clone()))?;
        held.push(head.tiles);
        for (texel, probe) in content {
            if u64::from(texel) >= solution.texels || probe.groups.len() != groups {
                let remedy = "remove it and gather its tiles again";
                return Err(PartError::Damaged { path: file.clone(), remedy });
            }
            match probes.entry(texel) {
                Entry::Vacant(place) => {
                    place.insert((i, probe));
                }
                Entry::Occupied(mut place) => {
                    // Cells of two tiles may want the same probe with more and with less care.
                    let Some(further) = place.get().1.further(&probe).cloned() else {
                        let part = |i: usize| (files[i].clone(), held[i].clone());
                        return Err(PartError::Conflict(part(place.get().0), part(i)));
                    };
                    place.get_mut().1 = further;
                }
            }
        }
    }
    let done = held.iter().fold(TileSet::default(), |all, tiles| all.with(tiles));
    let missing = TileSet::all(solution.tiles).without(&done);
    if !missing.is_empty() {
        return Err(PartError::Missing { folder, missing, count: solution.tiles });
    }
    Ok(probes.into_iter().map(|(texel, (_, probe))| (texel, probe)).collect())
}
