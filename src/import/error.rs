//! Why a file cannot be imported at all. Every message names the place and the remedy.

use crate::progress::Cancelled;
use crate::warning::Warning;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The file is not a scene that can be baked.
#[derive(Debug, Error)]
pub enum ImportError {
    /// Nothing has that name.
    #[error("`{0}` does not exist: check the path")]
    NotFound(PathBuf),
    /// A folder was given.
    #[error("`{0}` is a folder: give the .glb or .gltf file inside it")]
    Folder(PathBuf),
    /// The operating system refused.
    #[error("`{path}` cannot be read: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Neither a GLB nor glTF JSON.
    #[error("`{path}` is not a glTF file: {fault}; export the scene as glTF 2.0 (.glb or .gltf)")]
    NotGltf {
        /// File.
        path: PathBuf,
        /// What was found instead.
        fault: String,
    },
    /// The JSON is malformed, or a property of core glTF has the wrong type.
    #[error("`{path}` has invalid glTF JSON: {fault}; export the file again or mend it there")]
    Json {
        /// File.
        path: PathBuf,
        /// Position and reason.
        fault: String,
    },
    /// glTF 1.0, or a version that does not exist yet.
    #[error("`{path}` is glTF {version}, which is not read: export it as glTF 2.0")]
    Version {
        /// File.
        path: PathBuf,
        /// Version that the file states.
        version: String,
    },
    /// The file or a buffer ends too early.
    #[error("{place} is truncated: {expected} bytes are announced, {actual} are there; copy or export the file again")]
    Truncated {
        /// File, chunk or buffer.
        place: String,
        /// Bytes that should be there.
        expected: u64,
        /// Bytes that are there.
        actual: u64,
    },
    /// A file that holds geometry is missing or unreadable.
    #[error("{place}: `{path}` cannot be read ({source}); put the file beside the .gltf, or export as .glb")]
    MissingBuffer {
        /// Buffer.
        place: String,
        /// File that it names.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A reference or value that the rest of the file depends on is wrong.
    #[error("{place}: {fault}; the file is damaged, export it again")]
    Invalid {
        /// JSON path such as `accessors[3].bufferView`.
        place: String,
        /// What is wrong.
        fault: String,
    },
    /// The file cannot be understood without an extension that is not read.
    #[error("the file requires the extension {0}, which is not supported: export the scene without it")]
    RequiredExtension(String),
    /// The scene that was asked for is not there.
    #[error("there is no scene `{asked}`: the file has {available}")]
    NoSuchScene {
        /// Name or index that was given.
        asked: String,
        /// Names of the scenes.
        available: String,
    },
    /// Nothing to bake.
    #[error(
        "`{path}` has no triangle to bake: check that the export includes meshes and not only a selection{skipped}"
    )]
    NoMeshes {
        /// File.
        path: PathBuf,
        /// What was left out and why; empty if the file has no mesh to begin with.
        skipped: String,
    },
    /// The user stopped the import.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl ImportError {
    /// A damaged file, see [`ImportError::Invalid`].
    pub(super) fn invalid(place: impl Into<String>, fault: impl Into<String>) -> Self {
        ImportError::Invalid { place: place.into(), fault: fault.into() }
    }

    /// Nothing to bake, with the first reasons for which meshes were skipped.
    pub(super) fn no_meshes(path: &Path, warnings: &[Warning]) -> Self {
        let reasons = warnings.iter().take(3).map(|warning| format!("; {warning}")).collect();
        ImportError::NoMeshes { path: path.into(), skipped: reasons }
    }
}
