//! Checkpoints: what an interrupted bake had found, in one file that is replaced whole.
//!
//! A line of JSON says what it belongs to; the content follows in the postcard format, and at the end stand its length
//! and the CRC-32 of all before, little-endian. A checkpoint of another scene, version or setting is refused, and so is
//! one of which a bit is wrong: what it holds would end up in a lightmap unseen.

use super::files::{self, OutputError};
use crc32fast::Hasher;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of a checkpoint in the folder of the results.
const NAME: &str = "checkpoint.lk";
/// What the first line begins with.
const MAGIC: &str = "lightkiln checkpoint ";
/// Version of the content.
const FORMAT: u32 = 2;
/// Bytes of the length and the checksum at the end.
const TRAILER: usize = 12;

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

    /// Fails with the first thing in which `found` differs.
    fn check(&self, found: &Self, path: &Path) -> Result<(), CheckpointError> {
        let path = || path.to_path_buf();
        if (self.format, &self.version) != (found.format, &found.version) {
            let found = format!("{}, format {}", found.version, found.format);
            return Err(CheckpointError::Version { path: path(), found });
        }
        if self.scene != found.scene {
            return Err(CheckpointError::Scene(path()));
        }
        for name in self.settings.keys().chain(found.settings.keys()) {
            let of = |key: &Self| key.settings.get(name).cloned().unwrap_or(Value::Null);
            if of(self) != of(found) {
                let (found, wanted) = (of(found).to_string(), of(self).to_string());
                return Err(CheckpointError::Setting { path: path(), name: name.clone(), found, wanted });
            }
        }
        Ok(())
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
    files::replace(&path(folder), |sink| {
        let mut sum = Summed { sink, hasher: Hasher::new(), length: 0 };
        writeln!(sum, "{MAGIC}{}", serde_json::to_string(key)?)?;
        postcard::to_io(content, &mut sum).map_err(|_| sum_error())?;
        let (length, crc) = (sum.length, sum.hasher.finalize());
        sink.write_all(&length.to_le_bytes())?;
        sink.write_all(&crc.to_le_bytes())
    })
}

/// Reads the checkpoint of a folder, none if there is none.
pub fn read<T: DeserializeOwned>(folder: &Path, key: &Key) -> Result<Option<T>, CheckpointError> {
    let path = path(folder);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(CheckpointError::Read { path, source }),
    };
    let damaged = || CheckpointError::Damaged(path.clone());
    let (body, trailer) = bytes.len().checked_sub(TRAILER).map(|n| bytes.split_at(n)).ok_or_else(damaged)?;
    let (length, crc) = trailer.split_at(8);
    if length != (body.len() as u64).to_le_bytes() || crc != crc32fast::hash(body).to_le_bytes() {
        return Err(damaged());
    }
    let end = body.iter().position(|&b| b == b'\n').ok_or_else(damaged)?;
    let line = body[..end].strip_prefix(MAGIC.as_bytes()).ok_or_else(damaged)?;
    key.check(&serde_json::from_slice(line).map_err(|_| damaged())?, &path)?;
    postcard::from_bytes(&body[end + 1..]).map(Some).map_err(|_| damaged())
}

/// What a failed write of the content comes to: postcard keeps what the system said to itself.
fn sum_error() -> io::Error {
    io::Error::other("the disk takes no more")
}

/// Counts and sums what goes to a file.
struct Summed<'a, W: Write + ?Sized> {
    sink: &'a mut W,
    hasher: Hasher,
    length: u64,
}

impl<W: Write + ?Sized> Write for Summed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.sink.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        self.length += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
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
