//! The glTF file that a scene came from, kept so that the lit copy loses nothing: every extension, extra and image of
//! the source survives, whether the baker understands it or not.

use serde_json::Value;
use std::path::PathBuf;

/// A glTF asset with its buffers in memory.
#[derive(Clone, Debug, Default)]
pub struct Document {
    /// The glTF JSON, with compressed geometry (Draco, meshopt) already replaced by plain accessors. Node, mesh, primitive and material indices of the scene refer to it.
    pub json: Value,
    /// Content of `buffers[i]`, without a URI to look up any more.
    pub buffers: Vec<Vec<u8>>,
    /// Folder that relative URIs start from.
    pub directory: PathBuf,
    /// Files that it refers to: images, then what extensions name.
    pub external_files: Vec<ExternalFile>,
}

/// A file that a document refers to by URI.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExternalFile {
    /// JSON pointer to the URI.
    pub pointer: String,
    /// File that the URI names. It need not exist.
    pub path: PathBuf,
}

impl Document {
    /// The objects of a top-level array such as `nodes`; empty if the document has none.
    pub fn array(&self, name: &str) -> &[Value] {
        self.json.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// The extension `name` of entry `index` of the top-level array `array`.
    pub fn extension(&self, array: &str, index: usize, name: &str) -> Option<&Value> {
        self.array(array).get(index)?.get("extensions")?.get(name)
    }

    /// The extension `name` of the document itself.
    pub fn root_extension(&self, name: &str) -> Option<&Value> {
        self.json.get("extensions")?.get(name)
    }
}
