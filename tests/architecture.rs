//! The module arrows of docs/architecture.md, held against the source: who may name whom, where foreign crates stop, and
//! who may touch files. In: the text of `src/`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Arrows between modules of the library. A module may also name what its targets may name.
const ARROWS: &[(&str, &[&str])] = &[
    (
        "bake",
        &[
            "config",
            "import",
            "atlas",
            "accel",
            "hierarchy",
            "transport",
            "solve",
            "gather",
            "relight",
            "post",
            "audit",
            "output",
        ],
    ),
    ("config", &["import", "atlas", "accel", "hierarchy", "transport", "solve", "gather", "post", "audit", "output"]),
    ("import", &["scene", "document"]),
    ("atlas", &["scene"]),
    ("accel", &["scene"]),
    ("hierarchy", &["atlas", "scene"]),
    ("transport", &["hierarchy", "accel"]),
    ("solve", &["transport", "hierarchy"]),
    ("gather", &["solve", "hierarchy", "atlas", "scene", "accel"]),
    ("post", &["atlas"]),
    ("relight", &["gather", "hierarchy", "atlas", "scene", "post"]),
    ("audit", &["accel", "atlas", "scene"]),
    ("output", &["atlas", "scene", "gather", "audit", "document"]),
    ("scene", &[]),
    ("document", &[]),
];

/// Open to every module; they name only each other.
const LEAVES: &[&str] = &["units", "math", "progress", "warning"];

/// The binary's modules, which reach the library as a foreign crate.
const BINARY: &[&str] = &["main", "cli"];

/// Crates with a wide interface, and the module where their types stop.
const FOREIGN: &[(&str, &str)] =
    &[("obvhs", "accel"), ("xatlas_rs_v2", "atlas"), ("uvunwrap", "atlas"), ("gltf", "import")];

/// Modules that touch files, the environment or the standard streams; everything else is arithmetic.
const OUTSIDE_WORLD: &[&str] = &["import", "output", "main", "cli"];
const OUTSIDE_NAMES: &[&str] = &["std::fs", "std::env", "println!", "eprintln!"];

/// A source file without comments and without its unit tests.
struct Source {
    path: PathBuf,
    module: String,
    code: String,
}

/// Every file under `src/`.
fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("src is readable") {
            let path = entry.expect("src is readable").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let relative = path.strip_prefix(&root).expect("below src");
                let first = relative.iter().next().expect("a file has a name").to_string_lossy();
                let module = first.trim_end_matches(".rs").to_string();
                let code = code_of(&fs::read_to_string(&path).expect("sources are UTF-8"));
                sources.push(Source { path: relative.to_path_buf(), module, code });
            }
        }
    }
    sources
}

/// The text up to the unit tests, without line comments.
fn code_of(text: &str) -> String {
    let body = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let lines = body.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

/// Names that directly follow `crate::`, those in braces included.
fn named_modules(code: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for (at, prefix) in code.match_indices("crate::") {
        // `$crate::` and the end of a longer name are no paths from the root of this crate.
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(group) => names.extend(first_names(group)),
            None => names.extend(identifier(rest)),
        }
    }
    names
}

/// The first name of every item of a `use` group, up to its closing brace.
fn first_names(group: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut depth = 0;
    let mut start = 0;
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                names.extend(identifier(group[start..i].trim()));
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names
}

fn identifier(text: &str) -> Option<String> {
    let name: String = text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    (!name.is_empty()).then_some(name)
}

/// Everything that can be reached from `module` along the arrows.
fn reachable(module: &str, arrows: &BTreeMap<&str, &[&str]>) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut open: Vec<&str> = arrows.get(module).map(|targets| targets.to_vec()).unwrap_or_default();
    while let Some(next) = open.pop() {
        if found.insert(next.to_string()) {
            open.extend(arrows.get(next).into_iter().flat_map(|targets| targets.iter()));
        }
    }
    found
}

#[test]
fn modules_name_only_what_lies_below_them() {
    let arrows: BTreeMap<&str, &[&str]> = ARROWS.iter().copied().collect();
    let mut faults = Vec::new();
    for source in sources() {
        let module = source.module.as_str();
        if module == "lib" || BINARY.contains(&module) {
            continue;
        }
        assert!(arrows.contains_key(module) || LEAVES.contains(&module), "`{module}` has no place in the table");
        let allowed = reachable(module, &arrows);
        for name in named_modules(&source.code) {
            if name != module && !LEAVES.contains(&name.as_str()) && !allowed.contains(&name) {
                faults.push(format!("{} names `{name}`", source.path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "arrows that point back:\n{}", faults.join("\n"));
}

#[test]
fn the_table_has_no_cycle() {
    let arrows: BTreeMap<&str, &[&str]> = ARROWS.iter().copied().collect();
    for module in arrows.keys() {
        assert!(!reachable(module, &arrows).contains(*module), "`{module}` reaches itself");
    }
}

#[test]
fn foreign_crates_stop_at_one_module() {
    for source in sources() {
        for (krate, home) in FOREIGN {
            let named = source.code.contains(&format!("{krate}::"));
            assert!(!named || source.module == *home, "{} names `{krate}`", source.path.display());
        }
    }
}

#[test]
fn only_the_edges_touch_the_outside_world() {
    for source in sources().iter().filter(|s| !OUTSIDE_WORLD.contains(&s.module.as_str())) {
        for name in OUTSIDE_NAMES {
            assert!(!source.code.contains(name), "{} names `{name}`", source.path.display());
        }
    }
}

#[test]
fn the_scan_sees_every_form_of_path() {
    let code = code_of(
        "use crate::scene::Scene;\npub use crate::{atlas, gather::{Lightmap, x}, post::a};\n// crate::comment\n\
         let a = f(crate::units::K); $crate::no; mycrate::no;\n#[cfg(test)]\nmod tests { use crate::accel; }",
    );
    let names: Vec<_> = named_modules(&code).into_iter().collect();
    assert_eq!(names, ["atlas", "gather", "post", "scene", "units"]);
}
