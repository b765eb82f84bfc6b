//! What machines hand to each other: a solution, which is never changed, and the tiles gathered from it.
//!
//! A solution's identity is a hash of its content and of what it belongs to. Tiles name the solution that they were
//! gathered from, and which of its tiles are whole; probes of others may stand beside, of a gather that was interrupted.
//! Both are files as checkpoints are.

use super::checkpoint::{Difference, Key};
use super::files::OutputError;
use super::identity::Fnv;
use super::part_error::PartError;
use super::sealed::{self, Sealed, Unsound};
use super::tile_set::TileSet;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Name of the solution in its folder.
const NAME: &str = "solved.lk";
/// What the first lines begin with.
const SOLUTION_MAGIC: &str = "lightkiln solution ";
const TILES_MAGIC: &str = "lightkiln tiles ";
/// How names of files with tiles begin and end.
const TILES_PREFIX: &str = "tiles_";
const SUFFIX: &str = ".lk";
/// Files of that suffix that hold no tiles.
const OTHERS: [&str; 3] = [NAME, "checkpoint.lk", "solution.lk"];
/// Bytes of a file name at most, with room for what temporary names add.
const LONGEST_NAME: usize = 200;

/// What a solution is about.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SolutionHead {
    /// Scene, settings and version.
    pub key: Key,
    /// Hash of all that the light depends on, and of the solution.
    #[serde(default)]
    pub identity: String,
    /// Tiles of the final gather.
    pub tiles: u32,
    /// Texels of the lightmap.
    pub texels: u64,
    /// Tells layouts apart.
    pub layout: u32,
    /// Where the scene file was.
    pub scene: PathBuf,
    /// All settings, as JSON.
    pub settings: Value,
}

/// What a file of tiles holds.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TilesHead {
    key: Key,
    solution: String,
    /// Tiles that are whole.
    pub tiles: TileSet,
}

impl TilesHead {
    /// Of so many tiles of a solution.
    pub fn new(solution: &SolutionHead, tiles: TileSet) -> Self {
        Self { key: solution.key.clone(), solution: solution.identity.clone(), tiles }
    }

    /// Fails if they are not of that solution.
    pub fn check(&self, solution: &SolutionHead, path: &Path) -> Result<(), PartError> {
        let other = match solution.key.difference(&self.key) {
            Some(difference) => difference.phrase(),
            None if self.solution != solution.identity => "belongs to another solution of the same scene".into(),
            None => return Ok(()),
        };
        Err(PartError::Foreign { path: path.to_path_buf(), tiles: self.tiles.clone(), other })
    }
}

impl SolutionHead {
    /// Fails if this baker cannot go on from it.
    fn check(&self, path: &Path) -> Result<(), PartError> {
        if self.key.is_own_version() {
            return Ok(());
        }
        let own = Key::new("", Default::default()).origin();
        Err(PartError::Version { path: path.to_path_buf(), found: self.key.origin(), own })
    }

    /// What [`SolutionHead::identity`] starts from.
    fn hash(&self) -> Fnv {
        let mut hash = Fnv::default();
        let facts = serde_json::to_vec(&(&self.key, self.tiles, self.texels, self.layout));
        hash.part(&facts.expect("keys are strings"));
        hash
    }

    /// Fails unless it is of the same scene, with the same settings.
    pub fn check_same(&self, key: &Key, folder: &Path) -> Result<(), PartError> {
        let differs = |d: Difference| PartError::Exists { path: solution_path(folder), other: d.phrase() };
        key.difference(&self.key).map(differs).map_or(Ok(()), Err)
    }
}

impl Difference {
    /// As what the file does that differs.
    fn phrase(self) -> String {
        match self {
            Self::Version(found) => format!("is from lightkiln {found}"),
            Self::Scene => "belongs to another scene, or to an earlier one in this file".into(),
            Self::Setting { name, found, wanted } => format!("was made with {name} {found}, not {wanted}"),
        }
    }
}

/// The solution of a folder.
pub fn solution_path(folder: &Path) -> PathBuf {
    folder.join(NAME)
}

/// True if a folder has one.
pub fn is_solved(folder: &Path) -> bool {
    solution_path(folder).is_file()
}

/// Writes a solution in place of an earlier one; returns its head with its identity. The folder exists.
pub fn write_solution(
    folder: &Path,
    head: SolutionHead,
    content: &impl Serialize,
) -> Result<SolutionHead, OutputError> {
    let mut hash = head.hash();
    sealed::fingerprint(&mut hash, content);
    let head = SolutionHead { identity: hash.hex(), ..head };
    sealed::write(&solution_path(folder), SOLUTION_MAGIC, &head, content)?;
    Ok(head)
}

/// What the solution of a folder is about, whichever version it is of.
pub fn read_head(folder: &Path) -> Result<SolutionHead, PartError> {
    Ok(open_solution(folder)?.0)
}

/// The solution of a folder. Fails if another version has written it.
pub fn read_solution<T: DeserializeOwned>(folder: &Path) -> Result<(SolutionHead, T), PartError> {
    let (head, file) = open_solution(folder)?;
    let path = solution_path(folder);
    head.check(&path)?;
    let mut hash = head.hash();
    hash.update(file.content_bytes());
    let content = if hash.hex() == head.identity { file.content() } else { Err(Unsound::Damaged) };
    Ok((head, content.map_err(|fault| unsound_solution(&path, fault))?))
}

fn open_solution(folder: &Path) -> Result<(SolutionHead, Sealed), PartError> {
    let path = solution_path(folder);
    let fault = |fault| unsound_solution(&path, fault);
    let file = sealed::read(&path, SOLUTION_MAGIC).map_err(fault)?;
    let file = file.ok_or_else(|| PartError::NoSolution(folder.to_path_buf()))?;
    Ok((file.head().map_err(fault)?, file))
}

fn unsound_solution(path: &Path, fault: Unsound) -> PartError {
    unsound(path, fault, "solve again with --force")
}

fn unsound(path: &Path, fault: Unsound, remedy: &'static str) -> PartError {
    let path = path.to_path_buf();
    match fault {
        Unsound::Read(source) => PartError::Read { path, source },
        Unsound::Damaged => PartError::Damaged { path, remedy },
    }
}

/// The file of a folder for such tiles.
pub fn tiles_path(folder: &Path, tiles: &TileSet) -> Result<PathBuf, PartError> {
    let name = format!("{TILES_PREFIX}{tiles}{SUFFIX}");
    if name.len() > LONGEST_NAME { Err(PartError::LongName) } else { Ok(folder.join(name)) }
}

/// Writes tiles in place of earlier ones in that file.
pub fn write_tiles(path: &Path, head: &TilesHead, content: &impl Serialize) -> Result<(), OutputError> {
    sealed::write(path, TILES_MAGIC, head, content)
}

/// What a file of tiles says that it holds; none if there is no such file.
pub fn read_tiles_head(path: &Path) -> Result<Option<TilesHead>, PartError> {
    let fault = |fault| unsound_tiles(path, fault);
    sealed::read(path, TILES_MAGIC).map_err(fault)?.map(|file| file.head().map_err(fault)).transpose()
}

/// A file of tiles of a solution; none if there is no such file.
pub fn read_tiles<T: DeserializeOwned>(
    path: &Path,
    solution: &SolutionHead,
) -> Result<Option<(TilesHead, T)>, PartError> {
    let fault = |fault| unsound_tiles(path, fault);
    let Some(file) = sealed::read(path, TILES_MAGIC).map_err(fault)? else { return Ok(None) };
    let head: TilesHead = file.head().map_err(fault)?;
    head.check(solution, path)?;
    Ok(Some((head, file.content().map_err(fault)?)))
}

fn unsound_tiles(path: &Path, fault: Unsound) -> PartError {
    unsound(path, fault, "remove it and gather its tiles again")
}

/// Files of tiles in a folder, by name.
pub fn tile_files(folder: &Path) -> Result<Vec<PathBuf>, PartError> {
    let failed = |source| PartError::Read { path: folder.to_path_buf(), source };
    let is_tiles =
        |name: &str| name.ends_with(SUFFIX) && !name.starts_with('.') && !OTHERS.contains(&name) && name != SUFFIX;
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if entry.file_name().to_str().is_some_and(is_tiles) && entry.path().is_file() {
            files.push(entry.path());
        }
    }
    files.sort();
    Ok(files)
}

/// Removes a folder's tiles of other solutions: they would only be refused.
pub fn remove_foreign_tiles(folder: &Path, solution: &SolutionHead) {
    let is_named = |path: &Path| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(TILES_PREFIX));
    for path in tile_files(folder).unwrap_or_default() {
        let is_foreign = match read_tiles_head(&path) {
            Ok(head) => head.is_some_and(|head| head.check(solution, &path).is_err()),
            Err(_) => is_named(&path),
        };
        if is_foreign {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Files and folders to merge, as files of tiles and folders of solutions.
pub fn parts_in(paths: &[PathBuf]) -> Result<(Vec<PathBuf>, Vec<PathBuf>), PartError> {
    let (mut tiles, mut folders) = (Vec::new(), Vec::new());
    for path in paths {
        if path.is_dir() {
            tiles.extend(tile_files(path)?);
            if is_solved(path) {
                folders.push(path.clone());
            }
        } else if path.is_file() {
            tiles.push(path.clone());
        } else {
            return Err(PartError::Nothing(path.clone()));
        }
    }
    Ok((tiles, folders))
}

/// The scene file of a solution: where it is said to be, or where it was.
pub fn scene_of(solution: &SolutionHead, said: Option<&Path>) -> Result<PathBuf, PartError> {
    let path = said.unwrap_or(&solution.scene);
    if path.exists() { Ok(path.to_path_buf()) } else { Err(PartError::NoScene(path.to_path_buf())) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::collections::BTreeMap;

    fn head(error: f64) -> SolutionHead {
        let key = Key::new("abc", BTreeMap::from([("error".to_owned(), json!(error))]));
        let (identity, scene) = (String::new(), PathBuf::from("hall.glb"));
        SolutionHead { key, identity, tiles: 8, texels: 8000, layout: 7, scene, settings: Value::Null }
    }

    #[test]
    fn a_solution_is_known_by_its_content() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |error, content: &[u32]| {
            let head = write_solution(folder.path(), head(error), &content).expect("there is room");
            let (read, back): (_, Vec<u32>) = read_solution(folder.path()).expect("it is whole");
            assert!(read.identity == head.identity && back == content);
            head.identity
        };
        let identity = write(0.02, &[1, 2]);
        assert_eq!(identity, write(0.02, &[1, 2]));
        assert_ne!(identity, write(0.02, &[1, 3]));
        assert_ne!(identity, write(0.01, &[1, 2]));
    }

    #[test]
    fn foreign_tiles_are_named_with_the_reason() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let own = write_solution(folder.path(), head(0.02), &[1u32]).expect("there is room");
        let tiles: TileSet = "2-5".parse().expect("tiles");
        let path = tiles_path(folder.path(), &tiles).expect("a short name");
        write_tiles(&path, &TilesHead::new(&own, tiles), &7u32).expect("there is room");
        assert_eq!(tile_files(folder.path()).expect("it is readable"), std::slice::from_ref(&path));
        let (read, content) = read_tiles::<u32>(&path, &own).expect("they are its own").expect("they are there");
        assert_eq!((read.tiles.to_string().as_str(), content), ("2-5", 7));
        let refused = |other: &SolutionHead, reason: &str| {
            let error = read_tiles::<u32>(&path, other).expect_err("they are foreign").to_string();
            assert!(error.contains("tiles_2-5.lk` (tiles 2-5)") && error.contains(reason), "{error}");
        };
        refused(&head(0.01), "was made with error 0.02, not 0.01");
        refused(&SolutionHead { identity: "other".into(), ..own.clone() }, "another solution of the same scene");
        remove_foreign_tiles(folder.path(), &own);
        assert!(path.is_file());
        remove_foreign_tiles(folder.path(), &head(0.01));
        assert!(!path.is_file());
    }
}
