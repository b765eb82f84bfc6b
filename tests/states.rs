//! States of a running bake, previews, checkpoints: what is on the disk whenever a bake ends, and that none of it changes
//! a bit of the result.

mod bench;
mod scene_file;

use bench::{Bench, code, events, stderr};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const RESULTS: [&str; 4] = ["cornell_box.lit.glb", "lightmap_0.exr", "report.html", "report.json"];
const CHECKPOINT: &str = "maps/checkpoint.lk";

/// Options of a small bake whose gather has many probes.
const SMALL: [&str; 8] = ["--resolution", "96", "--audit", "off", "--out", "maps", "--json", "--float"];

fn cornell() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell_box.glb").to_string_lossy().into_owned()
}

/// Bakes the Cornell box with more options.
fn bake(bench: &Bench, options: &[&str]) -> std::process::Output {
    let scene = cornell();
    bench.run(&[&["bake", &scene], &SMALL[..], options].concat())
}

fn spawn(bench: &Bench, options: &[&str]) -> Child {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin("lightkiln"));
    command.current_dir(bench.folder.path()).args(["bake", &cornell()]).args(SMALL).args(options);
    command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it runs")
}

/// Kills a bake once it has said `event` so many times. True if that came before its end.
fn killed(bench: &Bench, options: &[&str], event: &str, times: usize) -> bool {
    let mut child = spawn(bench, options);
    let lines = BufReader::new(child.stdout.take().expect("it is piped")).lines().map_while(Result::ok);
    let wanted = format!("\"event\":\"{event}\"");
    let reached = lines.filter(|line| line.contains(&wanted)).take(times).count() == times;
    child.kill().expect("it can be killed");
    !child.wait().expect("it ends").success() && reached
}

fn page(bench: &Bench) -> Vec<u8> {
    fs::read(bench.path("maps/lightmap_0.exr")).expect("it was written")
}

fn report(bench: &Bench) -> Value {
    serde_json::from_slice(&fs::read(bench.path("maps/report.json")).expect("it was written")).expect("it is JSON")
}

/// The page of a bake that is left alone.
fn undisturbed() -> Vec<u8> {
    let bench = Bench::new();
    let output = bake(&bench, &[]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(report(&bench)["state"]["reached"], "final");
    page(&bench)
}

#[test]
fn a_preview_says_that_it_is_one() {
    let bench = Bench::new();
    let output = bench.run(&["bake", &cornell(), "--resolution", "96", "--preview", "--out", "maps", "--json"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(bench.names("maps"), RESULTS);
    let report = report(&bench);
    assert_eq!(report["state"]["reached"], "preview");
    let error = report["state"]["predicted_error"].as_f64().expect("a number");
    assert!(error > 0.0 && error < 0.5, "{error}");
    assert!(report["audit"].is_null() && report["settings"]["preview"] == true);
    let html = fs::read_to_string(bench.path("maps/report.html")).expect("it was written");
    assert!(html.contains("preview"));
    assert_eq!(code(&bench.run(&["bake", &cornell(), "--preview", "--progressive"])), 2);
}

#[test]
fn states_do_not_change_a_bit_of_the_result() {
    let plain = undisturbed();
    for threads in ["1", "2"] {
        let bench = Bench::new();
        let output = bake(&bench, &["--progressive", "--checkpoint=0", "--threads", threads]);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        let events = events(&output);
        let states: Vec<&Value> = events.iter().filter(|e| e["event"] == "state").collect();
        assert_eq!(states[0]["reached"], "preview");
        assert!(states.iter().all(|s| s["predicted_error"].is_number() && s["outputs"].as_array().is_some()));
        let overall: Vec<f64> = events.iter().filter_map(|e| e["overall"].as_f64()).collect();
        assert!(overall.is_sorted(), "{overall:?}");
        assert!(page(&bench) == plain, "{threads} threads");
        assert_eq!(bench.names("maps"), RESULTS, "the checkpoint is gone");
    }
}

#[test]
fn a_state_stays_when_the_bake_is_killed() {
    let bench = Bench::new();
    assert!(killed(&bench, &["--progressive", "--error", "0.1%"], "state", 1));
    let names = bench.names("maps");
    assert!(RESULTS.iter().all(|name| names.iter().any(|n| n == name)), "{names:?}");
    let report = report(&bench);
    assert_ne!(report["state"]["reached"], "final");
    assert!(report["state"]["predicted_error"].as_f64().expect("a number") > 0.0);
    assert!(page(&bench).windows(15).any(|w| w == b"lightkiln:state"));
}

#[cfg(unix)]
#[test]
fn interrupting_tells_of_the_state_that_stays() {
    let bench = Bench::new();
    let mut child = spawn(&bench, &["--progressive", "--error", "0.1%"]);
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines().map_while(Result::ok);
    assert!(lines.by_ref().any(|line| line.contains("\"event\":\"state\"")));
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill exists").success());
    let last = lines.last().expect("an error line");
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    assert!(last.contains("interrupted; the results are those of the state `"), "{last}");
    assert_eq!(bench.names("maps"), RESULTS);
}

#[test]
fn a_bake_that_was_killed_goes_on_with_the_same_bits() {
    let plain = undisturbed();
    for (at, threads) in [(1, "1"), (2, "2"), (3, "1"), (4, "2"), (5, "2")] {
        let bench = Bench::new();
        let options = ["--resume", "--checkpoint=0", "--progressive", "--threads", threads];
        assert!(killed(&bench, &options, "checkpoint", at), "checkpoint {at}");
        assert!(bench.path(CHECKPOINT).is_file());
        // Killed again on its way, then left alone.
        killed(&bench, &options, "checkpoint", 1);
        let output = bake(&bench, &options);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert!(page(&bench) == plain, "after checkpoint {at}");
        assert_eq!(report(&bench)["state"]["reached"], "final");
        assert_eq!(bench.names("maps"), RESULTS);
    }
}

#[test]
fn what_a_checkpoint_holds_is_not_found_again() {
    let bench = Bench::new();
    assert!(killed(&bench, &["--checkpoint=0"], "checkpoint", 3));
    let checkpoint = fs::read(bench.path(CHECKPOINT)).expect("it was left");
    assert!(checkpoint.starts_with(b"lightkiln checkpoint {"));
    let output = bake(&bench, &["--resume"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(events(&output).iter().all(|e| e["stage"] != "direct"), "direct light was kept");
}

#[test]
fn a_checkpoint_that_does_not_fit_is_refused() {
    let bench = Bench::new();
    assert!(killed(&bench, &["--checkpoint=0"], "checkpoint", 2));
    let whole = fs::read(bench.path(CHECKPOINT)).expect("it was left");
    let refused = |options: &[&str], word: &str| {
        let output = bake(&bench, &[&["--resume"], options].concat());
        assert_eq!(code(&output), 1, "{word}");
        assert!(stderr(&output).contains(word) && stderr(&output).contains("checkpoint.lk"), "{}", stderr(&output));
        assert_eq!(events(&output).pop().expect("an error line")["code"], "checkpoint");
        assert!(bench.path(CHECKPOINT).is_file(), "it is left for whom it belongs to");
    };
    refused(&["--error", "1%"], "error 0.02, not 0.01");
    let other = bench.run(&[&["bake", "square.glb", "--resume"], &SMALL[..]].concat());
    assert!(code(&other) == 1 && stderr(&other).contains("another scene"), "{}", stderr(&other));
    for bytes in [&whole[..whole.len() - 1], &whole[..20], &[], &[&whole[..], b"x"].concat()] {
        fs::write(bench.path(CHECKPOINT), bytes).expect("there is room");
        refused(&[], "damaged");
    }
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 4;
    fs::write(bench.path(CHECKPOINT), flipped).expect("there is room");
    refused(&[], "damaged");

    // Without --resume it is named and left alone.
    let output = bake(&bench, &[]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(events(&output).iter().any(|e| e["code"] == "checkpoint_unused"));
}
