//! Solve, gather, merge: any split of the tiles gives the bits of a single bake, and what does not belong together is
//! refused.

mod bench;
mod scene_file;

use bench::{Bench, code, events, stderr};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

/// Options of a small bake that makes some tiles.
const SMALL: [&str; 4] = ["--resolution", "96", "--error", "5%"];

fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).to_string_lossy().into_owned()
}

fn done(bench: &Bench, arguments: &[&str]) -> Output {
    let output = bench.run(arguments);
    assert_eq!(code(&output), 0, "{arguments:?}: {}", stderr(&output));
    output
}

/// Runs a command that must fail, with words of its message.
fn refused(bench: &Bench, arguments: &[&str], status: i32, words: &[&str]) {
    let before = bench.names("maps");
    let output = bench.run(&[arguments, &["--json"]].concat());
    let said = stderr(&output);
    assert_eq!(code(&output), status, "{arguments:?}: {said}");
    assert!(words.iter().all(|word| said.contains(word)), "{arguments:?} lacks one of {words:?}: {said}");
    assert_eq!(events(&output).pop().expect("an error line")["event"], "error");
    assert_eq!(bench.names("maps"), before, "nothing partial");
}

/// Solves the Cornell box in `work`; the number of tiles.
fn solve(bench: &Bench, options: &[&str]) -> u64 {
    let scene = scene("cornell_box.glb");
    let output = done(bench, &[&["solve", &scene, "--out", "work", "--json"], &SMALL[..], options].concat());
    let result = events(&output).pop().expect("a result line");
    assert_eq!(result["event"], "result");
    result["solution"]["tiles"].as_u64().expect("a number")
}

fn gather(bench: &Bench, tiles: &str, options: &[&str]) -> Value {
    let output = done(bench, &[&["gather", "work", "--tiles", tiles, "--json"], options].concat());
    events(&output).pop().expect("a result line")
}

/// Checks that two folders hold the same pages, and reports that agree in all but times.
fn same_results(bench: &Bench, merged: &str, single: &str) {
    assert_eq!(bench.names(merged), bench.names(single));
    let read = |folder: &str, name: &str| fs::read(bench.path(folder).join(name)).expect("it was written");
    let exrs: Vec<String> = bench.names(single).into_iter().filter(|name| name.ends_with(".exr")).collect();
    assert!(exrs.len() > 1, "{exrs:?}");
    for name in exrs {
        assert!(read(merged, &name) == read(single, &name), "{merged}/{name}");
    }
    let report = |folder: &str| serde_json::from_slice::<Value>(&read(folder, "report.json")).expect("it is JSON");
    let (merged, single) = (report(merged), report(single));
    for part in ["audit", "refinements", "rays", "solver", "state", "settings", "atlas"] {
        assert_eq!(merged[part], single[part], "{part}");
    }
}

fn page(bench: &Bench, folder: &str) -> Vec<u8> {
    fs::read(bench.path(folder).join("lightmap_0.exr")).expect("it was written")
}

/// A folder with a solution and all its tiles, made once; copied for each test that spoils it.
fn template() -> &'static Bench {
    static TEMPLATE: OnceLock<Bench> = OnceLock::new();
    TEMPLATE.get_or_init(|| {
        let bench = Bench::new();
        let count = solve(&bench, &[]);
        assert!(count >= 5, "{count} tiles are too few to split");
        gather(&bench, "0-2", &[]);
        gather(&bench, &format!("3-{}", count - 1), &[]);
        bench
    })
}

fn finished() -> Bench {
    let bench = Bench::new();
    fs::create_dir(bench.path("work")).expect("a new folder");
    for name in template().names("work") {
        fs::copy(template().path("work").join(&name), bench.path("work").join(&name)).expect("there is room");
    }
    bench
}

#[test]
fn any_split_gives_the_bits_of_a_single_bake() {
    let bench = Bench::new();
    let cornell = scene("cornell_box.glb");
    done(&bench, &[&["bake", &cornell, "--out", "single", "--audit", "off", "--float"], &SMALL[..]].concat());
    let single = page(&bench, "single");
    let last = solve(&bench, &["--threads", "2"]) - 1;
    let merged = |parts: &[&str], name: &str| {
        done(&bench, &[&["merge"], parts, &["--out", name, "--audit", "off", "--float"]].concat());
        assert!(page(&bench, name) == single, "{name}");
        let lit = |folder: &str| fs::read(bench.path(folder).join("cornell_box.lit.glb")).expect("it was written");
        assert!(lit(name) == lit("single"), "{name}");
    };
    // The scene may lie elsewhere.
    fs::copy(&cornell, bench.path("moved.glb")).expect("there is room");
    // Files elsewhere, of one tile, of two in another order, and of an uneven split on one and on two threads.
    let all = format!("0-{last}");
    gather(&bench, &all, &["--out", "whole.lk"]);
    merged(&["work", "whole.lk"], "one");
    gather(&bench, &format!("2-{last}"), &["--out", "b.lk", "--threads", "1"]);
    gather(&bench, "0-1", &["--out", "a.lk", "--threads", "2"]);
    merged(&["b.lk", "work", "a.lk"], "two");
    gather(&bench, "0,2", &["--out", "c.lk", "--threads", "1"]);
    gather(&bench, "1", &["--out", "d.lk", "--scene", "moved.glb"]);
    gather(&bench, &format!("3-{last}"), &["--out", "e.lk", "--threads", "2"]);
    merged(&["work", "c.lk", "d.lk", "e.lk"], "three");
    // What is there twice is the same.
    merged(&["work", "whole.lk", "a.lk", "b.lk", "c.lk", "d.lk", "e.lk"], "twice");
    assert!(fs::read(bench.path("whole.lk")).expect("it was written").len() > 1000);
}

#[test]
fn groups_audits_and_refinements_are_those_of_a_single_bake() {
    let bench = Bench::new();
    let cornell = scene("cornell_box.glb");
    let options = ["--resolution", "64", "--error", "1%", "--groups"];
    done(&bench, &[&["bake", &cornell, "--out", "single"], &options[..]].concat());
    done(&bench, &[&["solve", &cornell, "--out", "work"], &options[..]].concat());
    done(&bench, &["gather", "work", "--tiles", "1-2"]);
    done(&bench, &["gather", "work"]);
    done(&bench, &["merge", "work", "--out", "merged"]);
    same_results(&bench, "merged", "single");
}

#[test]
fn a_part_of_the_light_is_that_of_a_single_bake() {
    let bench = Bench::new();
    let house = scene("house.glb");
    for part in ["direct", "indirect"] {
        let options = [&["--light", part], &SMALL[..]].concat();
        let [single, merged] = ["single", "merged"].map(|name| format!("{name}_{part}"));
        done(&bench, &[&["bake", &house, "--out", &single], &options[..]].concat());
        done(&bench, &[&["solve", &house, "--out", part], &options[..]].concat());
        done(&bench, &["gather", part, "--tiles", "1", "--out", &format!("{part}.lk")]);
        done(&bench, &["gather", part]);
        done(&bench, &["merge", part, &format!("{part}.lk"), "--out", &merged]);
        same_results(&bench, &merged, &single);
    }
    assert!(page(&bench, "single_direct") != page(&bench, "single_indirect"));
    // What was made for one part is of no use to another.
    let solve = [&["solve", &house, "--out", "direct"], &SMALL[..]].concat();
    refused(&bench, &solve, 1, &["light \"direct\", not \"combined\"", "--force"]);
    let foreign = ["merge", "indirect", "direct.lk", "--out", "maps"];
    refused(&bench, &foreign, 1, &["direct.lk` (tiles 1)", "light \"direct\", not \"indirect\""]);
    refused(&bench, &[&solve[..], &["--groups", "--light", "direct"]].concat(), 2, &["--groups"]);
}

#[test]
fn what_is_there_is_not_done_again() {
    let bench = finished();
    let (names, size) =
        (bench.names("work"), |name: &str| fs::read(bench.path("work").join(name)).expect("it is there"));
    let solution = size("solved.lk");
    let again = done(&bench, &[&["solve", &scene("cornell_box.glb"), "--out", "work", "--json"], &SMALL[..]].concat());
    assert_eq!(events(&again).pop().expect("a result line")["existed"], true);
    assert!(size("solved.lk") == solution);
    let result = gather(&bench, "1-3", &[]);
    assert!(result["gathered"] == "" && result["outputs"] == Value::Array(vec![]), "{result}");
    assert_eq!(bench.names("work"), names);
    fs::remove_file(bench.path("work/tiles_0-2.lk")).expect("it was there");
    let info = done(&bench, &["info", "work", "--json"]);
    assert_eq!(events(&info)[0]["missing"], "0-2");
    refused(
        &bench,
        &["merge", "work", "--out", "maps"],
        1,
        &["tiles 0-2 of", "are missing", "gather work --tiles 0-2"],
    );
    assert_eq!(gather(&bench, "0-3", &[])["gathered"], "0-2");
    // A file goes on to hold what it held.
    let count = events(&info)[0]["solution"]["tiles"].as_u64().expect("a number");
    fs::remove_file(bench.path(&format!("work/tiles_3-{}.lk", count - 1))).expect("it was there");
    assert_eq!(gather(&bench, "0-3", &[])["gathered"], "3");
    assert_eq!(events(&done(&bench, &["info", "work", "--json"]))[0]["done"], "0-3");
}

#[cfg(unix)]
#[test]
fn a_gather_that_is_stopped_goes_on() {
    let bench = Bench::new();
    let cornell = scene("cornell_box.glb");
    done(&bench, &["solve", &cornell, "--out", "work", "--resolution", "96", "--error", "0.7%"]);
    gather(&bench, "0-3", &["--out", "whole.lk"]);
    let whole = fs::read(bench.path("whole.lk")).expect("it was written");
    for (signal, status) in [("KILL", None), ("INT", Some(130))] {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin("lightkiln"));
        command.current_dir(bench.folder.path());
        command.args(["gather", "work", "--tiles", "0-3", "--checkpoint", "0", "--json"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it runs");
        let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines().map_while(Result::ok);
        assert!(lines.by_ref().any(|line| line.contains("\"event\":\"checkpoint\"")));
        let pid = child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{signal}"), &pid]).status().expect("kill exists").success());
        let last = lines.last();
        assert_eq!(child.wait().expect("it ends").code(), status, "{signal}");
        if status.is_some() {
            let last = last.expect("an error line");
            assert!(last.contains("the same command goes on from `work/tiles_0-3.lk`"), "{last}");
        }
        refused(&bench, &["merge", "work", "--out", "maps"], 1, &["tiles 0-", "are missing"]);
    }
    gather(&bench, "0-3", &[]);
    assert!(fs::read(bench.path("work/tiles_0-3.lk")).expect("it is there") == whole);
}

#[test]
fn damaged_and_foreign_tiles_are_refused_by_name() {
    let bench = finished();
    let merge = ["merge", "work", "--out", "maps"];
    let (name, path) = ("tiles_0-2.lk", bench.path("work/tiles_0-2.lk"));
    let whole = fs::read(&path).expect("it is there");
    for bytes in [&whole[..whole.len() - 1], &whole[..10], &[]] {
        fs::write(&path, bytes).expect("there is room");
        refused(&bench, &merge, 1, &[name, "is damaged", "gather its tiles again"]);
    }
    // A damaged file is replaced by the gather that would write it.
    gather(&bench, "0-2", &[]);
    assert!(fs::read(&path).expect("it is there") == whole);

    // Tiles of a solution with other settings.
    let other = Bench::new();
    done(&other, &["solve", &scene("cornell_box.glb"), "--out", "work", "--resolution", "96", "--error", "10%"]);
    done(&other, &["gather", "work", "--tiles", "1"]);
    fs::copy(other.path("work/tiles_1.lk"), bench.path("work/tiles_1.lk")).expect("there is room");
    refused(&bench, &merge, 1, &["tiles_1.lk` (tiles 1)", "error 0.1, not 0.05"]);
    let info = done(&bench, &["info", "work", "--json"]);
    assert!(events(&info)[0]["faults"][0].as_str().expect("a fault").contains("tiles_1.lk"));
    fs::remove_file(bench.path("work/tiles_1.lk")).expect("it was there");
    let file = other.path("work/tiles_1.lk").to_string_lossy().into_owned();
    refused(&bench, &["merge", "work", &file, "--out", "maps"], 1, &["error 0.1, not 0.05"]);
    let elsewhere = other.path("work").to_string_lossy().into_owned();
    refused(&bench, &["merge", "work", &elsewhere, "--out", "maps"], 1, &["are different solutions"]);
    // The error of the last probe is another one; the file is whole.
    let mut other = whole[..whole.len() - 12].to_vec();
    let place = other.len() - 5;
    other[place] ^= 1;
    fs::write(bench.path("other.lk"), sealed(&other)).expect("there is room");
    let both = ["tiles_0-2.lk` (tiles 0-2)", "other.lk` (tiles 0-2)", "disagree about the same texels"];
    refused(&bench, &["merge", "work", "other.lk", "--out", "maps"], 1, &both);
    refused(&bench, &["merge", "nothing", "--out", "maps"], 1, &["there is no `nothing`"]);
    refused(&bench, &["merge", ".", "--out", "maps"], 1, &["there is no solution in `.`"]);
    done(&bench, &merge);
    refused(&bench, &merge, 1, &["already exists", "--force"]);
}

#[test]
fn solutions_of_other_scenes_settings_and_versions_are_refused() {
    let bench = finished();
    let cornell = scene("cornell_box.glb");
    refused(&bench, &["gather", "nothing", "--tiles", "0"], 1, &["no solution in `nothing`", "lightkiln solve"]);
    refused(&bench, &["gather", "work", "--tiles", "900-901"], 1, &["there are no tiles 900-901", "from 0 to"]);
    refused(&bench, &["gather", "work", "--tiles", "3-1"], 2, &["0-15"]);
    refused(&bench, &["gather", "work", "--scene", "square.glb", "--out", "x.lk"], 1, &["square.glb", "not the scene"]);
    refused(&bench, &["gather", "work", "--scene", "gone.glb", "--out", "x.lk"], 1, &["no `gone.glb`", "--scene"]);
    refused(&bench, &["merge", "work", "--scene", "square.glb", "--out", "maps"], 1, &["not the scene"]);
    refused(&bench, &["solve", &cornell, "--out", "work"], 1, &["solved.lk", "error 0.05, not 0.02", "--force"]);
    refused(&bench, &["solve", "square.glb", "--out", "work"], 1, &["another scene", "--force"]);
    refused(&bench, &["solve", &cornell, "--out", "work", "--quantity", "radiance"], 2, &["--quantity"]);
    refused(&bench, &["solve", &cornell], 2, &["--out"]);

    // Another version: the head says which, and the file is whole.
    let path = bench.path("work/solved.lk");
    let whole = fs::read(&path).expect("it is there");
    let line = whole.iter().position(|&b| b == b'\n').expect("a first line");
    let version = concat!("\"version\":\"", env!("CARGO_PKG_VERSION"), "\"");
    let head = String::from_utf8(whole[..line].to_vec()).expect("it is JSON").replace(version, "\"version\":\"0.0.9\"");
    fs::write(&path, sealed(&[head.as_bytes(), &whole[line..whole.len() - 12]].concat())).expect("there is room");
    let own = concat!("this is ", env!("CARGO_PKG_VERSION"));
    refused(&bench, &["gather", "work", "--out", "x.lk"], 3, &["from lightkiln 0.0.9", own]);
    refused(&bench, &["merge", "work", "--out", "maps"], 3, &["from lightkiln 0.0.9", own]);
    refused(&bench, &["solve", &cornell, "--out", "work", "--error", "5%"], 1, &["from lightkiln 0.0.9", "--force"]);
    // Content that is not what its identity says.
    let mut other = whole[..whole.len() - 12].to_vec();
    *other.last_mut().expect("it has content") ^= 1;
    fs::write(&path, sealed(&other)).expect("there is room");
    refused(&bench, &["gather", "work", "--out", "x.lk"], 1, &["solved.lk` is damaged", "--force"]);
    fs::write(&path, &whole[..99]).expect("there is room");
    refused(&bench, &["solve", &cornell, "--out", "work"], 1, &["solved.lk` is damaged", "--force"]);

    // Force replaces it, and removes the tiles of what was there.
    done(&bench, &["solve", &cornell, "--out", "work", "--resolution", "16", "--error", "20%", "--force"]);
    assert_eq!(bench.names("work"), ["solved.lk"]);
}

/// A body with its length and checksum.
fn sealed(body: &[u8]) -> Vec<u8> {
    let mut bytes = body.to_vec();
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(crc32fast::hash(body).to_le_bytes());
    bytes
}
