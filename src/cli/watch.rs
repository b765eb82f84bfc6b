//! Shows how far a bake is: a bar on a terminal, JSON lines for programs, nothing in a pipe.

use super::console::Console;
use super::interrupt;
use indicatif::{ProgressBar, ProgressStyle};
use lightkiln::progress::{Progress, Stage};
use lightkiln::warning::Warning;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The stages in order, and the share of a bake's time that each usually takes. Only the estimate of the time left
/// depends on it, and less the longer the bake runs.
const SHARES: [(Stage, f64); 11] = [
    (Stage::Import, 0.01),
    (Stage::Atlas, 0.05),
    (Stage::Texels, 0.06),
    (Stage::Accel, 0.01),
    (Stage::Preview, 0.02),
    (Stage::Direct, 0.15),
    (Stage::Solve, 0.22),
    (Stage::Gather, 0.36),
    (Stage::Post, 0.02),
    (Stage::Audit, 0.08),
    (Stage::Output, 0.02),
];

/// Least time between two updates.
const INTERVAL: Duration = Duration::from_millis(100);

/// Steps of the bar.
const STEPS: u64 = 1000;

/// Receives the progress of one bake and shows it.
pub(crate) struct Watch {
    console: Console,
    cancelled: &'static AtomicBool,
    bar: Option<ProgressBar>,
    start: Instant,
    /// Milliseconds after the start before which nothing more is shown.
    quiet_until: AtomicU64,
    state: Mutex<State>,
    /// What goes on from a checkpoint.
    resume: &'static str,
}

/// What was shown last.
#[derive(Default)]
struct State {
    current: Option<Current>,
    /// Share of the whole bake that is done. It never shrinks, even if a stage is taken up again.
    overall: f64,
}

/// The stage that runs.
#[derive(Clone, Copy)]
struct Current {
    stage: Stage,
    start: Instant,
    done: f64,
}

impl Watch {
    /// Shows progress on `console` until `cancelled` is raised or the watch is dropped.
    pub(crate) fn new(console: Console, cancelled: &'static AtomicBool) -> Self {
        let bar = console.is_watched().then(|| {
            let style = ProgressStyle::with_template("{msg:>8} [{bar:40}] {percent:>3}%{prefix}")
                .expect("the template is well-formed");
            ProgressBar::new(STEPS).with_style(style.progress_chars("=> "))
        });
        let (start, quiet_until, resume) = (Instant::now(), AtomicU64::new(0), "--resume");
        Self { console, cancelled, bar, start, quiet_until, state: Mutex::default(), resume }
    }

    /// The same for a command that goes on from checkpoints without being asked to.
    pub(crate) fn resuming(console: Console, cancelled: &'static AtomicBool) -> Self {
        let mut watch = Self::new(console, cancelled);
        watch.resume = "the same command";
        watch
    }

    /// True if it is time for another update.
    fn is_due(&self) -> bool {
        let now = self.start.elapsed().as_millis() as u64;
        let until = self.quiet_until.load(Ordering::Relaxed);
        let next = now + INTERVAL.as_millis() as u64;
        // Of several threads that find it is time, one shows it.
        now >= until && self.quiet_until.compare_exchange(until, next, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }

    fn show(&self, current: Current, overall: f64) {
        let eta = seconds_left(self.start.elapsed().as_secs_f64(), current);
        if let Some(bar) = &self.bar {
            bar.set_position((overall * STEPS as f64) as u64);
            bar.set_prefix(eta.map(|s| format!("  {} left", clock(s))).unwrap_or_default());
            bar.set_message(current.stage.name());
        }
        self.console.event(&json!({
            "event": "progress",
            "stage": current.stage.name(),
            "done": (current.done * 1e4).round() / 1e4,
            "overall": (overall * 1e4).round() / 1e4,
            "eta_s": eta.map(|s| (s * 10.0).round() / 10.0),
        }));
    }
}

impl Progress for Watch {
    fn report(&self, stage: Stage, done: f64) {
        if !self.console.is_json() && self.bar.is_none() {
            return;
        }
        let done = done.clamp(0.0, 1.0);
        // The lock is taken for every stage's first report and for those that are shown, not for the many others.
        let due = self.is_due();
        if !due && done > 0.0 && done < 1.0 {
            return;
        }
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let shown = match &mut state.current {
            Some(c) if c.stage == stage => {
                // Threads overtake each other between counting and reporting.
                let advanced = done > c.done;
                c.done = c.done.max(done);
                advanced && (due || done == 1.0)
            }
            _ => {
                state.current = Some(Current { stage, start: Instant::now(), done });
                true
            }
        };
        if shown && let Some(current) = state.current {
            let (before, own) = share(current.stage);
            state.overall = state.overall.max(before + own * current.done);
            self.show(current, state.overall);
        }
    }

    fn warn(&self, warning: &Warning) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.console.warn(warning)),
            None => self.console.warn(warning),
        }
    }

    fn improved(&self, reached: &str, predicted_error: f64, files: &[PathBuf]) {
        self.console.event(&json!({
            "event": "state",
            "reached": reached,
            "predicted_error": predicted_error,
            "outputs": files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>(),
        }));
        interrupt::remember_state(reached, predicted_error);
    }

    fn kept(&self, checkpoint: &Path) {
        self.console.event(&json!({ "event": "checkpoint", "file": checkpoint.display().to_string() }));
        interrupt::remember_checkpoint(checkpoint, self.resume);
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Share of a bake that lies before `stage`, and that of the stage itself.
fn share(stage: Stage) -> (f64, f64) {
    let index = SHARES.iter().position(|(s, _)| *s == stage).expect("every stage has a share");
    (SHARES[..index].iter().map(|(_, share)| share).sum(), SHARES[index].1)
}

/// Estimated seconds until the end, `elapsed` seconds after the start. None while there is too little to go by.
fn seconds_left(elapsed: f64, current: Current) -> Option<f64> {
    let (before, own) = share(current.stage);
    let done = before + own * current.done;
    let in_stage = current.start.elapsed().as_secs_f64();
    // Inside the stage its own pace counts; what comes after is estimated from the pace of the whole.
    let rest_of_stage = in_stage * (1.0 - current.done) / current.done;
    let pace = (elapsed + rest_of_stage) / (before + own);
    let left = rest_of_stage + pace * (1.0 - before - own);
    (done >= 0.02 && current.done >= 0.02 && left.is_finite()).then_some(left.max(0.0))
}

/// `12 s`, `3 min 05 s` or `1 h 20 min`.
fn clock(seconds: f64) -> String {
    let s = seconds.ceil() as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_cover_the_whole_bake() {
        let total: f64 = SHARES.iter().map(|(_, share)| share).sum();
        assert!((total - 1.0).abs() < 1e-12);
        let (before, own) = share(Stage::Output);
        assert!((before + own - 1.0).abs() < 1e-12);
    }

    #[test]
    fn clocks_read_well() {
        assert_eq!(clock(0.2), "1 s");
        assert_eq!(clock(185.0), "3 min 05 s");
        assert_eq!(clock(4800.0), "1 h 20 min");
    }

    #[test]
    fn no_estimate_before_there_is_something_to_go_by() {
        let current = Current { stage: Stage::Gather, start: Instant::now(), done: 0.0 };
        assert_eq!(seconds_left(1.0, current), None);
        assert!(seconds_left(1.0, Current { done: 0.5, ..current }).is_some_and(|s| s > 0.0));
    }
}
