//! Bakes a scene with the built program, as a user would: settings → what its report says, and its files.

use crate::sampler::{self, Seen};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The stages that take time, in order.
pub(crate) const STAGES: [&str; 10] =
    ["import", "atlas", "texels", "accel", "direct", "solve", "gather", "post", "audit", "output"];

/// What to bake, and how.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    /// A scene with TEXCOORD_1; the results go beside it.
    pub(crate) scene: &'a Path,
    /// Width and height of the page.
    pub(crate) resolution: u32,
    /// Error to aim for, as a share.
    pub(crate) error: f64,
    /// All processors if none.
    pub(crate) threads: Option<usize>,
}

/// The outcome of a bake.
pub(crate) struct Baked {
    report: Value,
    seen: BTreeMap<String, Seen>,
    page: PathBuf,
}

impl Job<'_> {
    /// Runs the bake to its end.
    pub(crate) fn run(self) -> Result<Baked> {
        let folder = self.scene.with_extension("lightmaps");
        let messages = self.scene.with_extension("txt");
        let mut command = Command::new(env!("CARGO_BIN_EXE_lightkiln"));
        command.arg("bake").arg(self.scene).arg("--out").arg(&folder).args(["--force", "--json", "--uv", "keep"]);
        command.args(["--resolution", &self.resolution.to_string(), "--error", &self.error.to_string()]);
        if let Some(threads) = self.threads {
            command.args(["--threads", &threads.to_string()]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(File::create(&messages)?);
        let mut child = command.spawn().context("starting the built lightkiln")?;
        let lines = child.stdout.take().expect("the output is piped");
        let seen = sampler::watch(child.id(), lines);
        let status = child.wait()?;
        ensure!(status.success(), "the bake ended with {status}: {}", fs::read_to_string(&messages)?);
        let report = serde_json::from_slice(&fs::read(folder.join("report.json"))?)?;
        Ok(Baked { report, seen, page: folder.join("lightmap_0.exr") })
    }
}

impl Baked {
    /// A number of the report by its JSON pointer; not a number where it has none.
    pub(crate) fn number(&self, pointer: &str) -> f64 {
        self.report.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
    }

    /// CPU seconds of the whole bake.
    pub(crate) fn cpu(&self) -> f64 {
        self.number("/total/cpu_s")
    }

    /// Seconds of one stage; `clock` is `cpu_s` or `wall_s`.
    pub(crate) fn stage(&self, name: &str, clock: &str) -> f64 {
        let stages = self.report["stages"].as_array().into_iter().flatten();
        let of_stage = stages.filter(|s| s["stage"] == name);
        of_stage.filter_map(|s| s[clock].as_f64()).sum()
    }

    /// Seconds that one stage would have taken on the clock if its threads had not waited for processors that other
    /// programs used.
    pub(crate) fn undisturbed(&self, name: &str) -> f64 {
        let wall = self.stage(name, "wall_s");
        match self.seen.get(name) {
            Some(seen) if seen.running > 0.0 => wall * seen.running / (seen.running + seen.waiting),
            _ => wall,
        }
    }

    /// Rays of the lightmap and of its audit.
    pub(crate) fn rays(&self) -> f64 {
        let lightmap = self.report["rays"].as_object().into_iter().flatten();
        lightmap.filter_map(|(_, n)| n.as_f64()).sum()
    }

    /// Most memory held, MiB.
    pub(crate) fn peak(&self) -> f64 {
        self.number("/memory_peak_bytes") / MEBIBYTE
    }

    /// Most memory resident during a stage, MiB; not a number if it was too short to be seen.
    pub(crate) fn stage_peak(&self, name: &str) -> f64 {
        self.seen.get(name).map_or(f64::NAN, |seen| seen.peak as f64 / MEBIBYTE)
    }

    /// Error that the audit found, percent.
    pub(crate) fn audited(&self) -> f64 {
        100.0 * self.number("/audit/error/value")
    }

    /// Share of the texels that were gathered again because the audit had found them wanting, percent.
    pub(crate) fn again(&self) -> f64 {
        let refinements = self.report["refinements"].as_array().into_iter().flatten();
        refinements.filter_map(|r| r["texels"].as_f64()).fold(0.0, |sum, share| sum + 100.0 * share)
    }

    /// The lightmap's file.
    pub(crate) fn page(&self) -> &Path {
        &self.page
    }
}

/// Bytes.
pub(crate) const MEBIBYTE: f64 = (1 << 20) as f64;
