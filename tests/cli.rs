//! The command line's contract: exit codes, JSON lines, files.

mod bench;
mod scene_file;

use bench::{Bench, code, events, stderr};
use scene_file::lit_square;
use serde_json::Value;
use std::fs;
use std::path::Path;

const RESULTS: [&str; 4] = ["lightmap_0.exr", "report.html", "report.json", "square.lit.glb"];

#[test]
fn usage_errors_end_with_2() {
    let bench = Bench::new();
    for arguments in [
        &[][..],
        &["bake"],
        &["simmer", "square.glb"],
        &["bake", "square.glb", "--error", "0"],
        &["bake", "square.glb", "--error", "60%"],
        &["bake", "square.glb", "--resolution", "0"],
        &["bake", "square.glb", "--texels-per-metre", "-3"],
        &["bake", "square.glb", "--uv", "sideways"],
        &["bake", "square.glb", "--audit", "maybe"],
        &["bake", "square.glb", "--threads", "0"],
    ] {
        let output = bench.run(arguments);
        assert_eq!(code(&output), 2, "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
    let events = events(&bench.run(&["bake", "square.glb", "--error", "0", "--json"]));
    assert_eq!(events.len(), 1);
    assert_eq!(events[0]["event"], "error");
    assert_eq!(events[0]["code"], "usage");
}

#[test]
fn help_and_version_end_with_0() {
    let bench = Bench::new();
    for arguments in [["--help"], ["--version"]] {
        let output = bench.run(&arguments);
        assert_eq!(code(&output), 0);
        assert!(!output.stdout.is_empty());
    }
}

#[test]
fn a_missing_scene_ends_with_1() {
    let bench = Bench::new();
    let output = bench.run(&["bake", "nothing.glb", "--json"]);
    assert_eq!(code(&output), 1);
    assert!(stderr(&output).contains("nothing.glb"), "{}", stderr(&output));
    let last = events(&output).pop().expect("an error line");
    assert_eq!(last["event"], "error");
    assert_eq!(last["code"], "import");
    assert!(bench.names("lightmaps").is_empty(), "the folder is gone again");
}

#[test]
fn a_bake_writes_all_results_and_says_so() {
    let bench = Bench::new();
    let output = bench.run(&["bake", "square.glb", "--resolution", "16", "--json"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(bench.names("lightmaps/square"), RESULTS);

    let events = events(&output);
    let last = events.last().expect("a result line");
    assert_eq!(last["event"], "result");
    let outputs = last["outputs"].as_array().expect("a list");
    assert!(outputs.iter().all(|o| bench.path(o.as_str().expect("a path")).is_file()));
    for event in events.iter().filter(|e| e["event"] == "progress") {
        assert!(event["stage"].is_string());
        assert!((0.0..=1.0).contains(&event["done"].as_f64().expect("a number")), "{event}");
    }
    let overall: Vec<f64> = events.iter().filter_map(|e| e["overall"].as_f64()).collect();
    assert!(overall.is_sorted() && overall.last() == Some(&1.0), "{overall:?}");

    let report = fs::read(bench.path("lightmaps/square/report.json")).expect("it was written");
    let report: Value = serde_json::from_slice(&report).expect("it is JSON");
    assert_eq!(report["schema"], "lightkiln-report/1");
    assert_eq!(report["scene"]["triangles"], 2);
    assert!(report["atlas"]["texels"].as_u64().expect("a count") > 0);
    // Irradiance under a sky of radiance 1 is π.
    let mean = report["atlas"]["pages"][0]["mean"][1].as_f64().expect("a number");
    assert!((mean / std::f64::consts::PI - 1.0).abs() < 0.01, "{mean}");
}

#[test]
fn the_audit_tells_the_error_unless_it_is_off() {
    let bench = Bench::new();
    let bake = |options: &[&str]| {
        let output = bench.run(&[&["bake", "square.glb", "--resolution", "16", "--force", "--json"], options].concat());
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        let html = fs::read_to_string(bench.path("lightmaps/square/report.html")).expect("it was written");
        let events = events(&output);
        let report = events.last().expect("a result line")["report"].clone();
        (events, report, html)
    };
    for options in [&[][..], &["--audit", "thorough"]] {
        let (events, report, html) = bake(options);
        let audits: Vec<&Value> = events.iter().filter(|e| e["event"] == "audit").collect();
        assert_eq!(audits.len(), 1);
        assert_eq!(audits[0]["verdict"], "met");
        assert!(audits[0]["target"] == 0.02 && audits[0]["worst"] == "square");
        let audit = &report["audit"];
        let figure = |name: &str, end: &str| audit[name][end].as_f64().expect("a number");
        assert!(figure("error", "low") <= figure("error", "value") && figure("error", "high") <= 0.02, "{audit}");
        assert!(figure("bias", "low") < 0.01 && figure("bias", "high") > -0.01, "{audit}");
        assert_eq!(audit["objects"][0]["path"], "square");
        assert!(report["stages"].as_array().expect("a list").iter().any(|s| s["stage"] == "audit"));
        assert!(html.contains("95th percentile") && html.contains("alt=\"errors\""));
    }
    let (events, report, html) = bake(&["--audit", "off"]);
    assert!(report["audit"].is_null() && !html.contains("95th percentile"));
    assert!(events.iter().all(|e| e["event"] != "audit" && e["stage"] != "audit"));
}

#[test]
fn a_missed_target_is_said_even_into_a_pipe() {
    let bench = Bench::new();
    // Few and large texels cannot be as exact as this where a wall as bright as the sky stands in the middle of them.
    let mut file = lit_square();
    let positions: [[f32; 3]; 4] = [[0.0, 0.0, -0.5], [0.0, 0.5, -0.5], [0.0, 0.5, 0.5], [0.0, 0.0, 0.5]];
    let positions = file.floats("VEC3", &positions);
    let normals = file.floats("VEC3", &[[-1.0, 0.0, 0.0]; 4]);
    let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
    let material =
        file.push("materials", serde_json::json!({ "emissiveFactor": [1.0, 1.0, 1.0], "doubleSided": true }));
    let mesh = file.push(
        "meshes",
        serde_json::json!({ "name": "wall", "primitives": [
        { "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices, "material": material }
    ] }),
    );
    file.push_root(serde_json::json!({ "name": "wall", "mesh": mesh }));
    file.write(&bench.path("wall.glb"));
    let output = bench.run(&["bake", "wall.glb", "--resolution", "7", "--error", "0.1%", "--audit", "thorough"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let said = stderr(&output);
    let report = fs::read(bench.path("lightmaps/wall/report.json")).expect("it was written");
    let report: Value = serde_json::from_slice(&report).expect("it is JSON");
    assert_eq!(report["audit"]["verdict"], "missed", "{}", report["audit"]);
    assert!(said.contains("target 0.10 %: missed") && said.contains("`square`") | said.contains("`wall`"), "{said}");
}

#[test]
fn without_json_a_pipe_stays_quiet() {
    let bench = Bench::new();
    let output = bench.run(&["bake", "square.glb", "--resolution", "16"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(output.stdout.is_empty());
    assert_eq!(stderr(&output), "");
}

#[test]
fn results_that_exist_are_refused_without_force() {
    let bench = Bench::new();
    let bake = ["bake", "square.glb", "--resolution", "16", "--out", "maps"];
    assert_eq!(code(&bench.run(&bake)), 0);
    let page = fs::read(bench.path("maps/lightmap_0.exr")).expect("it was written");
    let refused = bench.run(&bake);
    assert_eq!(code(&refused), 1);
    assert!(stderr(&refused).contains("--force"), "{}", stderr(&refused));
    assert_eq!(bench.names("maps"), RESULTS);

    let replaced = bench.run(&[&bake[..], &["--force", "--threads", "1"]].concat());
    assert_eq!(code(&replaced), 0, "{}", stderr(&replaced));
    assert_eq!(bench.names("maps"), RESULTS);
    assert_eq!(fs::read(bench.path("maps/lightmap_0.exr")).expect("it was written"), page, "any number of threads");
}

#[test]
fn a_folder_that_cannot_be_ends_with_3() {
    let bench = Bench::new();
    let output = bench.run(&["bake", "square.glb", "--out", "square.glb/below", "--json"]);
    assert_eq!(code(&output), 3);
    assert!(stderr(&output).contains("--out"), "{}", stderr(&output));
    assert_eq!(events(&output).pop().expect("an error line")["code"], "output_not_a_folder");
}

#[test]
fn info_tells_what_a_scene_holds() {
    let bench = Bench::new();
    let output = bench.run(&["info", "square.glb", "--json"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let info = events(&output).pop().expect("an info line");
    assert_eq!(info["event"], "info");
    assert_eq!(info["triangles"], 2);
    assert_eq!(info["environment"], "constant");

    let text = bench.run(&["info", "square.glb"]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("triangles"));
    assert_eq!(code(&bench.run(&["info", "nothing.glb"])), 1);
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    fn spawn(bench: &Bench, arguments: &[&str]) -> std::process::Child {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin("lightkiln"));
        command.current_dir(bench.folder.path()).args(arguments);
        command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it runs")
    }

    fn cornell() -> String {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell_box.glb").to_string_lossy().into_owned()
    }

    /// Signals a long bake once it has reached `stage`; returns its exit code and what it said last.
    fn interrupt(bench: &Bench, stage: &str, signal: &str) -> (Option<i32>, Value) {
        let scene = cornell();
        let arguments = ["bake", &scene, "--resolution", "4096", "--error", "0.1%", "--out", "maps", "--json"];
        let mut child = spawn(bench, &arguments);
        let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
        let reached = format!("\"stage\":\"{stage}\"");
        assert!(lines.by_ref().map_while(Result::ok).any(|line| line.contains(&reached)));
        let pid = child.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().expect("kill exists").success());
        let last = lines.map_while(Result::ok).last().expect("an error line");
        (child.wait().expect("it ends").code(), serde_json::from_str(&last).expect("a JSON line"))
    }

    #[test]
    fn interrupting_ends_with_130_and_leaves_nothing() {
        for (stage, signal) in [("import", "-INT"), ("atlas", "-INT"), ("texels", "-TERM")] {
            let bench = Bench::new();
            let (code, last) = interrupt(&bench, stage, signal);
            assert_eq!(code, Some(130), "{stage} {signal}: {last}");
            assert_eq!(last["event"], "error");
            assert_eq!(last["code"], "interrupted");
            assert_eq!(bench.names("."), ["square.glb"], "{stage} {signal}");
        }
    }

    #[test]
    fn a_reader_that_goes_away_does_not_stop_the_bake() {
        let bench = Bench::new();
        let mut child = spawn(&bench, &["bake", "square.glb", "--resolution", "16", "--out", "maps", "--json"]);
        drop(child.stdout.take());
        assert_eq!(child.wait().expect("it ends").code(), Some(0));
        assert_eq!(bench.names("maps"), RESULTS);
    }

    #[test]
    fn a_limit_on_file_sizes_leaves_nothing() {
        let bench = Bench::new();
        let binary = assert_cmd::cargo::cargo_bin("lightkiln");
        // Files of at most one block; an ignored SIGXFSZ turns into a failed write.
        let script = "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"";
        let mut command = Command::new("bash");
        command.args(["-c", script]).arg(binary).args([
            "bake",
            "square.glb",
            "--resolution",
            "64",
            "--out",
            "maps",
            "--json",
        ]);
        let output = command.current_dir(bench.folder.path()).output().expect("bash exists");
        assert_eq!(code(&output), 3, "{}", stderr(&output));
        assert_eq!(events(&output).pop().expect("an error line")["code"], "disk_full");
        assert_eq!(bench.names("."), ["square.glb"]);
    }
}
