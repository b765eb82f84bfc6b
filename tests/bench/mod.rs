//! Runs the program in a folder of its own. Out: exit code, messages, JSON lines, files.

use crate::scene_file::lit_square;
use assert_cmd::Command;
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::Output;
use tempfile::TempDir;

/// A folder with a scene to bake.
pub(crate) struct Bench {
    pub(crate) folder: TempDir,
}

impl Bench {
    /// A folder with the scene `square.glb`.
    pub(crate) fn new() -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        lit_square().write(&folder.path().join("square.glb"));
        Self { folder }
    }

    /// A path in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::cargo_bin("lightkiln").expect("the binary is built for its tests");
        command.current_dir(self.folder.path()).args(arguments).output().expect("it runs")
    }

    /// Names in a folder, none if there is no such folder.
    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

/// Exit code.
pub(crate) fn code(output: &Output) -> i32 {
    output.status.code().expect("it ended by itself")
}

/// Messages for people.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The JSON lines of the standard output, each an object with an event.
pub(crate) fn events(output: &Output) -> Vec<Value> {
    let text = std::str::from_utf8(&output.stdout).expect("JSON lines are UTF-8");
    let line = |l: &str| serde_json::from_str::<Value>(l).unwrap_or_else(|e| panic!("{e}: {l}"));
    let events: Vec<Value> = text.lines().map(line).collect();
    assert!(events.iter().all(|e| e["event"].is_string()));
    events
}
