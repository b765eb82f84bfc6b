//! Follows a bake for the disk: shows its states in place of the results and keeps checkpoints, neither of them more
//! often than a small share of the bake's time allows.

use super::BakeError;
use super::observer::{Counts, Draft, Found, FoundSoFar, Observer, REFINE, Refinement};
use super::preview::{Preview, preview};
use super::refine::{Costs, refined_facts, worst_tiles};
use super::results::{Findings, Results, Subject};
use crate::accel::Accel;
use crate::atlas::PageImage;
use crate::audit::{self, Audit, AuditSettings};
use crate::gather::{Lightmap, Probe, Smooth};
use crate::math::hash2;
use crate::output::checkpoint::{self, Key};
use crate::output::report::{RefinementFacts, StageClock};
use crate::post;
use crate::progress::{Cancelled, Progress, Quiet, Stage};
use crate::scene::LightGroups;
use crate::warning::Warning;
use std::time::{Duration, Instant};

/// Least time between two states.
const BETWEEN_STATES: Duration = Duration::from_secs(1);
/// Times as long as writing took that nothing is written.
const REST: u32 = 32;

/// Keeps what a bake has found.
pub(super) struct Keeper<'a> {
    pub(super) subject: &'a Subject<'a>,
    pub(super) results: &'a mut Results,
    pub(super) clock: &'a StageClock,
    pub(super) progress: &'a dyn Progress,
    pub(super) warnings: &'a mut Vec<Warning>,
    /// What an interrupted bake had found.
    pub(super) before: Option<Found>,
    /// When the next state is due, if states are wanted.
    pub(super) states: Option<Pace>,
    /// Ray queries, for audits.
    pub(super) accel: &'a Accel<'a>,
    /// The finished pages with their audit, once there was one.
    pub(super) judged: Option<(Vec<PageImage>, Option<Audit>)>,
    /// What was gathered again.
    pub(super) refinements: Vec<RefinementFacts>,
    /// When the next checkpoint is due, if there are any, and what they belong to.
    pub(super) checkpoints: Option<(Pace, Key)>,
}

/// When something is due that takes time.
pub(super) struct Pace {
    least: Duration,
    due: Instant,
}

impl Pace {
    /// Every `least` or more seldom.
    pub(super) fn every(least: Duration) -> Self {
        Self { least, due: Instant::now() + least }
    }

    /// That of states.
    pub(super) fn of_states() -> Self {
        Self::every(BETWEEN_STATES)
    }

    /// True if it is.
    pub(super) fn is_due(&self) -> bool {
        Instant::now() >= self.due
    }

    /// It was done, from `start` on.
    pub(super) fn done(&mut self, start: Instant) {
        // Who asks for no time between wants it at every opportunity.
        let rest = if self.least.is_zero() { Duration::ZERO } else { self.least.max(REST * start.elapsed()) };
        self.due = Instant::now() + rest;
    }
}

impl Keeper<'_> {
    /// Bakes a preview and shows it, unless states are not wanted, or better is known from an interrupted bake. Returns
    /// what it knows of all but direct light.
    pub(super) fn first_look(&mut self, groups: &LightGroups) -> Result<Option<Smooth>, Cancelled> {
        let Subject { atlas, texels, .. } = *self.subject;
        let is_solved = self.before.as_ref().is_some_and(|found| found.solution.is_some());
        if self.states.is_none() || is_solved {
            return Ok(None);
        }
        if self.before.is_none() {
            // From the first state on, the folder belongs to this bake, however it ends.
            self.keep(&FoundSoFar { direct: None, solution: None, probes: &[] });
        }
        self.progress.report(Stage::Preview, 0.0);
        let Preview { mut lightmap, rest, state, counts } = self.clock.measure(Stage::Preview, || {
            // What its parts take is no part of the stages that it looks ahead to.
            preview(self.accel, atlas, texels, groups, &StageClock::start(), &Quiet(self.progress))
        })?;
        self.progress.report(Stage::Preview, 1.0);
        self.subject.settings.light.keep(&mut lightmap.combined, &lightmap.direct_groups);
        self.show(Draft { lightmap, state }, &counts);
        Ok(Some(rest))
    }

    /// Pages of a finished lightmap.
    pub(super) fn finish(&self, lightmap: &Lightmap) -> Result<Vec<PageImage>, Cancelled> {
        let Subject { atlas, texels, scene, settings, .. } = *self.subject;
        self.clock.measure(Stage::Post, || {
            let mut values = lightmap.combined.clone();
            post::fill_unusable(atlas, texels, &mut values, &lightmap.usable);
            post::finish(atlas, texels, scene, &values, &settings.post, self.progress)
        })
    }

    /// Shows a state in place of the one before it.
    pub(super) fn show(&mut self, draft: Draft, counts: &Counts) {
        let start = Instant::now();
        if let Err(error) = self.publish(draft, counts) {
            if !matches!(error, BakeError::Cancelled(_)) {
                let reason = format!("{error}; the bake goes on and tries to write its result");
                self.warn(Warning::new("state", "states", reason));
                self.states = None;
            }
        } else if let Some(pace) = &mut self.states {
            pace.done(start);
        }
    }

    fn publish(&mut self, draft: Draft, counts: &Counts) -> Result<(), BakeError> {
        let Subject { atlas, texels, scene, settings, .. } = *self.subject;
        let Draft { mut lightmap, state } = draft;
        let quiet = Quiet(self.progress);
        post::fill_unusable(atlas, texels, &mut lightmap.combined, &lightmap.usable);
        let irradiance = post::finish(atlas, texels, scene, &lightmap.combined, &settings.post, &quiet)?;
        let (counts, warnings) = (counts.clone(), self.warnings.clone());
        let findings = Findings { state, counts, audit: None, refinements: Vec::new(), warnings };
        let report = self.results.publish(self.subject, &irradiance, findings, None, self.clock, &quiet)?;
        let files: Vec<_> = report.outputs.iter().map(|name| settings.output.folder.join(name)).collect();
        self.progress.improved(state.reached.name(), state.predicted_error, &files);
        Ok(())
    }

    fn keep(&mut self, so_far: &FoundSoFar) {
        let Some((pace, key)) = &mut self.checkpoints else { return };
        let start = Instant::now();
        let folder = &self.subject.settings.output.folder;
        match checkpoint::write(folder, key, &(self.subject.layout, so_far)) {
            Ok(()) => {
                pace.done(start);
                self.progress.kept(&checkpoint::path(folder));
            }
            Err(error) => {
                self.checkpoints = None;
                self.warn(Warning::new("checkpoint", "checkpoint.lk", format!("{error}; the bake goes on without")));
            }
        }
    }

    fn warn(&mut self, warning: Warning) {
        self.progress.warn(&warning);
        self.warnings.push(warning);
    }
}

impl Observer for Keeper<'_> {
    fn found_before(&mut self) -> Found {
        self.before.take().unwrap_or_default()
    }

    fn wants_drafts(&self) -> bool {
        self.states.is_some()
    }

    fn judge(
        &mut self,
        lightmap: &Lightmap,
        probes: &[(u32, Probe)],
        counts: &Counts,
    ) -> Result<Option<Refinement>, Cancelled> {
        let Subject { atlas, texels, settings, hash, .. } = *self.subject;
        let refined = counts.rays.get(REFINE).copied().unwrap_or(0);
        let first = counts.rays.values().sum::<u64>() - refined;
        let Some(most_rays) = settings.audit.most_rays(first) else { return Ok(None) };
        let pages = self.finish(lightmap)?;
        let round = self.refinements.len();
        let audit = self.clock.measure(Stage::Audit, || {
            let baked = post::at_texels(atlas, texels, &pages);
            let seed = u32::from_str_radix(hash.get(..8).unwrap_or_default(), 16).unwrap_or_default();
            // Texels and paths that chose what to refine must not judge it.
            let seed = if round == 0 { seed } else { hash2(seed, round as u32) };
            let settings = AuditSettings { target: settings.error, most_rays, seed };
            audit::audit(self.accel, atlas, texels, &lightmap.usable, &baked, &settings, self.progress)
        })?;
        let costs = Costs::new(texels.len(), probes, first);
        let budget = first as f64 - refined as f64;
        let refinement = audit.as_ref().and_then(|audit| worst_tiles(audit, &costs, round, budget));
        if let (Some(refinement), Some(audit)) = (&refinement, &audit) {
            self.refinements.push(refined_facts(refinement, audit, texels.len()));
        }
        self.judged = Some((pages, audit));
        Ok(refinement)
    }

    fn found(&mut self, so_far: &FoundSoFar, counts: &Counts, draft: &mut dyn FnMut() -> Option<Draft>) {
        if self.checkpoints.as_ref().is_some_and(|(pace, _)| pace.is_due()) {
            self.keep(so_far);
        }
        if self.states.as_ref().is_some_and(Pace::is_due)
            && let Some(mut draft) = draft()
        {
            if let Some(direct) = so_far.direct {
                self.subject.settings.light.keep(&mut draft.lightmap.combined, &direct.groups);
            }
            self.show(draft, counts);
        }
    }
}
