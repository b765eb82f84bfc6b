//! From pages of irradiance to the files of a bake: EXR pages, lit scene, report.

use super::BakeError;
use super::groups::GroupedLight;
use super::observer::Counts;
use crate::atlas::{Atlas, PageImage, Texels};
use crate::audit::Audit;
use crate::config::Settings;
use crate::document::Document;
use crate::output::checkpoint;
use crate::output::exr::{PageAttributes, clamped_texels, write_page};
use crate::output::glb::{PageLink, lit_glb};
use crate::output::html::write_html;
use crate::output::report::{AtlasFacts, PageFacts, RefinementFacts, Report, SCHEMA, SceneFacts, StageClock};
use crate::output::{OutputError, OutputSet, OutputSettings, Precision, State, process};
use crate::post;
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Scene;
use crate::warning::Warning;
use std::ffi::OsStr;
use std::path::Path;

pub(super) const REPORT_JSON: &str = "report.json";
pub(super) const REPORT_HTML: &str = "report.html";

/// The files of one bake.
pub(super) struct Results {
    outputs: OutputSet,
    lit_scene: String,
}

/// What a bake is about, known once its texels are.
pub(super) struct Subject<'a> {
    /// Scene file.
    pub(super) path: &'a Path,
    /// Hash of the scene.
    pub(super) hash: &'a str,
    /// The file, for the lit copy.
    pub(super) document: &'a Document,
    /// What is baked.
    pub(super) scene: &'a Scene,
    /// Its layout.
    pub(super) atlas: &'a Atlas,
    /// Its texels.
    pub(super) texels: &'a Texels,
    /// Tells layouts apart.
    pub(super) layout: u32,
    /// What was asked for.
    pub(super) settings: &'a Settings,
}

/// What was found out, beside the lightmap itself.
pub(super) struct Findings {
    /// How far the bake has come.
    pub(super) state: State,
    /// What it did.
    pub(super) counts: Counts,
    /// How far the lightmap is from the truth.
    pub(super) audit: Option<Audit>,
    /// What was gathered again.
    pub(super) refinements: Vec<RefinementFacts>,
    /// Faults that it went on after.
    pub(super) warnings: Vec<Warning>,
}

impl Results {
    /// Prepares the folder for a bake of `scene`: what would stop the results from being written, stops the bake now. The
    /// states that an interrupted bake has left may be replaced by one that goes on from its checkpoint.
    pub(super) fn open(scene: &Path, settings: &Settings) -> Result<Self, OutputError> {
        let lit_scene = lit_scene_name(scene);
        let names = [lit_scene.as_str(), REPORT_JSON, REPORT_HTML];
        let OutputSettings { folder, force, .. } = &settings.output;
        let goes_on = settings.resume && checkpoint::exists(folder);
        let outputs = OutputSet::open(folder, &names, *force || goes_on)?;
        if goes_on {
            outputs.sweep();
        }
        Ok(Self { outputs, lit_scene })
    }

    /// Writes pages of `irradiance`, the lit scene, what there is of groups and the report, and gives them their names in
    /// place of those that an earlier state of the bake has left.
    pub(super) fn publish(
        &mut self,
        subject: &Subject,
        irradiance: &[PageImage],
        mut findings: Findings,
        groups: Option<&GroupedLight>,
        clock: &StageClock,
        progress: &dyn Progress,
    ) -> Result<Report, BakeError> {
        let state = findings.state;
        let pages = clock.measure(Stage::Output, || {
            self.write_pages(subject, irradiance, state, &mut findings.warnings, progress)
        })?;
        let mut report = Report {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            scene: scene_facts(subject),
            state,
            settings: subject.settings.facts(),
            stages: clock.stages(),
            total: clock.total(),
            rays: findings.counts.rays,
            solver: findings.counts.solver,
            atlas: atlas_facts(subject.atlas, subject.texels, &pages),
            groups: Vec::new(),
            relight: None,
            audit: findings.audit,
            refinements: findings.refinements,
            memory_peak_bytes: process::peak_memory(),
            warnings: findings.warnings,
            outputs: Vec::new(),
        };
        if let Some(groups) = groups {
            clock.measure(Stage::Output, || groups.write(&mut self.outputs, &mut report, progress))?;
        }
        report.outputs = self.outputs.names();
        report.outputs.extend([REPORT_JSON.into(), REPORT_HTML.into()]);
        self.outputs.write(REPORT_JSON, |sink| report.write_json(sink))?;
        self.outputs.write(REPORT_HTML, |sink| write_html(sink, &report, &pages))?;
        if progress.is_cancelled() {
            return Err(Cancelled.into());
        }
        self.outputs.commit()?;
        progress.report(Stage::Output, 1.0);
        Ok(report)
    }

    /// Writes the EXR pages and the lit scene, still under temporary names. Returns the pages as they were written.
    fn write_pages(
        &mut self,
        subject: &Subject,
        irradiance: &[PageImage],
        state: State,
        warnings: &mut Vec<Warning>,
        progress: &dyn Progress,
    ) -> Result<Vec<PageImage>, BakeError> {
        let Subject { atlas, texels, settings, .. } = *subject;
        let OutputSettings { quantity, precision, .. } = settings.output;
        let pages = post::convert(irradiance, atlas, texels, quantity, &settings.post);
        let mut links = Vec::with_capacity(pages.len());
        for (i, page) in pages.iter().enumerate() {
            step(progress, i as f64 / (pages.len() + 1) as f64)?;
            let name = OutputSet::page_name(i);
            if let Some(warning) = too_bright(&name, page, precision) {
                progress.warn(&warning);
                warnings.push(warning);
            }
            let scene_hash = subject.hash.into();
            let attributes = PageAttributes { quantity, uv_set: 1, page: i, scene_hash, state, group: None };
            self.outputs.write(&name, |sink| write_page(sink, page, precision, &attributes))?;
            links.push(PageLink { uri: name, quantity });
        }
        step(progress, pages.len() as f64 / (pages.len() + 1) as f64)?;
        let glb = lit_glb(subject.document, subject.scene, atlas, irradiance, &links)?;
        self.outputs.write(&self.lit_scene, |sink| sink.write_all(&glb))?;
        Ok(pages.into_owned())
    }
}

/// File name of the lit copy of `scene`.
pub(super) fn lit_scene_name(scene: &Path) -> String {
    format!("{}.lit.glb", scene.file_stem().unwrap_or(OsStr::new("scene")).to_string_lossy())
}

fn step(progress: &dyn Progress, done: f64) -> Result<(), Cancelled> {
    progress.report(Stage::Output, done);
    if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}

fn too_bright(name: &str, page: &PageImage, precision: Precision) -> Option<Warning> {
    let count = clamped_texels(page, precision);
    let message = format!("{count} texels exceed the half floats' 65504 and are clamped: bake with --float");
    (count > 0).then(|| Warning::new("clamped", name, message))
}

/// What the report says about the scene.
fn scene_facts(subject: &Subject) -> SceneFacts {
    let scene = subject.scene;
    SceneFacts {
        name: scene.name.clone(),
        file: subject.path.display().to_string(),
        hash: subject.hash.to_owned(),
        meshes: scene.meshes.len(),
        instances: scene.instances.len(),
        triangles: scene.triangle_count(),
        lights: scene.lights.len(),
        textures: scene.textures.len(),
    }
}

/// What the report says about the atlas.
fn atlas_facts(atlas: &Atlas, texels: &Texels, pages: &[PageImage]) -> AtlasFacts {
    AtlasFacts {
        unwrapper: atlas.unwrapper.into(),
        charts: atlas.charts.len(),
        texels: texels.len(),
        padding: atlas.padding,
        pages: pages.iter().enumerate().map(|(i, p)| PageFacts::of(OutputSet::page_name(i), p)).collect(),
    }
}
