//! `lightkiln bake --groups` and `lightkiln relight`: files, exactness, bad input.

mod scene_file;

use assert_cmd::Command;
use exr::prelude::{ReadChannels, ReadLayers};
use scene_file::lit_square;
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::process::Output;
use tempfile::TempDir;

const LAMPS: [(&str, [f64; 3]); 2] = [("Key", [3.0, 2.0, 1.0]), ("Fill", [0.4, 0.6, 0.8])];

struct Bench {
    folder: TempDir,
}

impl Bench {
    /// A folder with `room.glb`: a floor and a wall under a sky, with lamps `Key` and `Fill`.
    fn new() -> Self {
        let bench = Self { folder: TempDir::new().expect("a temporary folder") };
        bench.write("room.glb", |_, strength| strength);
        bench
    }

    /// The same scene with other strengths of the lamps.
    fn write(&self, name: &str, strength: impl Fn(&str, [f64; 3]) -> [f64; 3]) {
        let mut file = lit_square();
        let wall = [[0.5, 0.0, -0.5], [0.5, 0.0, 0.5], [0.5, 1.0, 0.5], [0.5, 1.0, -0.5]];
        let positions = file.floats("VEC3", &wall);
        let normals = file.floats("VEC3", &[[-1.0, 0.0, 0.0]; 4]);
        let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
        let red = json!({ "name": "Red", "pbrMetallicRoughness":
            { "baseColorFactor": [0.8, 0.2, 0.2, 1.0], "metallicFactor": 0.0 } });
        let material = file.push("materials", red);
        let primitive = json!({ "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices, "material": material });
        let mesh = file.push("meshes", json!({ "name": "wall", "primitives": [primitive] }));
        file.push_root(json!({ "name": "wall", "mesh": mesh }));
        let mut lamps: Vec<Value> = LAMPS
            .iter()
            .map(|(lamp, s)| json!({ "name": lamp, "type": "point", "intensity": strength(lamp, *s), "radius": 0.05 }))
            .collect();
        lamps.push(json!({ "name": "Off", "type": "point", "intensity": [0, 0, 0] }));
        file.json["extensions"]["LIGHTKILN_scene"]["lights"] = lamps.into();
        for (i, place) in [[0.2, 0.7, 0.3], [-0.3, 0.9, -0.2], [0.0, 0.5, 0.0]].into_iter().enumerate() {
            let name = ["Key", "Fill", "Off"][i];
            let light = json!({ "LIGHTKILN_scene": { "light": i } });
            file.push_root(json!({ "name": name, "translation": place, "extensions": light }));
        }
        file.write(&self.path(name));
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::cargo_bin("lightkiln").expect("the binary is built for its tests");
        command.current_dir(self.folder.path()).args(arguments).output().expect("it runs")
    }

    /// Runs what must succeed and returns the report.
    fn report(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert_eq!(code(&output), 0, "{arguments:?}: {}", stderr(&output));
        let text = String::from_utf8(output.stdout).expect("JSON lines are UTF-8");
        let last = text.lines().last().expect("a result line");
        serde_json::from_str::<Value>(last).expect("it is JSON")["report"].clone()
    }

    fn bake(&self, scene: &str, folder: &str, options: &[&str]) -> Value {
        let bake = ["bake", scene, "--out", folder, "--resolution", "48", "--audit", "off", "--error", "1%"];
        self.report(&[&bake[..], options].concat())
    }

    fn relight(&self, out: &str, changes: &[&str]) -> Value {
        let sets = changes.iter().flat_map(|change| ["--set", change]);
        self.report(&["relight", "maps", "--out", out, "--force"].into_iter().chain(sets).collect::<Vec<_>>())
    }

    /// Runs a relight that must fail; its code, and what it said.
    fn failure(&self, arguments: &[&str]) -> (i32, String) {
        let output = self.run(&[&["relight"], arguments].concat());
        (code(&output), stderr(&output))
    }

    /// The values of a page.
    fn page(&self, name: &str) -> Vec<f32> {
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = reader.all_attributes().from_file(self.path(name)).expect("it is a page");
        image.layer_data.channel_data.list.iter().rev().flat_map(|c| c.sample_data.values_as_f32()).collect()
    }
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("it ended by itself")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Root mean square difference by the mean of `want`.
fn difference(got: &[f32], want: &[f32]) -> f32 {
    let squares: f32 = got.iter().zip(want).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / got.len() as f32).sqrt() / (want.iter().sum::<f32>() / want.len() as f32)
}

/// Holds pages together to so many roundings to half floats: pages are kept in them, and borders are filled anew.
fn check_rounding(what: &str, got: &[f32], want: &[f32], roundings: f32) {
    for (i, (a, b)) in got.iter().zip(want).enumerate() {
        assert!((a - b).abs() <= roundings * b.abs() / 2048.0 + 1e-6, "{what}, value {i}: {a} instead of {b}");
    }
}

#[test]
fn a_page_for_every_group_and_the_whole_unchanged() {
    let bench = Bench::new();
    bench.bake("room.glb", "plain", &[]);
    let report = bench.bake("room.glb", "maps", &["--groups"]);
    let bytes = |name: &str| fs::read(bench.path(name)).expect("it was written");
    assert_eq!(bytes("maps/lightmap_0.exr"), bytes("plain/lightmap_0.exr"));
    let names: Vec<&str> =
        report["groups"].as_array().expect("a list").iter().filter_map(|g| g["name"].as_str()).collect();
    assert_eq!(names, ["environment", "Key", "Fill"]);
    let mut sum = vec![0.0; bench.page("maps/lightmap_0.exr").len()];
    for name in names {
        let page = bench.page(&format!("maps/lightmap_0.{name}.exr"));
        sum.iter_mut().zip(page).for_each(|(sum, value)| *sum += value);
    }
    check_rounding("sum", &sum, &bench.page("maps/lightmap_0.exr"), 4.0);

    // A bake without groups takes away what would pass for its own.
    bench.bake("room.glb", "maps", &["--force"]);
    assert!(!bench.path("maps/solution.lk").exists() && !bench.path("maps/lightmap_0.Key.exr").exists());
}

#[test]
fn direct_and_indirect_light_add_up() {
    let bench = Bench::new();
    for options in [&[][..], &["--preview"], &["--progressive"]] {
        let of = |part: &str| {
            let report = bench.bake("room.glb", part, &[options, &["--light", part, "--force"]].concat());
            assert_eq!(report["settings"]["light"], part);
            bench.page(&format!("{part}/lightmap_0.exr"))
        };
        let (direct, indirect) = (of("direct"), of("indirect"));
        let sum: Vec<f32> = direct.iter().zip(&indirect).map(|(a, b)| a + b).collect();
        check_rounding("sum", &sum, &of("combined"), 4.0);
        // The wall bounces, and the sky is no lamp.
        assert!(direct.iter().sum::<f32>() > 0.0 && indirect.iter().sum::<f32>() > 0.0);
    }
    // Without reflection and sky, lamps are all there is.
    bench.bake("room.glb", "maps", &["--groups"]);
    bench.relight("relit", &["environment=0", "material:Red.reflectance=0", "material:material0.reflectance=0"]);
    let miss = difference(&bench.page("relit/lightmap_0.exr"), &bench.page("direct/lightmap_0.exr"));
    assert!(miss < 0.15, "{miss}");
    let both = bench.run(&["bake", "room.glb", "--groups", "--light", "direct"]);
    assert_eq!(code(&both), 2);
}

#[test]
fn lamps_are_changed_exactly() {
    let bench = Bench::new();
    bench.bake("room.glb", "maps", &["--groups"]);
    let report = bench.relight("relit", &["Key=2", "Fill=0.5,1,2", "environment=0"]);
    assert_eq!(report["relight"]["expected_error"], 0.0);
    assert_eq!(report["rays"], json!({}));
    let times = |name: &str, factors: [f32; 3]| {
        let page = bench.page(name);
        let channel = page.len() / 3;
        page.iter().enumerate().map(|(i, v)| v * factors[i / channel]).collect::<Vec<f32>>()
    };
    let (key, fill) = (times("maps/lightmap_0.Key.exr", [2.0; 3]), times("maps/lightmap_0.Fill.exr", [0.5, 1.0, 2.0]));
    check_rounding("Key", &bench.page("relit/lightmap_0.Key.exr"), &key, 2.0);
    check_rounding("Fill", &bench.page("relit/lightmap_0.Fill.exr"), &fill, 2.0);
    let sum: Vec<f32> = key.iter().zip(&fill).map(|(a, b)| a + b).collect();
    check_rounding("whole", &bench.page("relit/lightmap_0.exr"), &sum, 4.0);
    assert!(bench.page("relit/lightmap_0.environment.exr").iter().all(|&v| v == 0.0));
    assert!(bench.path("relit/room.lit.glb").is_file());
    let html = fs::read_to_string(bench.path("relit/report.html")).expect("it was written");
    assert!(html.contains("Fill=0.5,1,2") && html.contains("Light groups"));

    bench.write("bright.glb", |lamp, [r, g, b]| match lamp {
        "Key" => [3.0 * r, 1.5 * g, 0.5 * b],
        _ => [r, g, b],
    });
    bench.bake("bright.glb", "fresh", &[]);
    bench.relight("relit", &["Key=3,1.5,0.5"]);
    let miss = difference(&bench.page("relit/lightmap_0.exr"), &bench.page("fresh/lightmap_0.exr"));
    assert!(miss < 0.01, "{miss}");
    // The same as a colour: the strongest channel keeps its strength.
    bench.relight("colour", &["Key.color=3,1,0.1666667", "Key.power=3"]);
    check_rounding("colour", &bench.page("colour/lightmap_0.exr"), &bench.page("relit/lightmap_0.exr"), 4.0);
}

#[test]
fn reflectances_are_replayed_and_refined() {
    let bench = Bench::new();
    bench.bake("room.glb", "maps", &["--groups"]);
    let change = "material:Red.reflectance=0.2,0.6,0.2";
    let report = bench.relight("relit", &[change]);
    assert!(report["relight"]["expected_error"].as_f64().expect("a number") > 0.0);
    let refine = ["relight", "maps", "--out", "refined", "--set", change, "--set", "Key=2", "--refine"];
    let mut tight = refine.to_vec();
    tight.extend(["--set", "material:Red.reflectance=0.2,0.6,0.2"]);
    assert_eq!(bench.failure(&tight[1..]).0, 1, "set twice");

    let text = fs::read_to_string(bench.path("maps/report.json")).expect("it was written");
    assert!(text.contains("\"groups\": true"));
    let relit = bench.page("relit/lightmap_0.exr");
    let before = bench.page("maps/lightmap_0.exr");
    bench.report(&refine);
    bench.report(&["relight", "refined", "--out", "back", "--set", "Key=1"]);
    let fresh = bench.page("back/lightmap_0.exr");
    let (moved, miss) = (difference(&before, &fresh), difference(&relit, &fresh));
    assert!(miss < 0.01 && miss < 0.3 * moved, "{miss} of {moved}");
}

#[test]
fn what_cannot_be_changed_is_named() {
    let bench = Bench::new();
    bench.bake("room.glb", "maps", &["--groups"]);
    let refused = |change: &str| {
        let (code, said) = bench.failure(&["maps", "--out", "relit", "--set", change]);
        assert_eq!(code, 1, "{change}: {said}");
        assert!(!bench.path("relit").exists(), "{change}");
        said
    };
    assert!(refused("Kee=2").contains("nearest names are `Key`"));
    assert!(refused("Off=2").contains("gave no light"));
    assert!(refused("material:Red=2").contains("gave no light"));
    assert!(refused("material:Read.reflectance=0.5").contains("`material:Red`"));
    for wrong in ["Key", "Key=", "Key=-1", "Key=1,2"] {
        assert_eq!(bench.failure(&["maps", "--set", wrong]).0, 2, "{wrong}");
    }
    assert_eq!(bench.failure(&["maps"]).0, 2);
    let (code, said) = bench.failure(&["maps", "--set", "Key=2"]);
    assert!(code == 1 && said.contains("--force"), "{said}");
    let kept = fs::read(bench.path("maps/solution.lk")).expect("it was written");
    assert_eq!(
        bench.report(&["relight", "maps", "--force", "--set", "Key=2"])["outputs"].as_array().map(Vec::len),
        Some(7)
    );
    assert_eq!(fs::read(bench.path("maps/solution.lk")).expect("it stays"), kept);
}

#[test]
fn solutions_that_are_none_are_refused() {
    let bench = Bench::new();
    bench.bake("room.glb", "maps", &["--groups"]);
    let whole = fs::read(bench.path("maps/solution.lk")).expect("it was written");
    let refused = |content: &[u8]| {
        fs::write(bench.path("maps/solution.lk"), content).expect("it can be replaced");
        let (code, said) = bench.failure(&["maps", "--out", "relit", "--set", "Key=2"]);
        assert_eq!(code, 1, "{said}");
        assert!(said.contains("solution.lk") && !bench.path("relit").exists(), "{said}");
        said
    };
    assert!(refused(&whole[..whole.len() / 2]).contains("truncated"));
    assert!(refused(b"").contains("no solution"));
    assert!(refused(&fs::read(bench.path("room.glb")).expect("it is there")).contains("no solution"));
    let mut changed = whole.clone();
    changed[whole.len() / 2] ^= 1;
    assert!(refused(&changed).contains("corrupted"));
    changed.clone_from(&whole);
    changed[8] = 0;
    assert!(refused(&changed).contains("version 0"));
    fs::remove_file(bench.path("maps/solution.lk")).expect("it is there");
    let (code, said) = bench.failure(&["maps", "--out", "relit", "--set", "Key=2"]);
    assert!(code == 1 && said.contains("--groups"), "{said}");
    assert_eq!(bench.failure(&["nowhere", "--set", "Key=2"]).0, 1);
}

#[cfg(unix)]
#[test]
fn a_solution_that_does_not_fit_costs_no_lightmap() {
    let bench = Bench::new();
    bench.bake("room.glb", "maps", &["--groups"]);
    let size = |name: String| fs::metadata(bench.path(&format!("maps/{name}"))).expect("it was written").len();
    let entries = fs::read_dir(bench.path("maps")).expect("it was made").flatten();
    let names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let others = names.iter().filter(|n| *n != "solution.lk").map(|n| size(n.clone())).max().expect("there are others");
    let solution = size("solution.lk".into());
    let blocks = others.div_ceil(1024);
    assert!(solution > blocks * 1024, "the solution, {solution}, is the largest file, others have {others} bytes");
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &script]).arg(assert_cmd::cargo::cargo_bin("lightkiln"));
    command.args([
        "bake",
        "room.glb",
        "--out",
        "small",
        "--resolution",
        "48",
        "--audit",
        "off",
        "--error",
        "1%",
        "--groups",
    ]);
    let output = command.current_dir(bench.folder.path()).output().expect("bash exists");
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stderr(&output).contains("cannot be relit"), "{}", stderr(&output));
    assert!(bench.path("small/lightmap_0.exr").is_file() && !bench.path("small/solution.lk").exists());
}
