//! Memory of a running bake per stage, sampled. Out: stage → most bytes resident. Linux tells; elsewhere it is empty.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two samples.
const PAUSE: Duration = Duration::from_millis(2);

/// Reads the JSON lines of process `pid` to their end and samples its memory meanwhile. A stage that does not announce
/// itself counts as the one before.
pub(crate) fn peaks(pid: u32, lines: impl Read) -> BTreeMap<String, u64> {
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

fn sample(pid: u32, stage: &Mutex<String>, ended: &AtomicBool) -> BTreeMap<String, u64> {
    let mut peaks = BTreeMap::new();
    while !ended.load(Ordering::Relaxed) {
        let name = stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(bytes) = resident(pid) {
            let peak: &mut u64 = peaks.entry(name).or_default();
            *peak = bytes.max(*peak);
        }
        thread::sleep(PAUSE);
    }
    peaks
}

/// Resident memory of a process, bytes.
fn resident(pid: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}
