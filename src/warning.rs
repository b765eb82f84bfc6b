//! What was wrong with an asset, and what the baker did about it. A defective asset is data, not an error.

use serde::Serialize;
use std::fmt;

/// One fault that the bake went on after: where, what, and how to remedy it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable, machine-readable kind such as `degenerate_triangles`.
    pub code: &'static str,
    /// Path of the node, mesh, material or file, for example `Kitchen/Table`.
    pub place: String,
    /// What is wrong and what was assumed, with the remedy.
    pub message: String,
}

impl Warning {
    /// A warning of kind `code` about `place`.
    pub fn new(code: &'static str, place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { code, place: place.into(), message: message.into() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}`: {}", self.place, self.message)
    }
}
