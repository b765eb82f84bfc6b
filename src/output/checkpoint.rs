//! Checkpoints: what an interrupted bake had found, in one file that is replaced whole.
//!
//! A checkpoint of another scene, version or setting is refused, and so is a damaged one.

use super::files::OutputError;
use super::sealed::{self, Unsound};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};
use thiserror::Error;

/// Name of a checkpoint in the folder of the results.
const NAME: &str = "checkpoint.lk";
/// What the first line begins with.
const MAGIC: &str = "lightkiln checkpoint ";
/// Version of the content.
const FORMAT: u32 = 4;

/// Why a checkpoint is not used.
#[derive(Debug, Error)]
pub enum CheckpointError {
    /// It cannot be read.
    #[error("cannot read the checkpoint `{}`", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is not what was written.
    #[error("the checkpoint `{}` is damaged; delete it, or bake without --resume", .0.display())]
    Damaged(PathBuf),
    /// It was written by another version of the baker.
    #[error("the checkpoint `{}` is from lightkiln {found}; delete it, or bake without --resume", .path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
    },
    /// It belongs to another scene.
    #[error("the checkpoint `{}` belongs to another scene, or to an earlier one in this file; delete it, or bake without --resume", .0.display())]
    Scene(PathBuf),
    /// It was made with other settings.
    #[error("the checkpoint `{}` was made with {name} {found}, not {wanted}; ask for the same, delete it, or bake without --resume", .path.display())]
    Setting {
        /// The file.
        path: PathBuf,
        /// The setting.
        name: String,
        /// What it was, as JSON.
        found: String,
        /// What it is now.
        wanted: String,
    },
    /// The lightmap is laid out in another way than when it was written.
    #[error("the checkpoint `{}` was made with another layout of the lightmap; delete it, or bake without --resume", .0.display())]
    Layout(PathBuf),
}

/// What a checkpoint belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key {
    format: u32,
    version: String,
    scene: String,
    settings: BTreeMap<String, Value>,
}

impl Key {
    /// The bake of a scene with such settings by this baker.
    pub fn new(scene_hash: &str, settings: BTreeMap<String, Value>) -> Self {
        Self { format: FORMAT, version: env!("CARGO_PKG_VERSION").into(), scene: scene_hash.into(), settings }
    }

    /// The first thing in which `found` differs.
    pub(super) fn difference(&self, found: &Self) -> Option<Difference> {
        if (self.format, &self.version) != (found.format, &found.version) {
            return Some(Difference::Version(found.origin()));
        }
        if self.scene != found.scene {
            return Some(Difference::Scene);
        }
        for name in self.settings.keys().chain(found.settings.keys()) {
            let of = |key: &Self| key.settings.get(name).cloned().unwrap_or(Value::Null);
            if of(self) != of(found) {
                let (found, wanted) = (of(found).to_string(), of(self).to_string());
                return Some(Difference::Setting { name: name.clone(), found, wanted });
            }
        }
        None
    }

    /// Version and format of the baker that it is of.
    pub fn origin(&self) -> String {
        format!("{}, format {}", self.version, self.format)
    }

    /// True if this baker has written it.
    pub fn is_own_version(&self) -> bool {
        (self.format, self.version.as_str()) == (FORMAT, env!("CARGO_PKG_VERSION"))
    }

    /// Hash of the scene.
    pub fn scene(&self) -> &str {
        &self.scene
    }

    /// Settings that the light depends on, by the names of their options.
    pub fn settings(&self) -> &BTreeMap<String, Value> {
        &self.settings
    }
}

/// In what two keys differ.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Difference {
    /// It is of this version.
    Version(String),
    /// The scene.
    Scene,
    /// A setting, with its values as JSON.
    Setting { name: String, found: String, wanted: String },
}

impl CheckpointError {
    fn foreign(path: &Path, difference: Difference) -> Self {
        let path = path.to_path_buf();
        match difference {
            Difference::Version(found) => Self::Version { path, found },
            Difference::Scene => Self::Scene(path),
            Difference::Setting { name, found, wanted } => Self::Setting { path, name, found, wanted },
        }
    }
}

/// The checkpoint of a folder of results.
pub fn path(folder: &Path) -> PathBuf {
    folder.join(NAME)
}

/// True if a folder of results has one.
pub fn exists(folder: &Path) -> bool {
    path(folder).exists()
}

/// Removes it. What cannot be removed is refused or replaced by the next bake.
pub fn remove(folder: &Path) {
    let _ = fs::remove_file(path(folder));
}

/// Writes a checkpoint in place of an earlier one. The folder exists.
pub fn write(folder: &Path, key: &Key, content: &impl Serialize) -> Result<(), OutputError> {
    sealed::write(&path(folder), MAGIC, key, content)
}

/// Reads the checkpoint of a folder, none if there is none.
pub fn read<T: DeserializeOwned>(folder: &Path, key: &Key) -> Result<Option<T>, CheckpointError> {
    let path = path(folder);
    let unsound = |fault| match fault {
        Unsound::Read(source) => CheckpointError::Read { path: path.clone(), source },
        Unsound::Damaged => CheckpointError::Damaged(path.clone()),
    };
    let Some(file) = sealed::read(&path, MAGIC).map_err(unsound)? else { return Ok(None) };
    match key.difference(&file.head().map_err(unsound)?) {
        Some(difference) => Err(CheckpointError::foreign(&path, difference)),
        None => file.content().map(Some).map_err(unsound),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn key(scene: &str, error: f64) -> Key {
        Key::new(scene, BTreeMap::from([("error".to_owned(), json!(error))]))
    }

    #[test]
    fn content_comes_back_and_the_next_replaces_it() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let key = key("abc", 0.02);
        assert_eq!(read::<Vec<f32>>(folder.path(), &key).expect("none is no fault"), None);
        for content in [vec![1.5f32, -0.0, f32::MAX], vec![]] {
            write(folder.path(), &key, &content).expect("there is room");
            let back: Vec<f32> = read(folder.path(), &key).expect("it is whole").expect("it is there");
            assert_eq!(back, content);
        }
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
        remove(folder.path());
        assert!(!exists(folder.path()));
    }

    #[test]
    fn what_is_foreign_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write(folder.path(), &key("abc", 0.02), &1u32).expect("there is room");
        let refused = |key: &Key| read::<u32>(folder.path(), key).expect_err("it is foreign");
        assert!(matches!(refused(&key("abd", 0.02)), CheckpointError::Scene(_)));
        let setting = refused(&key("abc", 0.01)).to_string();
        assert!(setting.contains("error 0.02, not 0.01"), "{setting}");
        let version = Key { version: "0.0.1".into(), ..key("abc", 0.02) };
        assert!(matches!(refused(&version), CheckpointError::Version { .. }));
    }

    #[test]
    fn no_wrong_bit_and_no_missing_byte_passes() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let key = key("abc", 0.02);
        write(folder.path(), &key, &vec![7u32; 9]).expect("there is room");
        let whole = fs::read(path(folder.path())).expect("it was written");
        let refused = |bytes: &[u8]| {
            fs::write(path(folder.path()), bytes).expect("there is room");
            assert!(matches!(read::<Vec<u32>>(folder.path(), &key), Err(CheckpointError::Damaged(_))));
        };
        for i in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[i] ^= 1 << (i % 8);
            refused(&bytes);
            refused(&whole[..i]);
        }
    }
}
