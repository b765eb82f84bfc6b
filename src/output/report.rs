//! `report.json`: what was baked, with which settings, and what it took.
//!
//! The structs are the schema: fields are only ever added within one schema version.

use super::{State, process};
use crate::atlas::PageImage;
use crate::audit::{Audit, Estimate};
use crate::progress::Stage;
use crate::warning::Warning;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::{Add, Sub};
use std::time::Instant;

/// Name and version of the schema.
pub const SCHEMA: &str = "lightkiln-report/1";

/// The whole report.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Version of the baker.
    pub version: &'static str,
    /// What was baked.
    pub scene: SceneFacts,
    /// How far the bake had come when this was written.
    pub state: State,
    /// Settings in effect, by name.
    pub settings: BTreeMap<String, Value>,
    /// Where the time went, in the order of the stages.
    pub stages: Vec<StageFacts>,
    /// Time of the whole bake.
    pub total: Duration,
    /// Rays cast, by purpose.
    pub rays: BTreeMap<String, u64>,
    /// The radiosity system.
    pub solver: SolverFacts,
    /// The atlas.
    pub atlas: AtlasFacts,
    /// Light groups that were kept apart.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<GroupFacts>,
    /// What was changed after the bake; null if nothing was.
    pub relight: Option<RelightFacts>,
    /// How far the lightmap is from the truth; null without an audit.
    pub audit: Option<Audit>,
    /// What was gathered again because an audit had found it worse than wanted.
    pub refinements: Vec<RefinementFacts>,
    /// Most memory held at one time, bytes; null where the system does not tell.
    pub memory_peak_bytes: Option<u64>,
    /// Faults that the bake went on after.
    pub warnings: Vec<Warning>,
    /// Result files: names relative to the report's folder.
    pub outputs: Vec<String>,
}

/// What was gathered again, and why.
#[derive(Clone, Debug, Serialize)]
pub struct RefinementFacts {
    /// Error of the lightmap before.
    pub error_before: Estimate,
    /// Share of all texels that were gathered again.
    pub texels: f64,
    /// Relative error that was aimed for there.
    pub aim: f64,
}

/// A light group.
#[derive(Clone, Debug, Default, Serialize)]
pub struct GroupFacts {
    /// Its name.
    pub name: String,
    /// Lamps, `environment`, or `material:` and the name of an emissive material.
    pub lights: Vec<String>,
    /// Its pages.
    pub pages: Vec<PageFacts>,
}

/// What relighting changed.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RelightFacts {
    /// As they were written, relative to the bake.
    pub changes: Vec<String>,
    /// Error that changed reflectances bring, root mean square by mean irradiance; zero if none changed.
    pub expected_error: f64,
}

/// What was baked.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Name of the scene.
    pub name: String,
    /// Path of the scene file, as given.
    pub file: String,
    /// Hash of the file and of all that it refers to.
    pub hash: String,
    /// Unique meshes.
    pub meshes: usize,
    /// Placed meshes.
    pub instances: usize,
    /// Triangles over all instances.
    pub triangles: usize,
    /// Lamps.
    pub lights: usize,
    /// Decoded textures.
    pub textures: usize,
}

/// Seconds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Duration {
    /// On the clock.
    pub wall_s: f64,
    /// On all processors together; null where the system does not tell.
    pub cpu_s: Option<f64>,
}

impl Add for Duration {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let cpu_s = self.cpu_s.zip(other.cpu_s).map(|(a, b)| a + b);
        Self { wall_s: self.wall_s + other.wall_s, cpu_s }
    }
}

impl Sub for Duration {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        let cpu_s = self.cpu_s.zip(other.cpu_s).map(|(a, b)| a - b);
        Self { wall_s: self.wall_s - other.wall_s, cpu_s }
    }
}

/// Time of one stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StageFacts {
    /// Name of the stage, as in progress lines.
    pub stage: &'static str,
    /// Its time.
    #[serde(flatten)]
    pub duration: Duration,
}

/// Size of the radiosity system.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct SolverFacts {
    /// Nodes of the hierarchy.
    pub nodes: u64,
    /// Elements, its leaves: up to 4×4 texels each.
    pub elements: u64,
    /// Links between nodes, each direction counted.
    pub links: u64,
    /// Iterations until the solution converged.
    pub iterations: u32,
    /// Probes of the final gather.
    pub probes: u64,
}

/// Size of the atlas.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct AtlasFacts {
    /// Tool that unwrapped.
    pub unwrapper: String,
    /// Charts.
    pub charts: usize,
    /// Valid texels.
    pub texels: usize,
    /// Empty texels around every chart.
    pub padding: u32,
    /// Pages.
    pub pages: Vec<PageFacts>,
}

/// One lightmap page.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PageFacts {
    /// File name.
    pub file: String,
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Valid texels.
    pub texels: usize,
    /// Mean over the valid texels, in the unit of the quantity.
    pub mean: [f32; 3],
    /// Largest channel value.
    pub max: f32,
}

impl PageFacts {
    /// Facts about `page`, which is written to `file`.
    pub fn of(file: String, page: &PageImage) -> Self {
        let valid = || page.rgb.iter().zip(&page.valid).filter(|(_, v)| **v).map(|(c, _)| *c);
        let texels = valid().count();
        let sum: DVec3 = valid().map(Vec3::as_dvec3).sum();
        let mean = (sum / texels.max(1) as f64).as_vec3().to_array();
        let max = valid().map(|c| c.max_element()).fold(0.0, f32::max);
        Self { file, width: page.width, height: page.height, texels, mean, max }
    }
}

impl Report {
    /// Writes the report as indented JSON.
    pub fn write_json(&self, sink: &mut dyn Write) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut *sink, self)?;
        sink.write_all(b"\n")
    }
}

/// Measures the stages of a bake.
#[derive(Debug)]
pub struct StageClock {
    start: (Instant, Option<f64>),
    stages: RefCell<Vec<StageFacts>>,
}

impl StageClock {
    /// Starts now.
    pub fn start() -> Self {
        Self { start: now(), stages: RefCell::default() }
    }

    /// Runs `work` as part of `stage`. A stage that runs more than once counts as one; what other stages take meanwhile
    /// is theirs.
    pub fn measure<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let (start, before) = (now(), self.measured());
        let result = work();
        let inside = self.measured() - before;
        let duration = since(start) - inside;
        let mut stages = self.stages.borrow_mut();
        match stages.iter_mut().find(|s| s.stage == stage.name()) {
            Some(s) => s.duration = s.duration + duration,
            None => stages.push(StageFacts { stage: stage.name(), duration }),
        }
        result
    }

    /// Time of all stages together.
    fn measured(&self) -> Duration {
        let zero = Duration { wall_s: 0.0, cpu_s: Some(0.0) };
        self.stages.borrow().iter().fold(zero, |sum, s| sum + s.duration)
    }

    /// Time per stage so far.
    pub fn stages(&self) -> Vec<StageFacts> {
        self.stages.borrow().clone()
    }

    /// Time since the start.
    pub fn total(&self) -> Duration {
        since(self.start)
    }
}

fn now() -> (Instant, Option<f64>) {
    (Instant::now(), process::cpu_seconds())
}

fn since((wall, cpu): (Instant, Option<f64>)) -> Duration {
    let cpu_s = process::cpu_seconds().zip(cpu).map(|(now, then)| now - then);
    Duration { wall_s: wall.elapsed().as_secs_f64(), cpu_s }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread::sleep;
    use std::time::Duration as Pause;

    #[test]
    fn a_repeated_stage_counts_once() {
        let clock = StageClock::start();
        clock.measure(Stage::Gather, || clock.measure(Stage::Output, || sleep(Pause::from_millis(5))));
        clock.measure(Stage::Output, || ());
        clock.measure(Stage::Gather, || ());
        let stages = clock.stages();
        let names: Vec<_> = stages.iter().map(|s| s.stage).collect();
        assert_eq!(names, ["output", "gather"]);
        assert!(stages[0].duration.wall_s > stages[1].duration.wall_s, "{stages:?}");
        assert!(clock.total().wall_s >= clock.stages().iter().map(|s| s.duration.wall_s).sum::<f64>());
    }
}
