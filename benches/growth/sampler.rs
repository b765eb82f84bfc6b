//! What the stages of a running bake take from the machine, sampled. Linux tells; elsewhere there is nothing.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two samples.
const PAUSE: Duration = Duration::from_millis(4);

/// What was seen of one stage.
#[derive(Clone, Copy, Default)]
pub(crate) struct Seen {
    /// Most bytes resident.
    pub(crate) peak: u64,
    /// Seconds on processors, all threads together.
    pub(crate) running: f64,
    /// Seconds that threads were ready to run while others had the processors.
    pub(crate) waiting: f64,
}

/// Reads the JSON lines of process `pid` to their end and samples it meanwhile; a stage that does not announce itself
/// counts as the one before.
pub(crate) fn watch(pid: u32, lines: impl Read) -> BTreeMap<String, Seen> {
    let stage = Mutex::new(String::new());
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        let sampler = scope.spawn(|| sample(pid, &stage, &ended));
        for line in BufReader::new(lines).lines().map_while(Result::ok) {
            let event: Value = serde_json::from_str(&line).unwrap_or_default();
            if let Some(name) = event["stage"].as_str() {
                *stage.lock().unwrap_or_else(PoisonError::into_inner) = name.into();
            }
        }
        ended.store(true, Ordering::Relaxed);
        sampler.join().expect("sampling does not fail")
    })
}

fn sample(pid: u32, stage: &Mutex<String>, ended: &AtomicBool) -> BTreeMap<String, Seen> {
    let mut stages: BTreeMap<String, Seen> = BTreeMap::new();
    let mut before = [0.0; 2];
    while !ended.load(Ordering::Relaxed) {
        let name = stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let (Some(bytes), Some([running, waiting])) = (resident(pid), scheduled(pid)) {
            let seen = stages.entry(name).or_default();
            seen.peak = bytes.max(seen.peak);
            // Sums shrink when a thread ends.
            seen.running += (running - before[0]).max(0.0);
            seen.waiting += (waiting - before[1]).max(0.0);
            before = [running, waiting];
        }
        thread::sleep(PAUSE);
    }
    stages
}

/// Resident memory of a process, bytes.
fn resident(pid: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

/// Seconds that the threads of a process have run, and that they have waited for a processor.
fn scheduled(pid: u32) -> Option<[f64; 2]> {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten();
    let books = threads.filter_map(|thread| fs::read_to_string(thread.path().join("schedstat")).ok());
    let mut sums = [0.0; 2];
    for book in books {
        for (sum, nanoseconds) in sums.iter_mut().zip(book.split_ascii_whitespace()) {
            *sum += nanoseconds.parse::<f64>().ok()? * 1e-9;
        }
    }
    Some(sums)
}
