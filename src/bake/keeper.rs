//! Follows a bake for the disk: shows its states in place of the results and keeps checkpoints, neither of them more
//! often than a small share of the bake's time allows.

use super::BakeError;
use super::observer::{Counts, Draft, Found, FoundSoFar, Observer};
use super::preview::{Preview, preview};
use super::results::{Findings, Results, Subject};
use crate::accel::Accel;
use crate::output::checkpoint::{self, Key};
use crate::output::report::StageClock;
use crate::post;
use crate::progress::{Cancelled, Progress, Quiet, Stage};
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

    fn is_due(&self) -> bool {
        Instant::now() >= self.due
    }

    /// It was done, from `start` on.
    fn done(&mut self, start: Instant) {
        self.due = Instant::now() + self.least.max(REST * start.elapsed());
    }
}

impl Keeper<'_> {
    /// Bakes a preview and shows it.
    pub(super) fn first_look(&mut self, accel: &Accel) -> Result<Preview, Cancelled> {
        let Subject { atlas, texels, .. } = *self.subject;
        self.progress.report(Stage::Preview, 0.0);
        let preview = self.clock.measure(Stage::Preview, || {
            // What its parts take is no part of the stages that it looks ahead to.
            preview(accel, atlas, texels, &StageClock::start(), &Quiet(self.progress))
        })?;
        self.progress.report(Stage::Preview, 1.0);
        self.show(Draft { lightmap: preview.lightmap.clone(), state: preview.state }, &preview.counts);
        Ok(preview)
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
        let findings = Findings { state, counts: counts.clone(), audit: None, warnings: self.warnings.clone() };
        let report = self.results.publish(self.subject, &irradiance, findings, self.clock, &quiet)?;
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

    fn found(&mut self, so_far: &FoundSoFar, counts: &Counts, draft: &mut dyn FnMut() -> Option<Draft>) {
        if self.checkpoints.as_ref().is_some_and(|(pace, _)| pace.is_due()) {
            self.keep(so_far);
        }
        if self.states.as_ref().is_some_and(Pace::is_due)
            && let Some(draft) = draft()
        {
            self.show(draft, counts);
        }
    }
}
